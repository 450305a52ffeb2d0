// A figure: readout, switches, zoom, keys, and the table of its values.
const swatch = (color) => html("span", { class: "swatch", style: `background:${paint(color)}` });

class Figure {
  constructor(element, panels) {
    this.element = element;
    this.svg = $("svg", element);
    this.number = numberOf(element);
    this.frame = $(".frame", element);
    this.box = $(".scroll", this.frame);
    this.readout = html("div", { class: "readout", role: "status" });
    this.frame.append(this.readout);
    this.panels = panels.map((spec) => new Panel(this, spec));
    this.readable = this.panels.some((panel) => panel.read.length || panel.map);
    this.selection = svg(this.svg, "rect", { class: "selection" });
    this.controls();
    this.listen();
  }

  controls() {
    const labels = new Map();
    for (const curve of this.panels.flatMap((panel) => panel.curves)) {
      if (curve.label && curve.kind !== "map" && !labels.has(curve.label)) labels.set(curve.label, curve.color);
    }
    const bar = html("div", { class: "controls" });
    for (const [label, color] of labels) {
      bar.append(html("button", { type: "button", class: "switch", "aria-pressed": "true", "data-label": label,
        onclick: () => toggle(label) }, swatch(color), label));
    }
    const tool = (text, says, onclick) => html("button", { type: "button", "aria-label": `${says}, ${this.number}`, onclick }, text);
    bar.append(html("span", { class: "tools" }, tool("+", "Zoom in", () => this.zoomBy(0.5)),
      tool("−", "Zoom out", () => this.zoomBy(2)), tool("Reset", "Reset zoom", () => this.reset())));
    this.note = html("p", { class: "now-shown" });
    this.frame.after(this.note, bar);
    let details = $("details", this.element); // there where a figure has bars, maps or pictures
    if (this.readable) {
      details ??= html("details", { class: "values" }, html("summary", {}, `Values of ${this.number}`));
      this.tables = details.appendChild(html("div"));
      details.addEventListener("toggle", () => this.table());
      this.box.setAttribute("aria-label",
        `${this.number}. Arrow keys read values, Page Up and Page Down change the panel, plus and minus zoom, 0 resets.`);
    }
    bar.after(details ?? "");
  }

