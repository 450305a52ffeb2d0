// Tables that can be sorted, filtered and copied.
const SIZES = { ...LENGTHS, µs: 1e-6, ms: 1e-3, s: 1, min: 60, h: 3600, "%": 1, ppm: 1e-4, g: 1, kg: 1e3, "°": 1, "″": 1 / 3600, MB: 1, GB: 1e3 };
const sortKey = (cell) => {
  const text = (cell?.textContent ?? "").trim().replace(/\u00a0/g, " ");
  if (/^±?[−-]?∞/.test(text)) return /^±?[−-]/.test(text) ? -Infinity : Infinity;
  const found = /^±?\s*([−-]?[\d.,]+)(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?(?:\s*(?:±|–|to).*?[\d.]+)?\s*([a-zµA-Z%°″]*)/.exec(text);
  if (!found) return text.toLowerCase();
  const power = [...(found[2] ?? "")].map((one) => (one === "⁻" ? "-" : "⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(one))).join("");
  return Number(found[1].replace("−", "-").replace(/,/g, "")) * 10 ** Number(power) * (SIZES[found[3]] ?? 1);
};
const compare = (a, b) => {
  if (typeof a === typeof b) return a < b ? -1 : a > b ? 1 : 0;
  return typeof a === "number" ? -1 : 1;
};

// Rows stay under the heading of their group.
function sort(table, column, falling) {
  const body = $("tbody", table), stretches = [[]];
  for (const row of [...body.rows]) {
    if ($("th.group", row)) stretches.push([row]);
    else stretches.at(-1).push(row);
  }
  for (const rows of stretches) {
    const keys = new Map(rows.map((row) => [row, sortKey(row.cells[column])]));
    const head = rows.filter((row) => $("th.group", row)), rest = rows.filter((row) => !head.includes(row));
    body.append(...head, ...rest.sort((a, b) => compare(keys.get(a), keys.get(b)) * (falling ? -1 : 1)));
  }
}

function filter(table, text) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  for (const row of $("tbody", table).rows) {
    const said = row.textContent.toLowerCase();
    row.hidden = !$("th.group", row) && !words.every((word) => said.includes(word));
  }
}

async function copy(table, button) {
  const rows = [...table.rows].filter((row) => !row.hidden);
  const cell = (one) => (one.dataset.title ?? one.textContent).replace(/\s+/g, " ").trim();
  const text = rows.map((row) => [...row.cells].map(cell).join("\t")).join("\n");
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
  } catch { // not allowed here: the reader copies what is selected
    getSelection().selectAllChildren(table);
    button.textContent = "Selected";
  }
  setTimeout(() => { button.textContent = "Copy"; }, 1500);
}

const MANY_ROWS = 6;
function equip(table, name) {
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    head.dataset.title = head.textContent.trim();
    if (!head.dataset.title) return;
    const button = html("button", { type: "button", class: "sort", onclick: () => {
      const falling = head.getAttribute("aria-sort") === "ascending";
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", falling ? "descending" : "ascending");
      sort(table, column, falling);
    } });
    button.append(...head.childNodes);
    head.append(button);
  });
  const tools = html("div", { class: "table-tools" });
  if (table.tBodies[0].rows.length > MANY_ROWS) {
    tools.append(html("input", { type: "search", placeholder: "Filter", "aria-label": `Filter rows of ${name}`,
      oninput: (event) => filter(table, event.target.value) }));
  }
  const button = html("button", { type: "button", "aria-label": `Copy ${name}`, onclick: () => copy(table, button) }, "Copy");
  tools.append(button);
  table.parentElement.before(tools);
}
for (const one of $$("table")) equip(one, one.caption?.textContent ?? numberOf(one.closest("figure")));
