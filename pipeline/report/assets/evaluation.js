// The page of an evaluation: one photograph is selected; pictures and its scores follow it.

const text = (value) => (typeof value === 'string' ? value : '');
const keyOf = (...parts) => JSON.stringify(parts);
const methods = data.methods.map((method) => text(method.name));
const peers = new Set(data.methods.filter(({ peer }) => peer).map(({ name }) => name));

// --- scores -----------------------------------------------------------------------------------------------------------

const WORDS = { ssim: 'SSIM', psnr: 'PSNR', fid: 'FID', kid: 'KID', lpips: 'LPIPS', px: 'px', db: 'dB', mm: 'mm', f: 'F' };
const nameOfScore = (score) => {
    const words = score.split('_').map((word) => WORDS[word] || word);
    return (words[0][0].toUpperCase() + words[0].slice(1)) + (words.length > 1 ? ` ${words.slice(1).join(' ')}` : '');
};
const isHigherBetter = (score) => /^(ssim|psnr|correlation|gradient_correlation|edge_f|iou|overlap)/.test(score);
const isLowerBetter = (score) => /^(error|flow|edge_px|fid|kid|lpips|rmse|mae|residual)/.test(score);
const direction = (score) => (isHigherBetter(score) ? 'higher is better' : isLowerBetter(score) ? 'lower is better' : '');
const scores = [...new Set([...data.rows.flatMap(Object.keys), ...data.summary.map(({ score }) => text(score))])].filter(
    (key) => key && !['case', 'image', 'method'].includes(key)
        && [...data.rows.map((row) => row[key])].concat(data.summary.filter(({ score }) => score === key).map(({ mean }) => mean)).some(Number.isFinite));
const PREFERRED = ['ssim_whole', 'ssim_surface', 'ssim_observed', 'psnr_observed', 'error_observed', 'ssim_aligned', 'flow_px', 'edge_f'];
const main = PREFERRED.filter((score) => scores.includes(score));
const mainScores = main.length > 2 ? main : scores.slice(0, 8);
// as many as fit beside the pictures
const FRAME_SCORES = 6;
const digitsOf = (score) => {
    const values = [...data.rows.map((row) => row[score]), ...data.summary.filter((row) => row.score === score).map(({ mean }) => mean)];
    const most = Math.max(0, ...values.filter(Number.isFinite).map(Math.abs));
    return most < 2 ? 3 : most < 100 ? 2 : 0;
};
const column = (score) => ({
    key: score, name: nameOfScore(score), title: [text(data.meanings[score]), direction(score)].filter(Boolean).join('; '), digits: digitsOf(score), number: true,
});

/** Whether a value is as good as the best, as far as both are shown. */
const isBest = (value, best, score) => Number.isFinite(value) && Number.isFinite(best)
    && value.toFixed(digitsOf(score)) === best.toFixed(digitsOf(score));

/** For each score the best value among rows. */
function bestOf(rows) {
    return Object.fromEntries(scores.filter((score) => direction(score)).map((score) => {
        const values = rows.map((row) => row[score]).filter(Number.isFinite);
        return [score, isHigherBetter(score) ? Math.max(...values) : Math.min(...values)];
    }));
}

// --- pictures -----------------------------------------------------------------------------------------------------------

const frames = [];
const pictures = new Map();
for (const entry of data.pictures) {
    const key = keyOf(entry.case, entry.image);
    if (!pictures.has(key)) {
        pictures.set(key, new Map());
        frames.push({ key, case: text(entry.case), image: text(entry.image), entry });
    }
    pictures.get(key).set(text(entry.method), entry);
}
const shown = { frame: null };
const slider = createSlider('Left to right picture');
const left = byId('left'), right = byId('right');
byId('compare').append(slider.element);
const methodsShown = [...new Set([...methods, ...data.pictures.map(({ method }) => text(method))])].filter(
    (method) => data.pictures.some((entry) => entry.method === method));
for (const choice of [left, right]) {
    choice.append(el('option', { value: keyOf('real'), text: 'Photograph' }), el('option', { value: keyOf('segmented'), text: 'Photograph, segmented' }));
    for (const [part, title] of [['rendered', 'Rendered'], ['difference', 'Difference']]) {
        choice.append(el('optgroup', { label: title }, ...methodsShown.map((method) => el('option', {
            value: keyOf(part, method), text: `${title}: ${method}`,
        }))));
    }
    choice.addEventListener('change', showPictures);
}
left.value = keyOf('segmented');
right.value = methodsShown.length ? keyOf('rendered', methodsShown[0]) : keyOf('real');

