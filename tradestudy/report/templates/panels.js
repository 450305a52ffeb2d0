// A panel of a figure: what stands under the cursor, and how it is zoomed.
const hidden = new Set(); // labels that are switched off, in all figures
let cursor = null; // {panel, value}: where the reader looks, in base units of an axis
let kept = false; // whether a tap keeps the readout until another, or Escape
const LEAST_PART = 6; // points: a shorter stroke is a tap
const LEAST_VIEW = 1e-3;

// Numbers of the design that is shown, by the name of a curve: {x, value, low, high}.
let design = null;
const baseName = (curve) => curve.name.split("/").slice(0, 2).join("/");
const valuesOf = (name) => {
  const own = data.values[name];
  if (!own) return null;
  const [value, low, high] = (design !== null && data.designs.curves[name]?.[design]) || own.slice(1);
  return { x: numbers(own[0]), value: numbers(value), low: numbers(low), high: numbers(high), beside: own[4] };
};

// Which limits the camera of a curve of the results breaks at the k-th distance; empty where it is usable.
const brokenLimits = (curve, k) => {
  if (!(baseName(curve) in data.values)) return "";
  const stretches = (design === null ? data : data.designs).unusable;
  const own = (design === null ? stretches : stretches[design])[curve.name.split("/")[1]] ?? [];
  return own.find(([first, last]) => first <= k && k <= last)?.[2] ?? "";
};

class Panel {
  constructor(figure, spec) {
    Object.assign(this, spec);
    this.figure = figure;
    this.group = document.getElementById(spec.id);
    this.view = [0, 1, 0, 1];
    const [left, top, right, bottom] = spec.box;
    this.overlay = svg(this.group, "g", { class: "cursor" });
    this.size = { left, top, right, bottom, width: right - left, height: bottom - top };
    for (const curve of this.curves) curve.group = document.getElementById(curve.id);
    this.map = this.curves.find((one) => one.kind === "map" && one.top !== null);
    this.read = this.curves.filter((one) => one.label && one.kind !== "map" && !one.name.includes("usable") && one.kind !== "shape" &&
      (one.kind !== "band" || one.name.startsWith("variance_share")) && (baseName(one) in data.values || one.x !== null));
  }

  // The points of a curve in units of the panel; of a curve of the results with the ends beside each value, in SI.
  points(curve) {
    const named = valuesOf(baseName(curve));
    if (!named) return { x: numbers(curve.x), y: numbers(curve.y) };
    return { ...named, y: isLength(this.y) ? Array.from(named.value, (one) => fromBase(this.y, one)) : named.value };
  }

  X(value) {
    const part = (fraction(this.x, value) - this.view[0]) / (this.view[1] - this.view[0]);
    return this.size.left + part * this.size.width;
  }

  Y(value) {
    const part = (fraction(this.y, value) - this.view[2]) / (this.view[3] - this.view[2]);
    return this.size.bottom - part * this.size.height;
  }

  valueOfX(place) {
    const part = (place - this.size.left) / this.size.width;
    return valueAt(this.x, this.view[0] + part * (this.view[1] - this.view[0]));
  }

  // Column and row of the cell of a map at a place, or as near to it as there is one.
  cell(place) {
    const { left, bottom, width, height } = this.size, [x0, x1, y0, y1] = this.view;
    const parts = [x0 + ((place[0] - left) / width) * (x1 - x0), y0 + ((bottom - place[1]) / height) * (y1 - y0)];
    return [this.x, this.y].map((scale, n) => {
      const edges = numbers(n ? this.map.y : this.map.x), value = valueAt(scale, parts[n]);
      return Math.max(0, edges.findIndex((edge, k) => (edge - value) * (edges[k + 1] - value) <= 0));
    });
  }

  // The edges of a cell in the drawing, and in words where it is.
  cellEnds([column, row]) {
    const [x, y] = [numbers(this.map.x), numbers(this.map.y)];
    const words = [[this.x, x, column], [this.y, y, row]].map(([scale, edges, k]) => {
      const name = scale.names[String((edges[k] + edges[k + 1]) / 2)];
      return name === undefined ? "" : [scale.label, name, scale.unit].filter(Boolean).join(" ");
    });
    return { words, ends: [this.X(x[column]), this.X(x[column + 1]), this.Y(y[row]), this.Y(y[row + 1])] };
  }

  holds([x, y], margin = 0) {
    const { left, right, top, bottom } = this.size;
    return x >= left - margin && x <= right + margin && y >= top - margin && y <= bottom + margin;
  }

