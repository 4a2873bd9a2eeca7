// The page of a dataset: one view is selected; grid, large picture and poses follow it.

const views = data.views;
const state = { place: -1, order: [], layers: { mask: false, observed: false, depth: false }, strength: 0.7 };
document.documentElement.style.setProperty('--aspect', data.size[0] / data.size[1]);

const nameOf = (view) => `View ${view.index}`;
const factsOf = (view) => data.quantities.filter(({ key }) => Number.isFinite(view[key])).map(
    (quantity) => `${quantity.name.toLowerCase()} ${measured(view[quantity.key], quantity.digits, quantity.unit)}`);

// --- the large picture ------------------------------------------------------------------------------------------------

const picture = byId('picture'), overlay = byId('overlay'), missing = byId('missing'), readout = byId('readout');
const number = byId('number');
number.max = views.length ? views[views.length - 1].index : 0;
number.min = views.length ? views[0].index : 0;

function select(place, { focus = false, scroll = false } = {}) {
    if (!views[place]) return;
    const before = tiles[state.place];
    if (before) {
        before.button.tabIndex = -1;
        before.button.removeAttribute('aria-current');
    }
    state.place = place;
    const view = views[place], tile = tiles[place];
    tile.button.tabIndex = 0;
    tile.button.setAttribute('aria-current', 'true');
    if (focus) tile.button.focus({ preventScroll: false });
    picture.hidden = !view.picture;
    if (view.picture) picture.src = webp(view.picture);
    picture.alt = `${nameOf(view)}: the surface from a novel pose; ${factsOf(view).join(', ')}`;
    missing.hidden = Boolean(view.picture);
    missing.textContent = view.problems[0] || 'this view has no picture';
    number.value = view.index;
    byId('facts').replaceChildren(...data.quantities.map((quantity) => el('div', { title: quantity.about },
        el('dt', { text: quantity.name }), el('dd', { text: measured(view[quantity.key], quantity.digits, quantity.unit) }))));
    byId('file').textContent = view.file;
    byId('problems').replaceChildren(...view.problems.map((text) => el('li', { text })));
    byId('live').textContent = `${nameOf(view)}: ${factsOf(view).join(', ')}`;
    drawOverlay();
    for (const { quantity, histogram } of histograms) histogram.mark(view[quantity.key]);
    poses.select(place);
    if (scroll) byId('viewer').scrollIntoView({ block: 'start', behavior: calm() ? 'auto' : 'smooth' });
}

function step(by) {
    const at = state.order.indexOf(state.place);
    if (!state.order.length) return;
    const next = at < 0 ? 0 : (at + by + state.order.length) % state.order.length;
    select(state.order[next], { focus: grid.contains(document.activeElement) });
}

function drawOverlay() {
    const view = views[state.place];
    if (!view) return;
    drawLayers(overlay, view, state.layers, state.strength);
    const range = byId('range');
    range.replaceChildren();
    if (state.layers.depth && view.range) {
        range.append('Depth', scaleBar(measured(view.range[1], 1), measured(view.range[0], 1, ' mm')));
    }
    if (state.layers.observed) {
        range.append(el('span', { class: 'key seen', text: 'seen by the frame' }), el('span', { class: 'key unseen', text: 'not seen' }));
    }
    if (state.layers.mask && !state.layers.observed) range.append(el('span', { class: 'key mask', text: 'surface' }));
}

byId('stage').addEventListener('pointermove', async (event) => {
    const view = views[state.place], box = byId('stage').getBoundingClientRect();
    if (!view) return;
    const found = await layersAt(view, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    readout.hidden = !found;
    if (!found) return;
    readout.textContent = !found.surface ? 'no surface'
        : `${found.depth === null ? 'surface' : `≈ ${found.depth.toFixed(1)} mm`} · ${found.seen ? 'seen' : 'not seen'}`;
});
byId('stage').addEventListener('pointerleave', () => { readout.hidden = true; });
byId('previous').addEventListener('click', () => step(-1));
byId('next').addEventListener('click', () => step(1));
number.addEventListener('change', () => {
    // of a sample, the nearest one
    const wanted = number.valueAsNumber;
    if (!Number.isFinite(wanted) || !views.length) return;
    const off = views.map((view) => Math.abs(view.index - wanted));
    select(off.indexOf(Math.min(...off)));
});

const layerButtons = Object.fromEntries(Object.keys(state.layers).map((name) => [name, byId(`layer-${name}`)]));
for (const [name, button] of Object.entries(layerButtons)) button.addEventListener('click', () => toggleLayer(name));
byId('strength').addEventListener('input', (event) => {
    state.strength = event.target.valueAsNumber;
    drawOverlay();
    redrawTiles();
});

function toggleLayer(name) {
    state.layers[name] = !state.layers[name];
    layerButtons[name].setAttribute('aria-pressed', state.layers[name]);
    byId('strength').disabled = !Object.values(state.layers).some(Boolean);
    drawOverlay();
    redrawTiles();
}

document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    const columns = grid.contains(document.activeElement) ? columnCount() : 0;
    const action = {
        ArrowLeft: () => step(-1), ArrowRight: () => step(1),
        ...(columns ? { ArrowUp: () => step(-columns), ArrowDown: () => step(columns) } : {}),
        m: () => toggleLayer('mask'), o: () => toggleLayer('observed'), d: () => toggleLayer('depth'),
    }[event.key];
    if (!action) return;
    event.preventDefault();
    action();
});

