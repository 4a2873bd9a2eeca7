// Masks and depth over a view's colours. One small picture holds them: depth in its colour, the masks in its alpha.

const SEEN = 255, NO_SURFACE = 251;
const decodedLayers = new Map();
const MOST_DECODED = 60;

/** The layers of a view as ImageData, or null; decoded pictures are kept for a while. */
function decodeLayers(view) {
    if (!view.layers) return Promise.resolve(null);
    if (!decodedLayers.has(view.index)) {
        if (decodedLayers.size >= MOST_DECODED) decodedLayers.delete(decodedLayers.keys().next().value);
        decodedLayers.set(view.index, new Promise((resolve) => {
            const image = new Image();
            image.onload = () => {
                const canvas = el('canvas', { width: image.naturalWidth, height: image.naturalHeight });
                const context = canvas.getContext('2d', { willReadFrequently: true });
                context.drawImage(image, 0, 0);
                resolve(context.getImageData(0, 0, canvas.width, canvas.height));
            };
            image.onerror = () => resolve(null);
            image.src = webp(view.layers);
        }));
    }
    return decodedLayers.get(view.index);
}

const label = (alpha) => (alpha >= SEEN - 1 ? 2 : alpha >= NO_SURFACE + 1 ? 1 : 0);

/** Draw the chosen layers ({mask, observed, depth}, strength 0..1) into a canvas; hides it if there is nothing. */
async function drawLayers(canvas, view, chosen, strength) {
    const none = !(chosen.mask || chosen.observed || chosen.depth);
    canvas.hidden = none;
    if (none) return;
    const source = await decodeLayers(view);
    if (!source) { canvas.hidden = true; return; }
    const [outline, seen, unseen] = ['ours', 'peer', 'warning'].map((name) => rgbOf(colour(name)));
    const { width, height } = source;
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext('2d');
    const drawn = context.createImageData(width, height);
    for (let place = 0; place < width * height; place++) {
        const at = 4 * place, kind = label(source.data[at + 3]);
        let [red, green, blue, alpha] = [0, 0, 0, 0];
        if (kind && chosen.depth) [red, green, blue, alpha] = [...scaleColour(1 - source.data[at] / 255), strength];
        if (kind && chosen.observed) {
            const tint = kind === 2 ? seen : unseen;
            // most is seen: what is not stands out
            const over = (chosen.depth ? 0.5 : strength) * (kind === 2 ? 0.5 : 0.85);
            [red, green, blue] = [red, green, blue].map((value, part) => (
                alpha ? value + over * (tint[part] - value) : tint[part]));
            alpha = Math.max(alpha, over);
        }
        if (chosen.mask) {
            const x = place % width, y = (place - x) / width;
            // inside the image: a surface that reaches its edge has no outline there
            const differs = [[1, 0], [-1, 0], [0, 1], [0, -1], [2, 0], [-2, 0], [0, 2], [0, -2]].some(([dx, dy]) => {
                const u = x + dx, v = y + dy;
                return u >= 0 && v >= 0 && u < width && v < height
                    && !label(source.data[4 * (v * width + u) + 3]);
            });
            if (kind && differs) [red, green, blue, alpha] = [...outline, 1];
            else if (kind && !chosen.depth && !chosen.observed) [red, green, blue, alpha] = [...outline, strength * 0.6];
        }
        drawn.data.set([red, green, blue, Math.round(255 * alpha)], at);
    }
    context.putImageData(drawn, 0, 0);
}

/** What the layers say at a point of the picture, given as shares 0..1 of its sides. */
async function layersAt(view, across, down) {
    const source = await decodeLayers(view);
    if (!source) return null;
    const x = Math.min(source.width - 1, Math.max(0, Math.floor(across * source.width)));
    const y = Math.min(source.height - 1, Math.max(0, Math.floor(down * source.height)));
    const at = 4 * (y * source.width + x), kind = label(source.data[at + 3]);
    const depth = kind && view.range ? view.range[0] + source.data[at] / 255 * (view.range[1] - view.range[0]) : null;
    return { surface: kind > 0, seen: kind === 2, depth };
}

function rgbOf(code) {
    return [1, 3, 5].map((at) => parseInt(code.slice(at, at + 2), 16));
}
