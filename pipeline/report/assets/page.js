// A page of pictures: a grid of all items, and the chosen one large with its figures.
const data = JSON.parse(document.getElementById('data').textContent);
const byId = (id) => document.getElementById(id);
const uri = (picture) => `data:image/webp;base64,${picture}`;
const grid = byId('grid'), picture = byId('picture'), sortBy = byId('sort'), only = byId('only');
let order = [], chosen = -1, layer = 0;

function element(tag, properties, ...children) {
    const made = Object.assign(document.createElement(tag), properties);
    made.append(...children);
    return made;
}

const text = (column, value) => value === undefined || value === null ? '–'
    : typeof value === 'number' ? `${value.toFixed(column.digits)}${column.unit}` : value;

const tiles = data.items.map((item, place) => {
    const image = element('img', { alt: '', loading: 'lazy', hidden: !item.pictures[0] });
    const tile = element('button', { type: 'button', title: item.note || item.name }, image,
        element('span', { className: 'name', textContent: item.name }));
    if (item.state) tile.dataset.state = item.state;
    tile.addEventListener('click', () => choose(place));
    return tile;
});

// pictures are decoded when they come into view
const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
        const item = data.items[tiles.indexOf(target)];
        if (isIntersecting && item.pictures[0]) target.querySelector('img').src = uri(item.pictures[0]);
    }
}, { rootMargin: '300px' });
for (const tile of tiles) watcher.observe(tile);

function choose(place) {
    const item = data.items[place];
    if (!item) return;
    if (tiles[chosen]) tiles[chosen].removeAttribute('aria-current');
    chosen = place;
    tiles[place].setAttribute('aria-current', 'true');
    const shown = item.pictures[Math.min(layer, item.pictures.length - 1)];
    picture.hidden = !shown;
    if (shown) picture.src = uri(shown);
    picture.alt = item.name;
    byId('name').textContent = item.name;
    byId('note').textContent = item.note || '';
    byId('facts').replaceChildren(...data.columns.map((column) => element('div', { title: column.about },
        element('dt', { textContent: column.name }), element('dd', { textContent: text(column, item[column.key]) }))));
}

function step(by) {
    if (order.length) choose(order[(order.indexOf(chosen) + by + order.length) % order.length]);
}

function arrange() {
    const key = sortBy.value, state = only.value;
    order = data.items.map((_, place) => place).filter((place) => !state || data.items[place].state === state);
    const value = (place) => data.items[place][key] ?? Infinity;
    if (key) order.sort((a, b) => value(a) - value(b) || a - b);
    grid.replaceChildren(...order.map((place) => tiles[place]));
    byId('count').textContent = `${order.length} of ${data.items.length}`;
    if (!order.includes(chosen)) choose(order[0]);
}

function nextLayer() {
    layer = (layer + 1) % data.layers.length;
    byId('layer').textContent = data.layers[layer];
    choose(chosen);
}

for (const column of data.columns) {
    if (column.digits !== undefined) sortBy.append(element('option', { value: column.key, textContent: column.name }));
}
for (const state of data.states) only.append(element('option', { value: state, textContent: state }));
only.parentElement.hidden = !data.states.length;
byId('layer').hidden = data.layers.length < 2;
byId('layer').textContent = data.layers[0];
byId('layer').addEventListener('click', nextLayer);
sortBy.addEventListener('change', arrange);
only.addEventListener('change', arrange);
byId('previous').addEventListener('click', () => step(-1));
byId('next').addEventListener('click', () => step(1));
document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT)$/.test(event.target.tagName)) return;
    const action = { ArrowLeft: () => step(-1), ArrowRight: () => step(1), m: nextLayer }[event.key];
    if (!action) return;
    event.preventDefault();
    action();
});
arrange();
document.documentElement.dataset.ready = 'true';
