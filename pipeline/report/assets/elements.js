// What all scripts of a page share: its data, making elements, the theme.

const data = JSON.parse(document.getElementById('data').textContent);

/** An element; attributes that are functions listen to events, `text` is its text. */
function el(name, attributes = {}, ...children) {
    return filled(document.createElement(name), attributes, children);
}

function svg(name, attributes = {}, ...children) {
    return filled(document.createElementNS('http://www.w3.org/2000/svg', name), attributes, children);
}

function filled(element, attributes, children) {
    for (const [key, value] of Object.entries(attributes)) {
        if (typeof value === 'function') element.addEventListener(key, value);
        else if (key === 'text') element.textContent = value;
        else if (value === true) element.setAttribute(key, '');
        else if (value !== false && value !== null && value !== undefined) element.setAttribute(key, value);
    }
    element.append(...children.filter((child) => child !== null && child !== undefined));
    return element;
}

const byId = (id) => document.getElementById(id);
const webp = (text) => (text ? `data:image/webp;base64,${text}` : null);

/** A number with its unit: "12.3°"; "–" if there is none. */
function measured(value, digits, unit = '') {
    return Number.isFinite(value) ? value.toFixed(digits) + unit : '–';
}

/** The value of a colour of the theme. */
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const calm = () => matchMedia('(prefers-reduced-motion: reduce)').matches;

// --- light and dark -------------------------------------------------------------------------------------------------

const themeListeners = [];
const systemDark = matchMedia('(prefers-color-scheme: dark)');

function isDark() {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === 'dark' : systemDark.matches;
}

function changedTheme() {
    for (const listener of themeListeners) listener();
}

try {
    const kept = localStorage.getItem('oneframe-theme');
    if (kept === 'light' || kept === 'dark') document.documentElement.dataset.theme = kept;
} catch { /* a browser that keeps nothing for files */ }
byId('theme').addEventListener('click', () => {
    document.documentElement.dataset.theme = isDark() ? 'light' : 'dark';
    try { localStorage.setItem('oneframe-theme', document.documentElement.dataset.theme); } catch { /* as above */ }
    changedTheme();
});
systemDark.addEventListener('change', changedTheme);

// --- colour scale ---------------------------------------------------------------------------------------------------

// viridis (Smith and van der Walt, CC0), nine of its 256 colours
const SCALE = ['440154', '472d7b', '3b528b', '2c728e', '21918c', '28ae80', '5ec962', 'addc30', 'fde725'].map(
    (code) => [0, 2, 4].map((at) => parseInt(code.slice(at, at + 2), 16)));

/** [r, g, b] 0..255 for a share 0..1. */
function scaleColour(share) {
    const place = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
    const low = Math.min(Math.floor(place), SCALE.length - 2);
    return SCALE[low].map((value, part) => Math.round(value + (place - low) * (SCALE[low + 1][part] - value)));
}

/** A bar of the scale, or of other colours, with the values at its ends. */
function scaleBar(least, most, scale = SCALE) {
    const stops = scale.map((rgb, place) => svg('stop', {
        offset: place / (scale.length - 1), 'stop-color': `rgb(${rgb})`,
    }));
    scaleBar.count = (scaleBar.count || 0) + 1;
    const id = `scale-${scaleBar.count}`;
    const bar = svg('svg', { class: 'scale', viewBox: '0 0 100 8', preserveAspectRatio: 'none', 'aria-hidden': 'true' },
        svg('linearGradient', { id }, ...stops), svg('rect', { width: 100, height: 8, rx: 1, fill: `url(#${id})` }));
    return el('span', { class: 'scale-bar' }, el('span', { text: least }), bar, el('span', { text: most }));
}
