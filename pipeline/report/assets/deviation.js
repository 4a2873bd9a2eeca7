// A surface to turn and to zoom, painted with a z-buffer of its own: no graphics card, and nothing from a network.

const AMBIENT = 0.4, TURN_RAD = 0.008, KEY_RAD = 0.1, ZOOM = 1.1, MOST_PX = 900;
const canvas = byId('model'), context = canvas.getContext('2d', { willReadFrequently: true });
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const places = Float32Array.from(new Int16Array(bytes(data.places)), (value) => value / 32767);
const faces = new Uint16Array(bytes(data.faces)), colours = new Uint8Array(bytes(data.colours));
let turned, zoom, wanted = false;

function paint() {
    wanted = false;
    const factor = Math.min(1, MOST_PX / Math.max(canvas.clientWidth, 1));
    const width = Math.round(canvas.clientWidth * factor), height = Math.round(canvas.clientHeight * factor);
    if (!width || !height) return;
    Object.assign(canvas, { width, height });
    const image = context.createImageData(width, height), pixels = image.data;
    const nearest = new Float32Array(width * height).fill(Infinity);
    const scale = zoom * data.scale * width, [middleX, middleY] = [data.middle[0] * width, data.middle[1] * height];
    const seen = new Float32Array(places.length);
    for (let at = 0; at < places.length; at += 3) {
        for (let axis = 0; axis < 3; axis++) {
            const row = turned[axis];
            seen[at + axis] = row[0] * places[at] + row[1] * places[at + 1] + row[2] * places[at + 2];
        }
        seen[at] = seen[at] * scale + middleX;
        seen[at + 1] = seen[at + 1] * scale + middleY;
        seen[at + 2] *= scale;
    }
    for (let at = 0; at < faces.length; at += 3) {
        const [a, b, c] = [3 * faces[at], 3 * faces[at + 1], 3 * faces[at + 2]];
        const [x, y, z] = [seen[a], seen[a + 1], seen[a + 2]];
        const [ux, uy, uz] = [seen[b] - x, seen[b + 1] - y, seen[b + 2] - z];
        const [vx, vy, vz] = [seen[c] - x, seen[c + 1] - y, seen[c + 2] - z];
        const area = ux * vy - uy * vx;
        if (!area) continue;
        const facing = Math.abs(area) / Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, area);
        const shade = (AMBIENT + (1 - AMBIENT) * facing) / 3;
        const rgb = [0, 1, 2].map((part) => (colours[a + part] + colours[b + part] + colours[c + part]) * shade);
        const left = Math.max(0, Math.ceil(x + Math.min(0, ux, vx))), right = Math.min(width - 1, x + Math.max(0, ux, vx));
        const top = Math.max(0, Math.ceil(y + Math.min(0, uy, vy))), bottom = Math.min(height - 1, y + Math.max(0, uy, vy));
        for (let row = top; row <= bottom; row++) {
            for (let column = left; column <= right; column++) {
                const [dx, dy] = [column - x, row - y];
                const second = (dx * vy - dy * vx) / area, third = (ux * dy - uy * dx) / area;
                if (second < 0 || third < 0 || second + third > 1) continue;
                const depth = z + second * uz + third * vz, pixel = row * width + column;
                if (depth >= nearest[pixel]) continue;
                nearest[pixel] = depth;
                pixels.set([...rgb, 255], 4 * pixel);
            }
        }
    }
    context.putImageData(image, 0, 0);
}

function repaint() {
    if (!wanted) requestAnimationFrame(paint);
    wanted = true;
}

/** Turn about the upright and about the level axis of the screen, to the right and downwards. */
function turn(right, down) {
    const mixed = (one, other, angle) => [[Math.cos(angle), -Math.sin(angle)], [Math.sin(angle), Math.cos(angle)]].map(
        ([p, q]) => one.map((value, at) => p * value + q * other[at]));
    let [x, y, z] = turned;
    [x, z] = mixed(x, z, right);
    [y, z] = mixed(y, z, down);
    turned = [x, y, z];
    repaint();
}

function larger(by) {
    zoom = Math.min(Math.max(zoom * by, 0.2), 30);
    repaint();
}

function reset() {
    [turned, zoom] = [data.turned, 1];
    repaint();
}

canvas.style.touchAction = 'none';
canvas.addEventListener('pointerdown', (event) => canvas.setPointerCapture(event.pointerId));
canvas.addEventListener('pointermove', (event) => {
    if (event.buttons) turn(TURN_RAD * event.movementX, TURN_RAD * event.movementY);
});
canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    larger(ZOOM ** -Math.sign(event.deltaY));
}, { passive: false });
canvas.addEventListener('keydown', (event) => {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (turns) turn(...turns.map((value) => KEY_RAD * value));
    else if (event.key === '+' || event.key === '=') larger(ZOOM);
    else if (event.key === '-') larger(1 / ZOOM);
    else return;
    event.preventDefault();
});
byId('reset').addEventListener('click', reset);
byId('frame').src = webp(data.frame);
for (const stage of document.querySelectorAll('.model')) stage.style.setProperty('--aspect', data.aspect);
byId('deviation-scale').append(scaleBar(`−${data.most} mm`, `+${data.most} mm`, data.scaleColours));
reset();
new ResizeObserver(repaint).observe(canvas);
document.documentElement.dataset.ready = 'true';
