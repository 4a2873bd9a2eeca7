// The surface and the cameras of the views in 3D.

const FRUSTUM_SHARE = 0.09, CHOSEN_SHARE = 0.26;
const PICK_PX = 16;

/** Returns null where there is no WebGL. `chosen(place)` is called when the user clicks on a pose. */
function createPoses(stage, views, chosen) {
    let renderer;
    try {
        renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    } catch {
        return null;
    }
    const posed = views.map((view, place) => ({ view, place })).filter(({ view }) => view.centre);
    const source = data.source;
    const canvas = renderer.domElement;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    Object.entries({
        tabindex: 0, role: 'application',
        'aria-label': 'Poses around the surface. Drag to turn, or use the arrow keys; click on a pose to select its view.',
    }).forEach(([key, value]) => canvas.setAttribute(key, value));
    const labels = { source: el('span', { class: 'tag warning', text: 'source frame' }), view: el('span', { class: 'tag' }) };
    stage.append(canvas, labels.source, labels.view);

    const scene = new THREE.Scene();
    scene.add(new THREE.HemisphereLight(0xffffff, 0xbbbbbb, 2.6));
    const sun = new THREE.DirectionalLight(0xffffff, 0.9);
    scene.add(sun, sun.target);

    // --- what is where ------------------------------------------------------------------------------------------------
    const vector = (values) => new THREE.Vector3(...values);
    const surface = data.surface ? surfaceMesh(data.surface) : null;
    if (surface) scene.add(surface);
    const pivot = source ? vector(source.pivot) : new THREE.Vector3();
    const centres = posed.map(({ view }) => vector(view.centre));
    if (source) centres.push(vector(source.centre));
    const upright = new THREE.Vector3();
    if (source) upright.copy(vector(source.centre)).sub(pivot);
    else for (const centre of centres) upright.add(centre.clone().sub(pivot));
    upright.normalize();
    if (!upright.lengthSq()) upright.set(0, 0, 1);
    const side = source ? vector(source.rotation.slice(0, 3)) : new THREE.Vector3(1, 0, 0);
    side.addScaledVector(upright, -side.dot(upright)).normalize();
    const reach = Math.max(1, ...centres.map((centre) => centre.distanceTo(pivot)));
    sun.position.copy(pivot).addScaledVector(upright, reach).addScaledVector(side, reach * 0.5);
    sun.target.position.copy(pivot);

    const shape = data.camera || (source && source.camera) || [4, 3, 8, 8, 1.5, 1];
    const frusta = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({
        vertexColors: true, transparent: true, opacity: 0.9,
    }));
    // many would hide each other
    const size = FRUSTUM_SHARE * reach * Math.min(1, Math.max(0.35, Math.cbrt(100 / Math.max(posed.length, 1))));
    const corners = posed.map(({ view }) => frustumLines(view, shape, size));
    frusta.geometry.setAttribute('position', new THREE.Float32BufferAttribute(corners.flat(), 3));
    frusta.geometry.setAttribute('color', new THREE.Float32BufferAttribute(new Array(corners.flat().length).fill(1), 3));
    const dots = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({
        size: 5 * renderer.getPixelRatio(), sizeAttenuation: false, vertexColors: true,
    }));
    dots.geometry.setAttribute('position', new THREE.Float32BufferAttribute(posed.flatMap(({ view }) => view.centre), 3));
    dots.geometry.setAttribute('color', new THREE.Float32BufferAttribute(new Array(posed.length * 3).fill(1), 3));
    for (const part of [frusta, dots]) part.frustumCulled = false;
    scene.add(frusta, dots);
    const lines = () => {
        const part = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
        part.frustumCulled = false;
        scene.add(part);
        return part;
    };
    const sourceLines = lines(), selectedLines = lines(), beam = lines(), way = lines();
    beam.material.transparent = true;
    beam.material.opacity = 0.35;
    // from each frame of a film to the next one
    way.geometry.setAttribute('position', new THREE.Float32BufferAttribute(views.flatMap((view, place) => {
        const before = data.isFilm ? views[place - 1] : null;
        return before && before.centre && view.centre ? [...before.centre, ...view.centre] : [];
    }), 3));
    if (source) {
        sourceLines.geometry.setAttribute('position', new THREE.Float32BufferAttribute(
            frustumLines(source, source.camera, CHOSEN_SHARE * reach), 3));
    }
    const plate = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }));
    plate.visible = false;
    plate.frustumCulled = false;
    scene.add(plate);

    // --- from where it is looked at ---------------------------------------------------------------------------------------
    const camera = new THREE.PerspectiveCamera(32, 1, 0.1, 1e5);
    camera.up.copy(upright);
    const middle = pivot.clone().addScaledVector(upright, reach * 0.46);
    const controls = new THREE.OrbitControls(camera, canvas);
    controls.enableDamping = false;
    controls.addEventListener('change', () => { if (!through) render(); });
    // a page that is scrolled with the wheel or a finger goes on scrolling above the picture
    controls.enableZoom = false;
    canvas.addEventListener('focus', () => { controls.enableZoom = true; });
    canvas.addEventListener('blur', () => { controls.enableZoom = false; });
    canvas.style.touchAction = 'pan-y';
    let through = false;
    let selected = null, passing = null, quantity = null;

    const toFront = new THREE.Vector3().crossVectors(side, upright);
    const toViewer = upright.clone().multiplyScalar(0.5).addScaledVector(toFront, 0.82).addScaledVector(side, 0.3).normalize();
    const framed = [...centres];
    if (surface) {
        surface.geometry.computeBoundingBox();
        const { min, max } = surface.geometry.boundingBox;
        for (let corner = 0; corner < 8; corner++) {
            framed.push(new THREE.Vector3(
                corner & 1 ? min.x : max.x, corner & 2 ? min.y : max.y, corner & 4 ? min.z : max.z));
        }
    } else framed.push(pivot);

    /** The first view: everything fills the picture, but for a margin. */
    function reset() {
        controls.target.copy(middle);
        let away = 4 * reach;
        const [half, aspect] = [Math.tan(DEGREE * camera.fov / 2), camera.aspect];
        for (let round = 0; round < 12; round++) {
            camera.position.copy(controls.target).addScaledVector(toViewer, away);
            camera.near = away / 100;
            camera.far = away * 10;
            camera.updateProjectionMatrix();
            controls.update();
            camera.updateMatrixWorld();
            const places = framed.map((point) => point.clone().project(camera));
            const [left, right] = [Math.min(...places.map(({ x }) => x)), Math.max(...places.map(({ x }) => x))];
            const [low, high] = [Math.min(...places.map(({ y }) => y)), Math.max(...places.map(({ y }) => y))];
            const [across, up] = [0, 1].map((column) => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, column));
            controls.target.addScaledVector(across, (left + right) / 2 * away * half * aspect)
                .addScaledVector(up, (low + high) / 2 * away * half);
            away *= Math.max((right - left) / 2 / 0.86, (high - low) / 2 / 0.86);
        }
        render();
    }

    function turn(horizontal, vertical) {
        const offset = camera.position.clone().sub(controls.target);
        offset.applyAxisAngle(upright, horizontal);
        const axis = new THREE.Vector3().crossVectors(upright, offset).normalize();
        const raised = offset.clone().applyAxisAngle(axis, vertical);
        const tilt = raised.angleTo(upright);
        if (tilt > 0.02 && tilt < Math.PI - 0.02) offset.copy(raised);
        camera.position.copy(controls.target).add(offset);
        controls.update();
        render();
    }

    function zoom(factor) {
        camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
        controls.update();
        render();
    }

    canvas.addEventListener('keydown', (event) => {
        const step = {
            ArrowLeft: () => turn(-0.12, 0), ArrowRight: () => turn(0.12, 0), ArrowUp: () => turn(0, -0.12),
            ArrowDown: () => turn(0, 0.12), '+': () => zoom(0.85), '=': () => zoom(0.85), '-': () => zoom(1 / 0.85),
            0: reset,
        }[event.key];
        if (!step || through || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        event.stopPropagation();
        step();
    });

    // --- choosing -----------------------------------------------------------------------------------------------------------
    function onScreen(point, from) {
        const place = point.clone().project(from);
        return [(place.x + 1) / 2 * stage.clientWidth, (1 - place.y) / 2 * stage.clientHeight, place.z];
    }

    let pressed = null;
    canvas.addEventListener('pointerdown', (event) => { pressed = [event.clientX, event.clientY]; });
    canvas.addEventListener('pointerup', (event) => {
        if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4 || through) return;
        const found = nearest(event);
        if (found) chosen(found.place);
    });
    canvas.addEventListener('pointermove', (event) => {
        if (!event.buttons && !through) canvas.style.cursor = nearest(event) ? 'pointer' : 'grab';
    });

    function nearest(event) {
        const box = canvas.getBoundingClientRect();
        const [x, y] = [event.clientX - box.left, event.clientY - box.top];
        let best = null, least = PICK_PX;
        posed.forEach((entry, number) => {
            if (passing && !passing.has(entry.place)) return;
            const [u, v, depth] = onScreen(centres[number], camera);
            const off = Math.hypot(u - x, v - y);
            if (depth < 1 && off < least) [best, least] = [entry, off];
        });
        return best;
    }

    // --- drawing --------------------------------------------------------------------------------------------------------------
    function paint() {
        const values = posed.map(({ view }) => (quantity ? view[quantity.key] : NaN));
        const known = values.filter(Number.isFinite);
        const [low, high] = [Math.min(...known), Math.max(...known)];
        const faint = rgbOf(colour('grid'));
        const [lineColours, dotColours] = [frusta.geometry.attributes.color, dots.geometry.attributes.color];
        posed.forEach(({ place, view }, number) => {
            const value = values[number];
            const shown = !passing || passing.has(place);
            const rgb = shown && quantity?.colours ? quantity.colours[view[quantity.key]] : shown && Number.isFinite(value)
                ? scaleColour(high > low ? (value - low) / (high - low) : 0.5) : faint;
            const [red, green, blue] = rgb.map(linear);
            for (let corner = 0; corner < 16; corner++) lineColours.setXYZ(16 * number + corner, red, green, blue);
            dotColours.setXYZ(number, red, green, blue);
        });
        lineColours.needsUpdate = dotColours.needsUpdate = true;
        sourceLines.material.color.set(colour('warning'));
        selectedLines.material.color.set(colour('text'));
        beam.material.color.set(colour('text'));
        way.material.color.set(colour('muted'));
        render();
        return [low, high];
    }

    const viewCamera = new THREE.PerspectiveCamera();
    viewCamera.matrixAutoUpdate = false;

    function render() {
        const [width, height] = [stage.clientWidth, stage.clientHeight];
        if (!width || !height) return;
        renderer.setScissorTest(false);
        renderer.setViewport(0, 0, width, height);
        const looking = through && selected;
        for (const part of [frusta, dots, sourceLines, selectedLines, beam, way]) part.visible = !looking;
        plate.visible = Boolean(!looking && plate.material.map && selected);
        labels.source.hidden = looking || !source;
        labels.view.hidden = looking || !selected;
        if (looking) {
            const [w, h] = shape;
            const fit = Math.min(width / w, height / h);
            renderer.clear();
            renderer.setViewport((width - w * fit) / 2, (height - h * fit) / 2, w * fit, h * fit);
            renderer.render(scene, viewCamera);
            return;
        }
        renderer.render(scene, camera);
        if (source) tag(labels.source, vector(source.centre));
        if (selected) tag(labels.view, vector(selected.centre));
        // one above the other would hide it
        labels.source.classList.remove('below');
        const boxes = [labels.source, labels.view].map((part) => part.getBoundingClientRect());
        const clash = !labels.source.hidden && !labels.view.hidden && boxes[0].left < boxes[1].right
            && boxes[1].left < boxes[0].right && Math.abs(boxes[0].top - boxes[1].top) < boxes[0].height + 2;
        labels.source.classList.toggle('below', clash);
    }

    function tag(label, point) {
        const [x, y, depth] = onScreen(point, camera);
        label.hidden = depth >= 1 || x < 0 || y < 0 || x > stage.clientWidth || y > stage.clientHeight;
        label.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px) translate(-50%, calc(-100% - 8px))`;
    }

    function select(place) {
        const view = views[place];
        selected = view && view.centre ? view : null;
        const size = CHOSEN_SHARE * reach;
        const points = selected ? frustumLines(selected, shape, size) : [];
        // as far as the surface: what it sees
        const reached = selected ? frustumLines(selected, shape, pivotDepth(selected)) : [];
        for (const [part, positions] of [[selectedLines, points], [beam, reached]]) {
            part.geometry.dispose();
            part.geometry = new THREE.BufferGeometry();
            part.geometry.setAttribute('position', new THREE.Float32BufferAttribute(positions, 3));
        }
        if (selected) {
            labels.view.textContent = `${data.noun} ${view.index}`;
            aim(view);
            showPlate(view, size);
        } else {
            plate.material.map = null;
            through = false;
        }
        render();
    }

    /** Distance of the pivot along the view's axis, mm. */
    function pivotDepth(view) {
        const offset = pivot.clone().sub(vector(view.centre));
        return Math.max(offset.dot(vector(view.rotation.slice(6))), CHOSEN_SHARE * reach);
    }

    function showPlate(view, size) {
        plate.material.map = null;
        if (!view.picture) return;
        const image = new Image();
        image.onload = () => {
            if (selected !== view) return;
            if (plate.material.map) plate.material.map.dispose();
            const texture = new THREE.Texture(image);
            texture.colorSpace = THREE.SRGBColorSpace;
            texture.needsUpdate = true;
            plate.material.map = texture;
            plate.material.needsUpdate = true;
            plate.geometry.dispose();
            plate.geometry = new THREE.BufferGeometry();
            plate.geometry.setAttribute('position', new THREE.Float32BufferAttribute(plateCorners(view, shape, size), 3));
            plate.geometry.setAttribute('uv', new THREE.Float32BufferAttribute([0, 1, 1, 1, 1, 0, 0, 0], 2));
            plate.geometry.setIndex([0, 1, 2, 0, 2, 3]);
            render();
        };
        image.src = webp(view.picture);
    }

    /** Aim the camera for looking through a view: its pose, and its K as a projection. */
    function aim(view) {
        const r = view.rotation, [cx, cy, cz] = view.centre;
        // columns: the view's axes in the model frame; OpenGL looks along -z with y up
        viewCamera.matrixWorld.set(
            r[0], -r[3], -r[6], cx, r[1], -r[4], -r[7], cy, r[2], -r[5], -r[8], cz, 0, 0, 0, 1);
        viewCamera.matrixWorldInverse.copy(viewCamera.matrixWorld).invert();
        viewCamera.matrix.copy(viewCamera.matrixWorld);
        viewCamera.matrix.decompose(viewCamera.position, viewCamera.quaternion, viewCamera.scale);
        const [w, h, fx, fy, u, v] = shape, near = reach / 200, far = reach * 10;
        // pixel (0, 0) is the centre of the top-left pixel
        viewCamera.projectionMatrix.set(
            2 * fx / w, 0, 1 - 2 * (u + 0.5) / w, 0, 0, 2 * fy / h, 2 * (v + 0.5) / h - 1, 0,
            0, 0, -(far + near) / (far - near), -2 * far * near / (far - near), 0, 0, -1, 0);
        viewCamera.projectionMatrixInverse.copy(viewCamera.projectionMatrix).invert();
    }

    function resize() {
        const [width, height] = [stage.clientWidth, stage.clientHeight];
        if (!width || !height) return;
        renderer.setSize(width, height);
        camera.aspect = width / height;
        camera.updateProjectionMatrix();
        render();
    }
    new ResizeObserver(resize).observe(stage);
    resize();
    reset();
    themeListeners.push(() => paint());

    return {
        select, reset, turn, zoom,
        colourBy(chosenQuantity) { quantity = chosenQuantity; return paint(); },
        filter(places) { passing = places; paint(); },
        lookThrough(on) {
            through = on && Boolean(selected);
            controls.enabled = !through;
            render();
            return through;
        },
        direction: () => camera.position.clone().sub(controls.target).normalize().toArray(),
    };
}

const NO_WEBGL = 'This browser shows no 3D: WebGL is not available.';

/** Buttons and colours around the 3D view; where there is none, `absent` says why. */
function steer(poses, absent) {
    if (!poses) {
        byId('scene').append(el('p', { class: 'note', text: absent }));
        for (const button of document.querySelectorAll('#poses button, #poses select')) button.disabled = true;
        return;
    }
    byId('turn-left').addEventListener('click', () => poses.turn(-0.3, 0));
    byId('turn-right').addEventListener('click', () => poses.turn(0.3, 0));
    byId('closer').addEventListener('click', () => poses.zoom(0.8));
    byId('farther').addEventListener('click', () => poses.zoom(1.25));
    byId('home').addEventListener('click', () => poses.reset());
    const through = byId('through'), colourBy = byId('colour-by');
    through.addEventListener('click', () => {
        through.setAttribute('aria-pressed', poses.lookThrough(through.getAttribute('aria-pressed') !== 'true'));
    });
    colourBy.append(...data.quantities.map(({ key, name }) => el('option', { value: key, text: name })));
    colourBy.value = data.coloured;
    const paint = () => {
        const quantity = data.quantities.find(({ key }) => key === colourBy.value);
        const [low, high] = poses.colourBy(quantity);
        byId('pose-scale').replaceChildren(quantity.colours ? ''
            : scaleBar(measured(low, quantity.digits), measured(high, quantity.digits, quantity.unit)));
    };
    colourBy.addEventListener('change', paint);
    paint();
}

const DEGREE = Math.PI / 180;

/** The values of a texture or a vertex are linear. */
function linear(code) {
    const value = code / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
}

/** The four corners of a view's image at a depth, in the model frame: top left, top right, bottom right, bottom left. */
function imageCorners(view, shape, depth) {
    const [w, h, fx, fy, u, v] = shape, r = view.rotation;
    return [[-0.5, -0.5], [w - 0.5, -0.5], [w - 0.5, h - 0.5], [-0.5, h - 0.5]].map(([x, y]) => {
        const point = [(x - u) / fx * depth, (y - v) / fy * depth, depth];
        // the transposed rotation leads back to the model
        return [0, 1, 2].map((axis) => view.centre[axis]
            + r[axis] * point[0] + r[3 + axis] * point[1] + r[6 + axis] * point[2]);
    });
}

const plateCorners = (view, shape, depth) => imageCorners(view, shape, depth).flat();

/** Eight lines: from the centre to the corners, and around the image. */
function frustumLines(view, shape, depth) {
    const corners = imageCorners(view, shape, depth);
    return corners.flatMap((corner, number) => [...view.centre, ...corner, ...corner, ...corners[(number + 1) % 4]]);
}

function surfaceMesh(packed) {
    const steps = new Uint16Array(bytes(packed.positions).buffer);
    const positions = new Float32Array(steps.length);
    for (let place = 0; place < steps.length; place++) {
        positions[place] = packed.low[place % 3] + steps[place] * packed.step[place % 3];
    }
    const codes = bytes(packed.colours);
    const colours = new Float32Array(codes.length);
    for (let place = 0; place < codes.length; place++) colours[place] = linear(codes[place]);
    const raw = bytes(packed.triangles).buffer;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
    geometry.setIndex(new THREE.BufferAttribute(packed.wide ? new Uint32Array(raw) : new Uint16Array(raw), 1));
    geometry.computeVertexNormals();
    return new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide }));
}