  table() {
    this.tables.replaceChildren();
    if (!this.tables.parentElement.open) return;
    for (const panel of this.panels.filter((one) => one.read.length)) {
      const groups = new Map();
      for (const curve of panel.read) {
        const { x, y } = panel.points(curve);
        const key = x.join();
        groups.set(key, { x, columns: [...(groups.get(key)?.columns ?? []), { curve, y }] });
      }
      for (const { x, columns } of groups.values()) {
        const head = html("tr", {}, html("th", { scope: "col" }, panel.x.label || "x"),
          ...columns.map(({ curve }) => html("th", { scope: "col", class: "right" }, curve.label)));
        const rows = [...x].map((value, k) => html("tr", {}, html("th", { scope: "row" }, worded(panel.x, value)),
          ...columns.map(({ y }) => html("td", { class: "right" }, worded(panel.y, y[k])))));
        const caption = html("caption", {}, [panel.y.label, panel.title].filter(Boolean).join(", ") || this.number);
        const table = html("table", {}, caption, html("thead", {}, head), html("tbody", {}, ...rows));
        this.tables.append(html("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Values of ${this.number}` }, table));
        equip(table, this.number);
      }
    }
  }

  place(event) {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    return [point.x, point.y];
  }

  listen() {
    let start = null, pressed = null;
    this.svg.addEventListener("pointermove", (event) => {
      const place = this.place(event);
      if (start) this.select(start, place);
      else if (!kept) this.lookAt(place, event);
    });
    this.svg.addEventListener("pointerdown", (event) => {
      const place = this.place(event);
      const panel = this.panels.find((one) => one.holds(place));
      pressed = place;
      if (!kept) this.lookAt(place, event);
      if (event.pointerType === "mouse" && event.button === 0 && panel) {
        start = { panel, place };
        this.svg.setPointerCapture(event.pointerId);
        event.preventDefault();
      }
    });
    this.svg.addEventListener("pointerup", (event) => {
      if (start) this.zoomTo(start, this.place(event));
      start = null;
    });
    this.svg.addEventListener("click", (event) => {
      const place = this.place(event);
      if (pressed && Math.hypot(place[0] - pressed[0], place[1] - pressed[1]) >= LEAST_PART) return; // a part was drawn over
      kept = false;
      this.lookAt(place, event);
      kept = cursor !== null;
    });
    this.svg.addEventListener("pointerleave", () => !start && !kept && leave());
    this.svg.addEventListener("dblclick", () => this.reset());
    this.box.addEventListener("keydown", (event) => this.key(event));
    this.box.addEventListener("blur", () => !kept && leave());
  }

  lookAt(place, event) {
    const panel = this.panels.find((one) => one.holds(place));
    if (!panel) {
      leave();
      return;
    }
    if (panel.map) this.show(panel, panel.cell(place));
    else {
      const value = panel.valueOfX(place[0]);
      const samples = panel.read.some((curve) => curve.kind !== "points") ? panel.samples() : [];
      const k = nearest(samples, value, panel.x);
      this.show(panel, k >= 0 ? samples[k] : value, place);
    }
    const frame = this.frame.getBoundingClientRect();
    this.float(event.clientX - frame.left, event.clientY - frame.top);
  }

  // Keys that read values do not scroll.
  floatInView(x, y) {
    this.box.scrollLeft = x - this.box.clientWidth / 2;
    this.float(x - this.box.scrollLeft, y);
  }

  // The readout beside a place of the frame, on the side where there is room.
  float(x, y) {
    const { offsetWidth: width, offsetHeight: height, style } = this.readout;
    style.left = `${x + 16 + width < this.frame.clientWidth ? x + 16 : Math.max(0, x - width - 16)}px`;
    style.top = `${Math.max(0, y - height / 2)}px`;
  }

  show(panel, value, place = null) {
    const rows = panel.at(value, place);
    this.last = [panel, value, place];
    cursor = panel.map ? { panel, value: NaN, cell: value } : { panel, value: inBase(panel.x, value) };
    for (const figure of figures) for (const one of figure.panels) one.look();
    for (const figure of figures) if (figure !== this) figure.readout.classList.remove("shown");
    const points = rows.length === 1 && rows[0].curve.kind === "points";
    const at = points ? rows[0].x : value;
    const title = [panel.title, ...(panel.map ? panel.cellEnds(value).words : [`${panel.x.label || "at"} ${worded(panel.x, at)}`])].filter(Boolean).join(" · ");
    const shares = rows.every(({ curve }) => curve.name.startsWith("variance_share")); // of one camera: said once
    const unusable = (broken) => broken && html("span", { class: "unusable" }, ` not usable: ${broken}`);
    this.readout.replaceChildren(html("div", { class: "at" }, title, shares ? unusable(rows[0]?.broken ?? "") : ""), ...rows.map(({ curve, x, y, beside, broken }) =>
      html("div", { class: "row", "data-label": curve.label },
        panel.map ? "" : swatch(curve.color), `${curve.label} `,
        html("b", {}, worded(panel.map ? { ...panel.y, ...curve, factor: 1, names: {} } : panel.y, y)), " ", html("span", { class: "interval" }, beside), shares ? "" : unusable(broken),
        !panel.map && x !== value && !points ? ` (at ${worded(panel.x, x)})` : "")));
    this.readout.classList.toggle("shown", rows.length > 0);
  }

  // After a switch or a slider.
  showAgain() {
    if (cursor && this.panels.includes(cursor.panel)) this.show(...this.last);
  }

  key(event) {
    if (event.target !== this.box || event.ctrlKey || event.metaKey || event.altKey) return;
    const readable = this.panels.filter((panel) => panel.read.length || panel.map);
    let panel = cursor && readable.includes(cursor.panel) ? cursor.panel : readable[0];
    const step = { ArrowRight: 1, ArrowLeft: -1, ArrowUp: 10, ArrowDown: -10 }[event.key];
    const other = { PageDown: 1, PageUp: -1 }[event.key];
    if (event.key === "+" || event.key === "=") this.zoomBy(0.5);
    else if (event.key === "-") this.zoomBy(2);
    else if (event.key === "0") this.reset();
    else if (panel && (step || other || ["Home", "End"].includes(event.key))) {
      if (other) panel = readable[(readable.indexOf(panel) + other + readable.length) % readable.length];
      kept = false;
      if (panel.map) return this.step(panel, event);
      const samples = panel.samples();
      if (!samples.length) return;
      const now = cursor ? nearest(samples, fromBase(panel.x, cursor.value), panel.x) : step > 0 ? -1 : 0;
      const far = { Home: -Infinity, End: Infinity }[event.key] ?? step ?? 0;
      const next = Math.max(0, Math.min(samples.length - 1, now + far));
      this.show(panel, samples[next]);
      const ratio = this.svg.getScreenCTM().a;
      this.floatInView(panel.X(samples[next]) * ratio, panel.size.top * ratio + 40);
    } else return;
    event.preventDefault();
  }

  // From one cell of a map to the next.
  step(panel, event) {
    const { key } = event, up = panel.y.low < panel.y.high ? 1 : -1;
    const now = cursor?.panel === panel ? cursor.cell : [0, 0];
    const far = [{ ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[key] ?? 0, { ArrowUp: up, ArrowDown: -up }[key] ?? 0];
    const sizes = [panel.map.x, panel.map.y].map((edges) => numbers(edges).length - 1);
    this.show(panel, now.map((k, n) => Math.max(0, Math.min(sizes[n] - 1, k + far[n]))));
    const [left, , , top] = panel.cellEnds(cursor.cell).ends, ratio = this.svg.getScreenCTM().a;
    this.floatInView(left * ratio, top * ratio + 40);
    event.preventDefault();
  }

  // The part of a panel that was drawn over with the mouse; what is narrower or lower than a few points counts as whole.
  part({ panel, place: [x, y] }, [toX, toY]) {
    const { left, right, top, bottom } = panel.size;
    const ends = (low, high, a, b) => (Math.abs(a - b) < LEAST_PART ? [low, high]
      : [Math.min(a, b), Math.max(a, b)].map((end) => Math.max(low, Math.min(high, end))));
    return [...ends(left, right, x, toX), ...ends(top, bottom, y, toY)];
  }

  select(start, place) {
    const [left, right, top, bottom] = this.part(start, place);
    const shape = { x: left, y: top, width: right - left, height: bottom - top };
    for (const [name, value] of Object.entries(shape)) this.selection.setAttribute(name, value);
    this.selection.classList.add("shown");
  }

  zoomTo(start, place) {
    this.selection.classList.remove("shown");
    const [left, right, top, bottom] = this.part(start, place);
    const { size, view: [x0, x1, y0, y1] } = start.panel;
    const across = (end) => x0 + ((end - size.left) / size.width) * (x1 - x0);
    const up = (end) => y0 + ((size.bottom - end) / size.height) * (y1 - y0);
    this.zoomPanel(start.panel, [across(left), across(right), up(bottom), up(top)]);
  }

  zoomBy(factor) {
    const own = cursor && !cursor.cell && this.panels.includes(cursor.panel);
    const panel = own ? cursor.panel : this.panels.find((one) => one.read.length) ?? this.panels[0];
    const [x0, x1, y0, y1] = panel.view;
    const middle = own ? fraction(panel.x, fromBase(panel.x, cursor.value)) : (x0 + x1) / 2;
    const around = (centre, size) => [centre - (size / 2) * factor, centre + (size / 2) * factor];
    this.zoomPanel(panel, [...around(middle, x1 - x0), ...around((y0 + y1) / 2, y1 - y0)]);
  }

  // Panels that share an axis of the same ends zoom along it together.
  zoomPanel(panel, view) {
    const same = (one, other) => sameAxis(one, other) && one.low === other.low && one.high === other.high;
    panel.zoom(view);
    for (const one of this.panels) {
      if (one === panel) continue;
      const along = same(one.x, panel.x), up = same(one.y, panel.y) && one.size.top === panel.size.top;
      if (along || up) one.zoom([...(along ? panel : one).view.slice(0, 2), ...(up ? panel : one).view.slice(2)]);
    }
  }

  reset() {
    for (const panel of this.panels) panel.zoom([0, 1, 0, 1]);
  }

  switched() {
    for (const panel of this.panels) {
      for (const { group, label } of panel.curves) if (group) group.style.display = hidden.has(label) ? "none" : "";
      panel.look();
    }
    this.showAgain();
    for (const button of $$("button.switch", this.element)) {
      button.setAttribute("aria-pressed", String(!hidden.has(button.dataset.label)));
    }
  }
}

function toggle(label) {
  if (!hidden.delete(label)) hidden.add(label);
  for (const figure of figures) figure.switched();
}

function leave() {
  cursor = null;
  kept = false;
  for (const figure of figures) {
    for (const panel of figure.panels) panel.look();
    figure.readout.classList.remove("shown");
  }
}
document.addEventListener("keydown", (event) => event.key === "Escape" && leave());
document.addEventListener("click", (event) => !event.target.closest(".plot, .designs") && leave());

const figures = [];
for (const [name, panels] of Object.entries(data.figures)) {
  const element = document.getElementById(name);
  if (element) figures.push(new Figure(element, panels));
}