// --- the grid -----------------------------------------------------------------------------------------------------------

const grid = byId('grid'), TILE_PX = 240;
const tiles = views.map((view, place) => {
    const image = el('img', { alt: '', decoding: 'async', hidden: true });
    const canvas = el('canvas', { hidden: true });
    const button = el('button', {
        type: 'button', tabindex: -1, 'aria-label': [nameOf(view), ...factsOf(view), ...(view.picture ? [] : ['missing'])].join(', '),
        click: () => select(place, { scroll: true }),
    }, image, canvas, el('span', { class: view.problems.length ? 'number bad' : 'number', text: view.index }),
    view.picture ? null : el('span', { class: 'absent', text: 'missing' }));
    return { item: el('li', {}, button), button, image, canvas, shown: false };
});
const placeOf = new Map(tiles.map((tile, place) => [tile.item, place]));
const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
        const place = placeOf.get(target), tile = tiles[place], view = views[place];
        tile.shown = isIntersecting;
        tile.image.hidden = !(isIntersecting && view.picture);
        // pictures far away are given back
        if (!isIntersecting) tile.image.removeAttribute('src');
        else if (view.picture) tile.image.src = webp(view.picture);
        if (isIntersecting) drawLayers(tile.canvas, view, state.layers, state.strength, TILE_PX);
        else tile.canvas.hidden = true;
    }
}, { rootMargin: '300px' });
for (const { item } of tiles) watcher.observe(item);

function redrawTiles() {
    tiles.forEach((tile, place) => {
        if (tile.shown) drawLayers(tile.canvas, views[place], state.layers, state.strength, TILE_PX);
    });
}

function columnCount() {
    const top = (place) => tiles[place].item.offsetTop;
    let count = 0;
    while (count < state.order.length && top(state.order[count]) === top(state.order[0])) count++;
    return Math.max(1, count);
}

// --- filters and order ----------------------------------------------------------------------------------------------------

const histograms = data.quantities.map((quantity) => ({
    quantity, histogram: createHistogram(quantity, views.map((view) => view[quantity.key] ?? null), arrange),
}));
byId('histograms').append(...histograms.map(({ histogram }) => histogram.element));
const sortBy = byId('sort'), descending = byId('descending');
for (const { key, name } of data.quantities) {
    sortBy.append(el('option', { value: key, text: name }));
}
sortBy.addEventListener('change', arrange);
descending.addEventListener('click', () => {
    const down = descending.getAttribute('aria-pressed') !== 'true';
    descending.setAttribute('aria-pressed', down);
    descending.textContent = down ? '↓' : '↑';
    arrange();
});
byId('reset').addEventListener('click', () => {
    for (const { histogram } of histograms) histogram.reset();
    arrange();
});

function arrange() {
    const passing = views.map((_, place) => place).filter((place) => histograms.every(
        ({ quantity, histogram }) => histogram.holds(views[place][quantity.key])));
    const key = sortBy.value, sign = descending.getAttribute('aria-pressed') === 'true' ? -1 : 1;
    state.order = passing.sort((one, other) => {
        const [a, b] = [views[one][key], views[other][key]];
        if (!Number.isFinite(a) || !Number.isFinite(b)) return Number.isFinite(b) - Number.isFinite(a) || one - other;
        return sign * (a - b) || one - other;
    });
    grid.replaceChildren(...state.order.map((place) => tiles[place].item));
    byId('count').textContent = passing.length === views.length
        ? `${views.length} views` : `${passing.length} of ${views.length} views`;
    byId('reset').hidden = passing.length === views.length;
    byId('none').hidden = passing.length > 0;
    for (const { quantity, histogram } of histograms) {
        histogram.showPassing(state.order.map((place) => views[place][quantity.key]));
    }
    poses.filter(new Set(passing));
}

// --- poses ----------------------------------------------------------------------------------------------------------------

const describe = (view) => [nameOf(view), ...factsOf(view)].join(' · ');
const poses = createPoses(byId('scene'), views, describe, (place) => select(place));
themeListeners.push(drawOverlay, redrawTiles);

// --- the source frame -------------------------------------------------------------------------------------------------------

const { pictures, note } = data.frames;
if (pictures.length) {
    const slider = createSlider('Frame to overlay');
    const sides = pictures.map((entry) => ({
        ...entry, alt: entry.name === 'Frame' ? 'The source frame' : 'The source frame with structures and the outline of the surface',
    }));
    slider.show(sides[0], sides[1]);
    byId('frame').append(slider.element, el('p', { class: 'muted', text: note }));
} else {
    byId('frame').append(el('p', { class: 'muted', text: 'Neither the frame nor its overlay can be shown.' }));
}

arrange();
if (views.length) select(state.order[0] ?? 0);
else byId('missing').textContent = 'This dataset has no views.';
document.documentElement.dataset.ready = 'true';