function pictureOf(choice) {
    const [part, method] = JSON.parse(choice.value);
    const entries = pictures.get(shown.frame.key);
    const entry = method === undefined ? entries.values().next().value : entries.get(method);
    const name = choice.selectedOptions[0].textContent;
    const file = entry && data.files[entry[part]];
    return file ? { ...file, name, alt: `${shown.frame.case}, ${shown.frame.image}: ${name}` } : null;
}

function showPictures() {
    if (!shown.frame) return;
    const [first, second] = [pictureOf(left), pictureOf(right)];
    slider.show(first, second);
    byId('lost').hidden = Boolean(first && second);
}

const strip = byId('strip');
const buttons = frames.map((frame, place) => {
    const { uri } = data.files[frame.entry.real] || data.files[frame.entry.segmented] || {};
    const button = el('button', { type: 'button', tabindex: -1, 'aria-label': `${frame.case}, ${frame.image}`, click: () => select(place) },
        uri ? el('img', { alt: '', src: uri, loading: 'lazy', decoding: 'async' }) : el('span', { class: 'absent', text: 'missing' }),
        el('span', { class: 'number', text: frame.image }));
    strip.append(el('li', { 'data-case': frame.case }, button));
    return button;
});
const caseChoice = byId('case');
const caseNames = [...new Set([...data.cases.map(({ name }) => text(name)), ...frames.map((frame) => frame.case)])].filter(Boolean);
for (const name of caseNames) caseChoice.append(el('option', { value: keyOf(name), text: name }));
caseChoice.closest('label').hidden = caseNames.length < 2;
caseChoice.addEventListener('change', () => {
    const wanted = JSON.parse(caseChoice.value)[0];
    const place = frames.findIndex((frame) => frame.case === wanted);
    if (place >= 0) select(place);
});

function select(place, focus = false) {
    const frame = frames[place];
    if (!frame) return;
    shown.frame = frame;
    buttons.forEach((button, number) => {
        button.tabIndex = number === place ? 0 : -1;
        if (number === place) button.setAttribute('aria-current', 'true');
        else button.removeAttribute('aria-current');
        button.parentElement.hidden = frames[number].case !== frame.case;
    });
    if (focus) buttons[place].focus();
    caseChoice.value = keyOf(frame.case);
    byId('frame-name').textContent = frame.image;
    showPictures();
    const rows = data.rows.filter((row) => row.case === frame.case && row.image === frame.image);
    const best = bestOf(rows);
    byId('frame-scores').replaceChildren(...(rows.length ? [createTable({
        caption: `Scores of ${frame.image}`, rows, columns: [{ key: 'method', name: 'Method' }, ...mainScores.slice(0, FRAME_SCORES).map(column)],
        best: (row, key) => rows.length > 1 && isBest(row[key], best[key], key),
    })] : []));
}

function step(by) {
    const own = frames.map((_, place) => place).filter((place) => frames[place].case === shown.frame?.case);
    const at = own.findIndex((place) => frames[place] === shown.frame);
    if (own.length) select(own[(at + by + own.length) % own.length], strip.contains(document.activeElement));
}
byId('previous').addEventListener('click', () => step(-1));
byId('next').addEventListener('click', () => step(1));
document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    step(by);
});
if (frames.length) select(0);
else byId('frames').replaceChildren(el('h2', { text: 'Frames' }), el('p', { class: 'muted', text: 'This evaluation has no pictures.' }));

// --- summary ------------------------------------------------------------------------------------------------------------

const scoreChoice = byId('score'), summaryCase = byId('summary-case');
const summaryScores = scores.filter((score) => data.summary.some((row) => row.score === score));
for (const score of summaryScores) scoreChoice.append(el('option', { value: score, text: nameOfScore(score) }));
const summaryCases = [...new Set(data.summary.map((row) => text(row.case)))].sort((a, b) => (b === 'all') - (a === 'all'));
for (const name of summaryCases) summaryCase.append(el('option', { value: keyOf(name), text: name === 'all' ? 'all cases' : name }));
summaryCase.closest('label').hidden = summaryCases.length < 2;
scoreChoice.value = summaryScores.includes('ssim_observed') ? 'ssim_observed' : summaryScores[0];

