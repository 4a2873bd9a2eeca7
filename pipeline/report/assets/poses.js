// The cameras of the views about the surface, seen from the source frame and from the side.

const PICK_PX = 14, AXIS_PX = 16, MARGIN_PX = 14;

/**
 * Two drawings in `stage` that follow each other. `described(view)` is said under the pointer, `chosen(place)` is called
 * when the user clicks on a camera.
 */
function createPoses(stage, views, described, chosen) {
    const posed = views.map((view, place) => ({ view, place })).filter(({ view }) => view.centre);
    const tip = el('output', { class: 'tag', hidden: true });
    let selected = -1, passing = null, quantity = null;

    const sides = data.sides.map((side) => {
        const canvas = el('canvas', { role: 'img', 'aria-label': `Cameras about the surface, ${side.name}` });
        const picture = side.picture ? Object.assign(new Image(), { onload: () => paint(), src: webp(side.picture) }) : null;
        stage.append(el('figure', {}, canvas, el('figcaption', { class: 'muted', text: side.name })));
        // mm from the pivot along the drawing, to the right and upwards
        const along = (vector) => [side.across, side.up].map((axis) => axis.reduce((sum, value, at) => sum + value * vector[at], 0));
        const placed = (point) => along(point.map((value, axis) => value - data.source.pivot[axis]));
        const points = posed.map(({ view }) => placed(view.centre)), source = placed(data.source.centre);
        return { canvas, picture, box: side.box, along, points, source };
    });
    stage.append(tip);

    /** Pixels of a place on a drawing: everything fills it, but for a margin. */
    function scaled({ canvas, points, source, box }) {
        const corners = box ? [[box[0], box[1]], [box[2], box[3]]] : [];
        const [xs, ys] = [0, 1].map((axis) => [[0, 0], source, ...corners, ...points].map((point) => point[axis]));
        const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
        const [width, height] = [canvas.clientWidth, canvas.clientHeight];
        const scale = Math.min((width - 2 * MARGIN_PX) / Math.max(right - left, 1e-6), (height - 2 * MARGIN_PX) / Math.max(high - low, 1e-6));
        return ([x, y]) => [width / 2 + scale * (x - (left + right) / 2), height / 2 - scale * (y - (low + high) / 2)];
    }

    // --- drawing ------------------------------------------------------------------------------------------------------------
    function paint() {
        const known = posed.map(({ view }) => view[quantity.key]).filter(Number.isFinite);
        const [low, high] = [Math.min(...known), Math.max(...known)];
        const colours = posed.map(({ view, place }) => {
            const value = view[quantity.key];
            if (passing && !passing.has(place)) return null;
            if (quantity.colours) return `rgb(${quantity.colours[value]})`;
            return Number.isFinite(value) ? `rgb(${scaleColour(high > low ? (value - low) / (high - low) : 0.5)})` : colour('muted');
        });
        for (const side of sides) paintSide(side, colours);
        return [low, high];
    }

    function paintSide(side, colours) {
        const { canvas, picture, box, along, points } = side, at = scaled(side);
        const [width, height] = [canvas.clientWidth, canvas.clientHeight];
        if (!width || !height) return;
        Object.assign(canvas, { width: width * devicePixelRatio, height: height * devicePixelRatio });
        const context = canvas.getContext('2d');
        context.scale(devicePixelRatio, devicePixelRatio);
        if (picture?.complete && picture.naturalWidth) {
            const [[left, bottom], [right, top]] = [at([box[0], box[1]]), at([box[2], box[3]])];
            context.drawImage(picture, left, top, right - left, bottom - top);
        }
        const line = (from, to, style, thickness) => {
            Object.assign(context, { strokeStyle: style, lineWidth: thickness });
            context.beginPath();
            context.moveTo(...from);
            context.lineTo(...to);
            context.stroke();
        };
        const dot = ([x, y], radius, style) => {
            context.fillStyle = style;
            context.beginPath();
            context.arc(x, y, radius, 0, 2 * Math.PI);
            context.fill();
        };
        const pixels = points.map(at);
        // from each frame of a film to the next one
        if (data.isFilm) {
            for (let n = 1; n < posed.length; n++) {
                if (posed[n].place === posed[n - 1].place + 1) line(pixels[n - 1], pixels[n], colour('muted'), 0.6);
            }
        }
        const camera = (view, place, style, radius) => {
            // the optical axis is the last row of the rotation
            const [x, y] = along(view.rotation.slice(6));
            line(place, [place[0] + AXIS_PX * x, place[1] - AXIS_PX * y], style, radius > 3 ? 2.5 : 1.2);
            dot(place, radius, style);
        };
        const order = [...posed.keys()].sort((one, other) => Boolean(colours[one]) - Boolean(colours[other]));
        for (const n of order) camera(posed[n].view, pixels[n], colours[n] ?? colour('grid'), 3);
        const marked = (view, place, style, name, isLeft) => {
            context.globalAlpha = 0.4;
            line(place, at([0, 0]), style, 1);
            Object.assign(context, { globalAlpha: 1, font: '600 12px system-ui, sans-serif' });
            camera(view, place, style, 5);
            const wide = context.measureText(name).width, x = isLeft ? place[0] - 9 - wide : place[0] + 9;
            const text = [name, Math.min(Math.max(x, 0), width - wide), place[1] + 4];
            Object.assign(context, { strokeStyle: colour('sunken'), lineWidth: 3, fillStyle: style });
            context.strokeText(...text);
            context.fillText(...text);
        };
        const source = at(side.source), n = posed.findIndex(({ place }) => place === selected);
        const isRight = n >= 0 && pixels[n][0] < source[0];
        marked(data.source, source, colour('alert'), 'source frame', !isRight);
        if (n >= 0) marked(posed[n].view, pixels[n], colour('text'), `${data.noun} ${posed[n].view.index}`, isRight);
    }

    // --- choosing -----------------------------------------------------------------------------------------------------------
    function nearest(side, event) {
        const at = scaled(side), box = side.canvas.getBoundingClientRect();
        let best = null, least = PICK_PX;
        posed.forEach((entry, n) => {
            if (passing && !passing.has(entry.place)) return;
            const [x, y] = at(side.points[n]);
            const off = Math.hypot(x - event.clientX + box.left, y - event.clientY + box.top);
            if (off < least) [best, least] = [entry, off];
        });
        return best;
    }

    for (const side of sides) {
        side.canvas.addEventListener('click', (event) => {
            const found = nearest(side, event);
            if (found) chosen(found.place);
        });
        side.canvas.addEventListener('pointermove', (event) => {
            const found = nearest(side, event), box = stage.getBoundingClientRect();
            side.canvas.style.cursor = found ? 'pointer' : '';
            tip.hidden = !found;
            if (!found) return;
            tip.textContent = described(found.view);
            const x = Math.min(Math.max(event.clientX - box.left, tip.clientWidth / 2), box.width - tip.clientWidth / 2);
            tip.style.transform = `translate(${Math.round(x)}px, ${Math.round(event.clientY - box.top)}px) translate(-50%, calc(-100% - 10px))`;
        });
        side.canvas.addEventListener('pointerleave', () => { tip.hidden = true; });
    }
    new ResizeObserver(paint).observe(stage);
    themeListeners.push(paint);

    const colourBy = byId('colour-by');
    colourBy.append(...data.quantities.map(({ key, name }) => el('option', { value: key, text: name })));
    colourBy.value = data.coloured;
    const recolour = () => {
        quantity = data.quantities.find(({ key }) => key === colourBy.value);
        const [low, high] = paint();
        byId('pose-scale').replaceChildren(quantity.colours ? ''
            : scaleBar(measured(low, quantity.digits), measured(high, quantity.digits, quantity.unit)));
    };
    colourBy.addEventListener('change', recolour);
    recolour();

    return {
        select(place) { selected = place; paint(); },
        filter(places) { passing = places; paint(); },
    };
}
