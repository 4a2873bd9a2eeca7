// The page of a registration: one frame is selected; time line, picture and poses follow it.

const frames = data.views;
const figures = data.quantities.filter(({ colours }) => !colours);
const inWords = (frame) => `frame ${frame.index}, ${frame.state}: ${frame.reason}`;
document.documentElement.style.setProperty('--aspect', data.size[0] / data.size[1]);
for (const [state, rgb] of Object.entries(data.colours)) document.documentElement.style.setProperty(`--${state}`, `rgb(${rgb})`);

// --- the time line ----------------------------------------------------------------------------------------------------

const HEIGHT = 100, STRIP = 16;
const bar = (frame, place, y, height) => svg('rect', { class: frame.state, x: place, width: 1, y, height });
byId('line').setAttribute('viewBox', `0 0 ${frames.length} ${HEIGHT + STRIP}`);
byId('line').append(...frames.flatMap((frame, place) => [
    bar(frame, place, HEIGHT * (1 - frame.probability), HEIGHT * frame.probability), bar(frame, place, HEIGHT + 3, STRIP - 3)]));
// lies over the time line, its thumb is the needle
const range = byId('at');
range.max = frames.length;
range.addEventListener('input', () => select(Math.min(Math.floor(range.valueAsNumber), frames.length - 1)));
for (const [state, count] of Object.entries(data.counts)) byId('states').append(el('span', { class: `key ${state}`, text: `${count} ${state}` }));


byId('next-lost').hidden = !data.lost.length;
byId('next-lost').addEventListener('click', () => select((data.lost.find(([place]) => place > at) ?? data.lost[0])[0]));
byId('previous').addEventListener('click', () => select(at - 1));
byId('next').addEventListener('click', () => select(at + 1));
document.addEventListener('keydown', (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === 'SELECT') return;
    event.preventDefault();
    select(at + step);
});

// --- the frame ----------------------------------------------------------------------------------------------------------

let at = -1;

function select(place, { scroll = false } = {}) {
    const frame = frames[place];
    if (!frame) return;
    at = place;
    range.value = place + 0.5;
    range.setAttribute('aria-valuetext', inWords(frame));
    byId('number').textContent = frame.index;
    byId('state').replaceChildren(el('span', { class: `key ${frame.state}`, text: frame.state }));
    byId('reason').textContent = frame.reason;
    const picture = byId('picture');
    picture.hidden = !frame.picture;
    byId('missing').hidden = Boolean(frame.picture);
    if (frame.picture) picture.src = webp(frame.picture);
    picture.alt = `${inWords(frame)}; the frame${frame.centre ? ' with the surface and the structures at its pose' : ''}`;
    byId('facts').replaceChildren(...figures.map((quantity) => el('div', { title: quantity.about },
        el('dt', { text: quantity.name }), el('dd', { text: measured(frame[quantity.key], quantity.digits, quantity.unit) }))));
    byId('live').textContent = inWords(frame);
    poses.select(place);
    if (scroll) byId('viewer').scrollIntoView({ block: 'start', behavior: calm() ? 'auto' : 'smooth' });
}

const poses = createPoses(byId('scene'), frames, inWords, (place) => select(place));

// --- what to look at first ------------------------------------------------------------------------------------------------

const WORST = 12;
const longest = [...data.lost].sort(([first, last], [from, to]) => to - from - (last - first));
const accepted = frames.map((frame, place) => [frame, place]).filter(([{ state }]) => state === 'accepted')
    .sort(([one], [other]) => one.probability - other.probability || other.image_px - one.image_px).map(([, place]) => [place, place]);
const thumbnail = ({ place }) => el('button', {
    type: 'button', 'aria-label': `Show frame ${frames[place].index}`, click: () => select(place, { scroll: true }),
}, frames[place].picture ? el('img', { alt: '', src: webp(frames[place].picture), loading: 'lazy' }) : el('span', { text: 'show' }));
byId('worst-table').append(createTable({
    caption: 'Look at first',
    columns: [{ key: 'picture', name: 'Frame', shown: thumbnail }, { key: 'numbers', name: 'Number' },
        { key: 'state', name: 'State', shown: ({ state }) => el('span', { class: `key ${state}`, text: state }) }, { key: 'reason', name: 'Reason' },
        ...figures.map((quantity) => ({ ...quantity, name: [quantity.name, quantity.unit.trim()].filter(Boolean).join(', '), title: quantity.about, number: true }))],
    rows: [...longest, ...accepted].slice(0, WORST).map(([place, last]) => ({
        ...frames[place], place,
        numbers: place === last ? `${frames[place].index}` : `${frames[place].index}–${frames[last].index}`,
    })),
}));

select((longest[0] ?? [0])[0]);
document.documentElement.dataset.ready = 'true';