function showSummary() {
    const score = scoreChoice.value, chosen = summaryCase.value ? JSON.parse(summaryCase.value)[0] : '';
    const rows = data.summary.filter((row) => row.score === score && row.case === chosen && Number.isFinite(row.mean)).map(
        (row) => ({ ...row, name: text(row.method), peer: peers.has(row.method) }));
    const sign = isLowerBetter(score) ? 1 : -1;
    rows.sort((one, other) => sign * (one.mean - other.mean));
    const bound = data.bound.find((row) => row.score === score && row.case === chosen) || null;
    byId('intervals').replaceChildren(...(rows.length ? [createIntervals(rows, bound, digitsOf(score))] : []));
    byId('meaning').textContent = [text(data.meanings[score]), direction(score), 'lines are 95 % confidence intervals',
        bound ? `the band is the bound that noise and pose error set${Number.isFinite(bound.jitter_px) ? ` (poses off by ${Number(bound.jitter_px.toPrecision(2))} px)` : ''}` : '']
        .filter(Boolean).join(' · ');
    const table = methods.concat(rows.map((row) => row.name)).filter((name, place, all) => all.indexOf(name) === place).map((method) => ({
        method, ...Object.fromEntries(data.summary.filter((row) => row.method === method && row.case === chosen).map((row) => [row.score, row.mean])),
    })).filter((row) => Object.keys(row).length > 1);
    const best = bestOf(table);
    byId('summary-table').replaceChildren(createTable({
        caption: 'Means of all scores', rows: table, columns: [{ key: 'method', name: 'Method' }, ...(byId('all-scores').checked ? summaryScores : mainScores).map(column)],
        best: (row, key) => table.length > 1 && isBest(row[key], best[key], key),
    }));
}
const skipped = data.methods.filter((method) => text(method.skipped));
byId('skipped').append(...skipped.map((method) => el('li', { text: `${text(method.name)} was not measured: ${method.skipped}` })));
if (summaryScores.length) {
    scoreChoice.addEventListener('change', showSummary);
    summaryCase.addEventListener('change', showSummary);
    byId('all-scores').addEventListener('change', () => { showSummary(); showRows(); });
    showSummary();
} else byId('summary').hidden = true;

// --- distribution -------------------------------------------------------------------------------------------------------

if (data.distribution.length) {
    const biased = data.distribution.some((row) => row.fid_biased);
    byId('distribution-table').append(createTable({
        caption: 'FID and KID', rows: data.distribution.map((row) => ({ ...row, biased: row.fid_biased ? 'yes' : 'no' })),
        columns: [{ key: 'method', name: 'Method' }, { key: 'case', name: 'Case' }, { key: 'fid', name: 'FID', title: 'lower is better', digits: 1, number: true },
            ...(biased ? [{ key: 'biased', name: 'FID biased', title: 'too few pictures for an unbiased FID' }] : []),
            { key: 'kid', name: 'KID', title: 'lower is better', digits: 4, number: true },
            { key: 'kid_standard_error', name: '± standard error', digits: 4, number: true }, { key: 'n', name: 'Pictures', digits: 0, number: true }],
    }));
}
byId('distribution').hidden = !data.distribution.length && !byId('distribution').querySelector('p');

// --- all rows, figures ----------------------------------------------------------------------------------------------------

function showRows() {
    byId('all-rows').replaceChildren(createTable({
        caption: 'All photographs', rows: data.rows,
        columns: [{ key: 'image', name: 'Photograph' }, { key: 'case', name: 'Case' }, { key: 'method', name: 'Method' },
            ...(byId('all-scores').checked ? scores : mainScores).map(column)],
    }));
}
showRows();
byId('rows').hidden = !data.rows.length;

for (const { title, uri, width, height } of data.figures) {
    byId('figure-list').append(el('figure', {}, el('figcaption', { text: title }),
        el('img', { src: uri, width, height, alt: title, decoding: 'async' })));
}
byId('figures').hidden = !data.figures.length;
for (const link of document.querySelectorAll('.sections a')) link.hidden = document.querySelector(link.hash)?.hidden ?? true;
document.documentElement.dataset.ready = 'true';