  // What stands at the sample next to a value on the axis across; of scattered points only the nearest to a place.
  at(value, place) {
    if (this.map) return [{ curve: this.map, y: numbers(this.map.top)[value[1] * (numbers(this.map.x).length - 1) + value[0]], beside: "", broken: "" }];
    const found = [];
    let closest = null;
    for (const curve of this.read) {
      if (hidden.has(curve.label)) continue;
      const points = this.points(curve), { x, y } = points;
      const one = (k) => ({ curve, x: x[k], y: y[k], beside: Number.isNaN(y[k]) ? "" : this.beside(curve, points, k), broken: brokenLimits(curve, k) });
      if (curve.kind !== "points") {
        const k = nearest(x, value, this.x);
        if (k >= 0) found.push(one(k));
        continue;
      }
      for (let k = 0; k < x.length; k += 1) {
        const away = Math.hypot(this.X(x[k]) - (place ?? [this.X(value)])[0], place ? this.Y(y[k]) - place[1] : 0);
        if (away < (closest?.away ?? 14)) closest = { ...one(k), away };
      }
    }
    return closest ? [...found, closest] : found;
  }

  samples() {
    const line = this.read.find((curve) => !hidden.has(curve.label));
    return line ? [...new Set(this.points(line).x)].sort((a, b) => a - b) : [];
  }

  // What is shown beside a value: an interval, the value to the other side, or the band of the same label there.
  beside(curve, { x, low, high, beside }, k) {
    if (high?.length) return beside ? `${beside}: ${span(low[k], high[k])}` : `nearer, ${length(high[k])} farther`;
    const band = !high && this.curves.find((one) => one.kind === "band" && one.label === curve.label && one.x != null);
    if (!band) return "";
    const own = numbers(band.x), at = nearest(own, x[k], this.x);
    return Math.abs(this.X(own[at]) - this.X(x[k])) < 1 ? `${worded(this.y, numbers(band.y)[at])} to ${worded(this.y, numbers(band.top)[at])}` : "";
  }

  // A line through the whole panel, upright or level.
  line(parent, place, upright) {
    const { left, right, top, bottom } = this.size;
    svg(parent, "line", upright ? { x1: place, x2: place, y1: top, y2: bottom } : { x1: left, x2: right, y1: place, y2: place });
  }

  look() {
    this.overlay.replaceChildren();
    if (cursor?.panel === this && this.map) {
      const [left, right, bottom, top] = this.cellEnds(cursor.cell).ends;
      svg(this.overlay, "rect", { x: left, y: Math.min(top, bottom), width: right - left, height: Math.abs(bottom - top) });
    }
    if (!cursor || !sameAxis(cursor.panel.x, this.x)) return;
    const value = fromBase(this.x, cursor.value);
    const x = this.X(value);
    if (!this.holds([x, this.size.top], 0.1)) return;
    this.line(this.overlay, x, true);
    for (const { curve, x: at, y } of this.at(value)) {
      const height = this.Y(y);
      if (curve.kind === "line" && this.holds([x, height], 0.1)) {
        svg(this.overlay, "circle", { cx: this.X(at), cy: height, r: 2.4, style: `fill:${paint(curve.color)}` });
      }
    }
  }

  zoom(view) {
    const inside = (low, high) => {
      const width = Math.min(1, Math.max(LEAST_VIEW, high - low));
      const start = Math.min(1 - width, Math.max(0, low));
      return [start, start + width];
    };
    this.view = [...inside(view[0], view[1]), ...inside(view[2], view[3])];
    this.draw();
  }

