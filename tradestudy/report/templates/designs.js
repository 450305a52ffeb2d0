// The designs of a sweep: sliders that change figures, answers and requirements together.
const outline = (points, close) => {
  const shown = points.filter(([x, y]) => !Number.isNaN(x) && !Number.isNaN(y));
  return shown.length ? `M ${shown.map((one) => one.map((place) => place.toFixed(2)).join(" ")).join(" L ")}${close ? " z" : ""}` : "";
};
const FAR_OFF = 1e4; // beyond every page

// Places in a row at which a curve is known.
function stretches(x, known) {
  const found = [[]];
  for (let k = 0; k < x.length; k += 1) {
    if (known(k)) found.at(-1).push(k);
    else if (found.at(-1).length) found.push([]);
  }
  return found.filter((one) => one.length);
}

function gaps(usable, low, high) {
  const ends = [low, ...usable.flatMap(([near, far]) => [near, Math.min(far, high)]), high];
  return ends.flatMap((end, k) => (k % 2 || ends[k + 1] <= end ? [] : [[end, ends[k + 1]]]));
}

const heights = (path) => {
  const every = [...path.matchAll(/-?[\d.]+ (-?[\d.]+)/g)].map((found) => +found[1]);
  return [Math.min(...every), Math.max(...every)];
};
const box = (left, right, top, bottom) => outline([[left, top], [right, top], [right, bottom], [left, bottom]], true);

Object.assign(Panel.prototype, {
  showDesign(index) {
    const view = this.view;
    const isWhole = view.join() === "0,1,0,1";
    if (!isWhole) this.zoom([0, 1, 0, 1]);
    const bottoms = new Map(); // of shares that stand on one another
    for (const curve of this.curves) {
      curve.path ??= curve.group && $("path", curve.group);
      curve.drawn ??= curve.path?.getAttribute("d") ?? "";
    }
    for (const curve of this.curves) {
      if (curve.name === "declared") curve.group.style.visibility = index === null ? "" : "hidden";
      else if (curve.path && curve.name) curve.path.setAttribute("d", (index === null ? null : this.drawn(curve, index, bottoms)) ?? curve.drawn);
    }
    this.showPlace(index);
    this.shapes = null;
    if (isWhole) this.look();
    else this.zoom(view);
  },

  // The outline of a curve or of bars in a design; null where they are as declared.
  drawn(curve, index, bottoms) {
    const [variable, camera, where] = curve.name.split("/");
    const usable = data.designs.usable[index][camera] ?? [];
    if (variable === "best") return this.bestBar(curve, index);
    if (variable === "usable") return this.bars(curve, usable);
    if (variable === "unusable") return this.bars(curve, gaps(usable, this.x.low, this.x.high));
    const named = valuesOf(baseName(curve));
    if (!named) return null;
    const { x, value, high } = named; // in SI
    const offset = +($("use[x='0']", curve.group)?.getAttribute("y") ?? 0);
    const at = (k, of) => {
      const y = of[k] === Infinity ? -FAR_OFF : this.Y(isLength(this.y) ? fromBase(this.y, of[k]) : of[k]);
      return [this.X(fromBase(this.x, x[k])), Math.max(-FAR_OFF, Math.min(FAR_OFF, y)) - offset];
    };
    if (curve.kind === "line") {
      const seen = (place) => where !== "usable" || usable.some(([near, far]) => near <= place * 1.0001 && place <= far * 1.0001);
      const known = (k) => Number.isFinite(value[k]) && value[k] > 0 && seen(x[k]);
      return stretches(x, known).map((run) => outline(run.map((k) => at(k, value)))).join(" ");
    }
    const stacked = variable.startsWith("variance_share");
    const bottom = stacked ? bottoms.get(camera) ?? new Float32Array(x.length) : value;
    const top = stacked ? bottom.map((low, k) => low + (value[k] || 0)) : high;
    bottoms.set(camera, top);
    return stretches(x, (k) => !Number.isNaN(value[k])).map((run) =>
      outline([...run.map((k) => at(k, bottom)), ...run.reverse().map((k) => at(k, top))], true)).join(" ");
  },

  // Bars between ends, as high as the one that is drawn; only the first artist of a name carries them.
  bars(curve, ends) {
    if (this.curves.find((one) => one.name === curve.name && one.kind === curve.kind) !== curve) return "";
    const [top, bottom] = heights(curve.drawn);
    return ends.map(([near, far]) => {
      const [left, right] = [near, far].map((end) => this.X(Math.min(this.x.high, Math.max(end, this.x.low))));
      return curve.kind === "line" ? outline([[left, top], [right, top]]) : box(left, right, top, bottom);
    }).join(" ");
  },

  // The bar of the best camera: a rectangle for each stretch and camera, where those of the declared study stand.
  bestBar(curve, index) {
    const every = this.curves.filter((one) => one.name === "best");
    if (every[0] !== curve) return "";
    const [top, bottom] = heights(every.map((one) => one.drawn).join(" "));
    this.best?.remove();
    this.best = svg(curve.group, "g");
    for (const [start, end, cameras] of data.designs.best[index]) {
      cameras.forEach((camera, k) => {
        const [above, below] = [k, k + 1].map((part) => top + ((bottom - top) * part) / cameras.length);
        const { color } = this.curves.find((one) => one.name === `usable/${camera}` && one.kind === "shape") ?? {};
        if (color) svg(this.best, "path", { d: box(this.X(start), this.X(end), above, below), style: `fill:${paint(color)}` });
      });
    }
    return "";
  },

  // On axes of swept parameters, where the design stands.
  showPlace(index) {
    this.place?.remove();
    if (index === null) return this.best?.remove();
    this.place = svg(this.group, "g", { class: "design-place" });
    for (const [n, axis] of data.designs.axes.entries()) {
      const value = axis.values[places[n]];
      const at = (scale) => (scale.unit === "°" ? (value * 180) / Math.PI : isLength(scale) ? fromBase(scale, value) : value);
      if (value === null) continue;
      if (this.x.label === axis.says) this.line(this.place, this.X(at(this.x)), true);
      if (this.y.label === axis.says) this.line(this.place, this.Y(at(this.y)), false);
    }
  },
});

