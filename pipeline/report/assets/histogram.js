// A small distribution with two handles that choose a range of it.

const BINS = 24;

/** `values` has null where there is none; calls `changed()` when the user moves a handle. */
function createHistogram(quantity, values, changed) {
    const known = values.filter(Number.isFinite);
    let low = Math.min(...known), high = Math.max(...known);
    if (!known.length) low = high = 0;
    // the handles count whole steps of the last digit that is shown
    const unit = 10 ** -quantity.digits, first = Math.floor(low / unit + 1e-6);
    const steps = Math.max(1, Math.ceil(high / unit - 1e-6) - first);
    [low, high] = [first * unit, (first + steps) * unit];
    const valueOf = (input) => (first + input.valueAsNumber) * unit;
    const binOf = (value) => Math.min(BINS - 1, Math.max(0, Math.floor((value - low) / (high - low) * BINS)));
    const totals = new Array(BINS).fill(0);
    for (const value of known) totals[binOf(value)] += 1;
    const tallest = Math.max(1, ...totals);

    const bars = (kind) => totals.map((_, bin) => svg('rect', {
        class: kind, x: bin * 100 / BINS + 0.35, width: 100 / BINS - 0.7, y: 40, height: 0,
    }));
    const all = bars('all'), passing = bars('passing');
    const needle = svg('line', { class: 'needle', y1: 0, y2: 40, visibility: 'hidden' });
    const picture = svg('svg', { viewBox: '0 0 100 40', preserveAspectRatio: 'none', 'aria-hidden': 'true' },
        ...all, ...passing, needle);
    const setBar = (bar, count) => {
        const height = count ? Math.max(1, 38 * count / tallest) : 0;
        bar.setAttribute('y', 40 - height);
        bar.setAttribute('height', height);
    };
    all.forEach((bar, bin) => setBar(bar, totals[bin]));

    const handle = (name, value) => el('input', {
        type: 'range', min: 0, max: steps, step: 1, value, 'aria-label': `${quantity.name}, ${name}`,
        input: (event) => { keepOrder(event.target); describe(); changed(); },
    });
    const least = handle('least', 0), most = handle('most', steps);
    const readout = el('output');

    function keepOrder(moved) {
        if (least.valueAsNumber <= most.valueAsNumber) return;
        if (moved === least) least.value = most.value;
        else most.value = least.value;
    }

    function describe() {
        readout.textContent = known.length
            ? `${measured(valueOf(least), quantity.digits)} – ${measured(valueOf(most), quantity.digits, quantity.unit)}`
            : 'unknown';
        for (const input of [least, most]) {
            input.setAttribute('aria-valuetext', measured(valueOf(input), quantity.digits, quantity.unit));
        }
        element.classList.toggle('narrowed', isNarrowed());
    }

    const isNarrowed = () => least.valueAsNumber > 0 || most.valueAsNumber < steps;
    const element = el('div', { class: 'histogram' },
        el('div', { class: 'head' }, el('h3', { text: quantity.name, title: quantity.about }), readout),
        el('div', { class: 'plot' }, picture, el('div', { class: 'handles' }, least, most)));
    if (!known.length) least.disabled = most.disabled = true;
    describe();

    return {
        element,
        /** Whether a value lies in the chosen range; an unknown one does as long as all do. */
        holds: (value) => (Number.isFinite(value)
            ? value >= valueOf(least) - 1e-6 * unit && value <= valueOf(most) + 1e-6 * unit : !isNarrowed()),
        /** Show how many of each bin pass all filters. */
        showPassing(selected) {
            const counts = new Array(BINS).fill(0);
            for (const value of selected) if (Number.isFinite(value)) counts[binOf(value)] += 1;
            passing.forEach((bar, bin) => setBar(bar, counts[bin]));
        },
        /** Mark one value. */
        mark(value) {
            needle.setAttribute('visibility', Number.isFinite(value) ? 'visible' : 'hidden');
            if (!Number.isFinite(value)) return;
            const x = Math.min(99.4, Math.max(0.6, 100 * (value - low) / (high - low)));
            needle.setAttribute('x1', x);
            needle.setAttribute('x2', x);
        },
        reset() {
            least.value = 0;
            most.value = steps;
            describe();
        },
    };
}
