// Means with their confidence intervals, one line a method.

/** `rows`: {name, peer, mean, low, high, n}; `bound`: {low, mean, high} or null. */
function createIntervals(rows, bound, digits) {
    const ends = [...rows, ...(bound ? [bound] : [])].flatMap(({ low, mean, high }) => [low, mean, high]).filter(Number.isFinite);
    let [least, most] = [Math.min(...ends), Math.max(...ends)];
    const margin = (most - least) * 0.06 || Math.abs(most) * 0.05 || 1;
    [least, most] = [least - margin, most + margin];
    const share = (value) => `${100 * (value - least) / (most - least)}%`;
    const placed = (attributes, from, to = null) => {
        const part = el('span', attributes);
        part.style.left = share(from);
        if (to !== null) part.style.width = `calc(${share(to)} - ${share(from)})`;
        return part;
    };
    const band = () => (bound && Number.isFinite(bound.low) && Number.isFinite(bound.high)
        ? placed({ class: 'band' }, bound.low, bound.high) : null);
    const lines = rows.map(({ name, peer, mean, low, high, n }) => el('li', { class: peer ? 'peer' : 'ours' },
        el('span', { class: 'method', text: name }),
        el('span', { class: 'track', 'aria-hidden': 'true' }, band(),
            Number.isFinite(low) && Number.isFinite(high) ? placed({ class: 'whisker' }, low, high) : null,
            Number.isFinite(mean) ? placed({ class: 'dot' }, mean) : null),
        el('span', { class: 'value' }, el('strong', { text: measured(mean, digits) }),
            Number.isFinite(low) && Number.isFinite(high)
                ? ` ${measured(low, digits)} – ${measured(high, digits)}` : '',
            Number.isFinite(n) ? el('span', { class: 'muted', text: ` n = ${n}` }) : null)));
    const ticks = ticksBetween(least, most);
    const step = ticks.length > 1 ? ticks[1] - ticks[0] : 1;
    const axis = el('li', { class: 'axis', 'aria-hidden': 'true' }, el('span'), el('span', { class: 'track' },
        ...ticks.map((tick) => { const part = placed({}, tick); part.textContent = tick.toFixed(Math.max(0, Math.ceil(-Math.log10(step) - 1e-9))); return part; })), el('span'));
    return el('ul', { class: 'intervals' }, ...lines, axis);
}

function ticksBetween(least, most) {
    const rough = (most - least) / 4, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= rough);
    const ticks = [];
    for (let tick = Math.ceil(least / step) * step; tick <= most; tick += step) ticks.push(tick);
    return ticks;
}