  // Every drawn coordinate is moved as the view is; ticks are made anew.
  draw() {
    const { left, top, right, bottom, width, height } = this.size;
    const [x0, x1, y0, y1] = this.view;
    const [sx, sy] = [1 / (x1 - x0), 1 / (y1 - y0)];
    const zoomed = sx > 1 || sy > 1;
    const moveX = (x) => left + ((x - left) / width - x0) * sx * width;
    const moveY = (y) => bottom - ((bottom - y) / height - y0) * sy * height;
    this.remember();
    for (const { shape, path, x, y, offset } of this.shapes) {
      if (offset === null) {
        shape.setAttribute("transform", `matrix(${sx} 0 0 ${sy} ${moveX(0)} ${moveY(0)}) ${path}`);
      } else if (path !== undefined) {
        shape.setAttribute("d", path.replace(/(-?[\d.]+) (-?[\d.]+)/g, (_, px, py) =>
          `${moveX(+px).toFixed(2)} ${(moveY(+py + offset) - offset).toFixed(2)}`));
      } else {
        const at = [moveX(x), moveY(y)];
        shape.setAttribute("x", at[0]);
        shape.setAttribute("y", at[1]);
        shape.style.display = this.holds(at, 1) ? "" : "none";
      }
    }
    for (const [id, alongX, alongY] of this.anchors) {
      const text = document.getElementById(id);
      if (!text) continue;
      const [x, y] = this.texts.get(id);
      const at = [alongX ? moveX(x) : x, alongY ? moveY(y) : y];
      text.setAttribute("transform", `translate(${at[0] - x} ${at[1] - y})`);
      text.style.display = zoomed && !this.holds(at) ? "none" : "";
    }
    for (const tick of this.ticks) tick.style.display = zoomed ? "none" : "";
    this.own?.remove();
    if (zoomed) this.drawTicks();
    this.look();
  }

  // What moves with the view, once: outlines and marks that are cut at the panel, and texts that stand at data.
  remember() {
    if (this.shapes) return;
    // Names at the ends of curves are hidden with the ticks: in a part of a figure, curves end elsewhere.
    this.ticks = [...$$(":scope > g > g[id*='tick_']", this.group),
      ...this.curves.flatMap((one) => (one.name === "declared" ? one.group : []))];
    this.shapes = [];
    for (const shape of $$("[clip-path], [clip-path] *, g[id*='panel-'] > g > use[x]", this.group)) {
      if (shape.matches("image")) this.shapes.push({ shape, path: shape.getAttribute("transform") ?? "", offset: null });
      if (shape.closest("g[id*='tick_'], .cursor") || !shape.matches("path, use")) continue;
      const [x, y] = [+shape.getAttribute("x"), +shape.getAttribute("y")];
      const outlined = shape.matches("path") ? shape : x === 0 && document.getElementById(shape.getAttribute("href").slice(1));
      this.shapes.push(outlined ? { shape: outlined, path: outlined.getAttribute("d") ?? "", offset: y } : { shape, x, y });
    }
    this.texts = new Map();
    for (const [id] of this.anchors) {
      const box = document.getElementById(id)?.getBBox();
      this.texts.set(id, box ? [box.x + box.width / 2, box.y + box.height / 2] : [0, 0]);
    }
  }

  drawTicks() {
    const { left, bottom } = this.size;
    this.own = svg(this.group, "g", { class: "ticks" });
    this.group.insertBefore(this.own, this.group.children[1]);
    const label = (x, y, text, anchor) => {
      svg(this.own, "text", { x, y, "text-anchor": anchor }).textContent = text;
    };
    const labelled = (which) => this.ticks.some((tick) => tick.id.includes(`${which}tick`) && $("g[id*='text_']", tick));
    for (const [value, text] of ticksOf(this.x, this.view[0], this.view[1])) {
      const x = this.X(value);
      this.line(this.own, x, true);
      if (labelled("x")) label(x, bottom + 9.5, text, "middle");
    }
    for (const [value, text] of ticksOf(this.y, this.view[2], this.view[3])) {
      const y = this.Y(value);
      this.line(this.own, y, false);
      if (labelled("y")) label(left - 4, y + 2.5, text, "end");
    }
  }
}

// The place of the value nearest to one, in an array in any order, as the axis shows it.
function nearest(values, value, scale) {
  const place = forward(scale, value);
  let [best, least] = [-1, Infinity];
  for (let k = 0; k < values.length; k += 1) {
    const away = Math.abs(forward(scale, values[k]) - place);
    if (away < least) [best, least] = [k, away];
  }
  return best;
}

// Round values between two fractions of an axis, with their words.
function ticksOf(scale, from, to) {
  const names = Object.entries(scale.names);
  const [low, high] = [valueAt(scale, from), valueAt(scale, to)].sort((a, b) => a - b);
  if (names.length) return names.map(([value, text]) => [+value, text]).filter(([value]) => value >= low && value <= high);
  const found = [];
  if (scale.kind === "log" && high / low > 5) {
    const subs = high / low > 100 ? [1] : [1, 2, 5];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power += 1) {
      for (const sub of subs) found.push(sub * 10 ** power);
    }
  } else {
    const rough = (high - low) / 5, size = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].find((one) => one * size >= rough) * size;
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) found.push(k * step);
  }
  return found.filter((value) => value >= low && value <= high).map((value) => [value, worded(scale, Number(value.toPrecision(6)))]);
}
