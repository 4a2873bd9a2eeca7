// Two pictures of one size on top of each other, with a line to drag between them.

/** Returns an object with the element and `show(left, right)`; each is {uri, width, height, name, alt}. */
function createSlider(label) {
    const left = el('img', { class: 'under', decoding: 'async' });
    const right = el('img', { class: 'over', decoding: 'async' });
    const range = el('input', {
        type: 'range', min: 0, max: 100, value: 50, step: 'any', 'aria-label': label,
        input: () => place(range.valueAsNumber),
    });
    const names = [el('span', { class: 'name left' }), el('span', { class: 'name right' })];
    const line = el('span', { class: 'line', 'aria-hidden': 'true' }, el('span', { class: 'grip' }));
    const element = el('div', { class: 'slider' }, left, right, line, ...names, range);

    function place(percent) {
        element.style.setProperty('--at', `${percent}%`);
        range.setAttribute('aria-valuetext', `${Math.round(percent)} % ${names[0].textContent}`);
    }

    function show(first, second) {
        for (const [image, name, given] of [[left, names[0], first], [right, names[1], second]]) {
            image.hidden = !given;
            name.hidden = !given;
            if (!given) continue;
            image.src = given.uri;
            // before the picture is decoded: nothing below it moves
            element.style.aspectRatio = `${given.width} / ${given.height}`;
            image.alt = given.alt || given.name;
            name.textContent = given.name;
        }
        const both = Boolean(first && second);
        range.hidden = line.hidden = !both;
        place(both ? range.valueAsNumber : first ? 100 : 0);
    }

    return { element, show };
}