const places = (data.designs?.axes ?? []).map((axis) => axis.shown);
if (data.designs) {
  const { axes, blocks } = data.designs;
  const number = () => axes.reduce((sum, axis, n) => sum * axis.words.length + places[n], 0);
  const declared = number();
  const shown = new Map(Object.keys(blocks[declared]).map((name) => [name, document.getElementById(name)]).filter(([, one]) => one));
  const original = new Map(shown);
  const made = (text) => document.createRange().createContextualFragment(text).firstElementChild;
  const show = () => {
    const index = number();
    design = index === declared ? null : index;
    for (const [name, old] of shown) {
      const one = design === null ? original.get(name) : made(blocks[index][name]);
      if (one === old) continue;
      old.replaceWith(one);
      shown.set(name, one);
      const table = design !== null && $("table", one);
      if (table) equip(table, numberOf(one));
    }
    const words = axes.map((axis, n) => axis.words[places[n]]);
    const values = axes.map((axis, n) => `${axis.says} ${words[n]}`).join(", ");
    for (const figure of figures) {
      for (const panel of figure.panels) panel.showDesign(design);
      const follows = figure.panels.some((panel) => panel.read.some((curve) => baseName(curve) in data.values));
      figure.note.textContent = design !== null && follows ? `Now shown: ${values}.` : "";
      if (figure.readable) figure.table();
      figure.showAgain();
    }
    inputs.forEach(([input, output], n) => {
      input.value = places[n];
      input.setAttribute("aria-valuetext", words[n]);
      output.textContent = words[n];
    });
    reset.disabled = design === null;
  };
  const inputs = axes.map((axis, n) => [
    html("input", { type: "range", min: 0, max: axis.words.length - 1, step: 1, value: axis.shown, "aria-label": axis.says,
      oninput: (event) => { places[n] = +event.target.value; show(); } }),
    html("output", {}),
  ]);
  const reset = html("button", { type: "button", onclick: () => {
    axes.forEach((axis, n) => { places[n] = axis.shown; });
    show();
  } }, "As declared");
  const first = [...original.values()][0] ?? $("main header").nextElementSibling;
  first.before(html("section", { class: "designs", id: "designs", "aria-label": "Designs of the sweep" },
    ...inputs.map(([input, output], n) => html("label", {}, html("span", {}, axes[n].says), input, output)), reset,
    html("p", { class: "small" }, "Figures, cameras and requirements follow; the rest stays.")));
  show();
}
