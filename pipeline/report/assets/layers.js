// Masks and depth over a view's colours. One small picture holds them: depth in its colour, the masks in its alpha.

const SEEN = 255, NO_SURFACE = 251;
const decodedLayers = new Map();
const MOST_DECODED = 60;

/** The layers of a view: {width, height, levels, kinds}, kinds being 0 no surface, 1 not seen, 2 seen; or null. */
function decodeLayers(view) {
    if (!view.layers) return Promise.resolve(null);
    if (!decodedLayers.has(view.index)) {
        if (decodedLayers.size >= MOST_DECODED) decodedLayers.delete(decodedLayers.keys().next().value);
        decodedLayers.set(view.index, new Promise((resolve) => {
            const image = new Image();
            image.onload = () => {
                const [width, height] = [image.naturalWidth, image.naturalHeight];
                const context = el('canvas', { width, height }).getContext('2d', { willReadFrequently: true });
                context.drawImage(image, 0, 0);
                const codes = context.getImageData(0, 0, width, height).data;
                const [levels, kinds] = [new Uint8Array(width * height), new Uint8Array(width * height)];
                for (let place = 0; place < levels.length; place++) {
                    const alpha = codes[4 * place + 3];
                    levels[place] = codes[4 * place];
                    kinds[place] = alpha >= SEEN - 1 ? 2 : alpha > NO_SURFACE ? 1 : 0;
                }
                resolve({ width, height, levels, kinds });
            };
            image.onerror = () => resolve(null);
            image.src = webp(view.layers);
        }));
    }
    return decodedLayers.get(view.index);
}

/**
 * Draw the chosen layers ({mask, observed, depth}, strength 0..1) into a canvas; hides it if there is nothing. Pixels are
 * left out for a canvas of less than `most` px.
 */
async function drawLayers(canvas, view, chosen, strength, most = Infinity) {
    const wanted = `${view.index} ${chosen.mask} ${chosen.observed} ${chosen.depth} ${strength}`;
    canvas.dataset.wanted = wanted;
    canvas.hidden = true;
    if (!(chosen.mask || chosen.observed || chosen.depth)) return;
    const source = await decodeLayers(view);
    // what was chosen meanwhile counts
    if (!source || canvas.dataset.wanted !== wanted) return;
    const step = Math.max(1, Math.ceil(source.width / most));
    const [width, height] = [Math.ceil(source.width / step), Math.ceil(source.height / step)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext('2d');
    const drawn = context.createImageData(width, height);
    const pixels = drawn.data;
    const tints = tintTable(chosen, strength);
    const [red, green, blue] = rgbOf(colour('ours'));
    const reach = Math.max(1, Math.round(source.width / 480)) * step;
    for (let y = 0, at = 0; y < height; y++) {
        for (let x = 0; x < width; x++, at += 4) {
            const place = y * step * source.width + x * step;
            const kind = source.kinds[place];
            if (!kind) continue;
            if (chosen.mask && isBorder(source, x * step, y * step, reach)) {
                pixels[at] = red;
                pixels[at + 1] = green;
                pixels[at + 2] = blue;
                pixels[at + 3] = 255;
                continue;
            }
            const entry = 4 * (256 * (kind - 1) + source.levels[place]);
            pixels[at] = tints[entry];
            pixels[at + 1] = tints[entry + 1];
            pixels[at + 2] = tints[entry + 2];
            pixels[at + 3] = tints[entry + 3];
        }
    }
    context.putImageData(drawn, 0, 0);
    canvas.hidden = false;
}

/** Whether a pixel of the surface lies beside one without; not at the edge of the image, where the surface goes on. */
function isBorder({ width, height, kinds }, x, y, reach) {
    const place = y * width + x;
    return (x >= reach && !kinds[place - reach]) || (x + reach < width && !kinds[place + reach])
        || (y >= reach && !kinds[place - reach * width]) || (y + reach < height && !kinds[place + reach * width]);
}

/** [r, g, b, alpha] for every kind of surface and level of depth. */
function tintTable(chosen, strength) {
    const table = new Uint8ClampedArray(4 * 512);
    const [outline, seen, unseen] = ['ours', 'peer', 'warning'].map((name) => rgbOf(colour(name)));
    for (let entry = 0; entry < 512; entry++) {
        const kind = entry < 256 ? 1 : 2;
        let rgb = outline, alpha = chosen.mask ? strength * 0.6 : 0;
        if (chosen.depth) [rgb, alpha] = [scaleColour(1 - (entry % 256) / 255), strength];
        if (chosen.observed) {
            const tint = kind === 2 ? seen : unseen;
            // most is seen: what is not stands out
            const over = (chosen.depth ? 0.5 : strength) * (kind === 2 ? 0.5 : 0.85);
            [rgb, alpha] = chosen.depth
                ? [rgb.map((value, part) => value + over * (tint[part] - value)), Math.max(alpha, over)] : [tint, over];
        }
        table.set([...rgb, Math.round(255 * alpha)], 4 * entry);
    }
    return table;
}

/** What the layers say at a point of the picture, given as shares 0..1 of its sides. */
async function layersAt(view, across, down) {
    const source = await decodeLayers(view);
    if (!source) return null;
    const x = Math.min(source.width - 1, Math.max(0, Math.floor(across * source.width)));
    const y = Math.min(source.height - 1, Math.max(0, Math.floor(down * source.height)));
    const place = y * source.width + x, kind = source.kinds[place];
    const depth = kind && view.range ? view.range[0] + source.levels[place] / 255 * (view.range[1] - view.range[0]) : null;
    return { surface: kind > 0, seen: kind === 2, depth };
}

function rgbOf(code) {
    return [1, 3, 5].map((at) => parseInt(code.slice(at, at + 2), 16));
}
