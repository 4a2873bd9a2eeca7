// Tables that sort by a click on a heading.

/**
 * `columns`: {key, name, title, digits, number, shown}, `shown(row)` an element for the cell; `rows`: objects; `best(row, key)` marks a cell. The first
 * column stays in sight when the table is scrolled sideways.
 */
function createTable({ caption, columns, rows, best = () => false }) {
    const body = el('tbody');
    const headings = columns.map((column) => el('th', { scope: 'col', class: column.number ? 'number' : null, 'aria-sort': 'none' },
        el('button', { type: 'button', title: column.title || null, click: () => order(column) }, el('span', { text: column.name }))));
    const table = el('table', { class: 'data' },
        el('caption', { class: 'unseen-text', text: caption }), el('thead', {}, el('tr', {}, ...headings)), body);
    let sorted = null;
    const lines = rows.map((row) => ({ row, line: el('tr', {}, ...columns.map((column, place) => {
        const value = row[column.key];
        const text = column.number ? measured(value, column.digits) : String(value ?? '–');
        return el(place ? 'td' : 'th', {
            scope: place ? null : 'row', class: [column.number ? 'number' : '', best(row, column.key) ? 'best' : ''].join(' ').trim() || null, text: column.shown ? '' : text,
        }, column.shown?.(row));
    })) }));

    function order(column) {
        const down = sorted?.key === column.key ? !sorted.down : Boolean(column.number);
        sorted = { key: column.key, down };
        headings.forEach((heading, place) => heading.setAttribute('aria-sort',
            columns[place] === column ? (down ? 'descending' : 'ascending') : 'none'));
        const sign = down ? -1 : 1;
        const known = ({ row }) => (column.number ? Number.isFinite(row[column.key]) : row[column.key] != null);
        lines.sort((one, other) => known(other) - known(one) || (known(one) ? sign * (column.number
            ? one.row[column.key] - other.row[column.key]
            : String(one.row[column.key]).localeCompare(String(other.row[column.key]), undefined, { numeric: true })) : 0));
        body.replaceChildren(...lines.map(({ line }) => line));
    }
    body.replaceChildren(...lines.map(({ line }) => line));
    return el('div', { class: 'scroll', tabindex: 0, role: 'region', 'aria-label': caption }, table);
}
