// What every part of the script uses: elements, the numbers of the page, how they are written, scales of axes.
// The parts are put together in one scope. Without the script the page stays complete.
"use strict";
const $ = (selector, root = document) => root.querySelector(selector);
const $$ = (selector, root = document) => [...root.querySelectorAll(selector)];
const data = JSON.parse($("#page-data").textContent);

const html = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
};
const paint = (color) => `var(--c${color.slice(1)}, ${color})`; // as the style sheet has it, in the dark too
const numberOf = (figure) => $("figcaption b", figure).textContent.replace(/\.$/, "");
const svg = (parent, tag, attributes = {}) => {
  const made = parent.appendChild(document.createElementNS(parent.namespaceURI, tag));
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
};


const decoded = new Map();
const NONE = new Float32Array();
const numbers = (place) => {
  if (place === null || place === undefined) return NONE;
  if (!decoded.has(place)) {
    const bytes = Uint8Array.from(atob(data.arrays[place]), (letter) => letter.charCodeAt(0));
    decoded.set(place, new Float32Array(bytes.buffer));
  }
  return decoded.get(place);
};

// As `significant` of units.py: three digits, no trailing zeros.
const significant = (value, digits = 3) => {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "—" : value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const [mantissa, power] = value.toExponential(digits - 1).split("e").map(Number);
  if (power >= -5 && power < 7) {
    const plain = Number(`${mantissa}e${power}`).toFixed(Math.max(digits - 1 - power, 0));
    return (plain.includes(".") ? plain.replace(/\.?0+$/, "") : plain).replace("-", "−");
  }
  const raised = [...String(power)].map((one) => (one === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[one])).join("");
  return `${mantissa}×10${raised}`.replace("-", "−");
};
const LENGTHS = { nm: 1e-9, µm: 1e-6, mm: 1e-3, m: 1, km: 1e3 };
const length = (metres) => {
  const size = Math.abs(Number(metres.toPrecision(3)));
  if (!Number.isFinite(metres) || size === 0) return significant(metres) + (size === 0 ? " m" : "");
  const unit = size >= 1e4 ? "km" : size >= 1 ? "m" : size >= 1e-3 ? "mm" : size >= 1e-6 ? "µm" : "nm";
  return `${significant(metres / LENGTHS[unit])} ${unit}`;
};
const distance = (metres) => (Math.abs(metres) >= 0.1 ? `${significant(metres)} m` : length(metres));
const span = (low, high) => {
  const [first, last] = [distance(low).split(" "), distance(high).split(" ")];
  return `${first[1] === last[1] ? first[0] : first.join(" ")} to ${last.join(" ")}`;
};


const LOG_STEP = 10 / 9; // matplotlib's symmetric logarithm: one decade is as long as the linear part
const forward = ({ kind, linear_within }, value) => {
  if (kind === "log") return value > 0 ? Math.log10(value) : NaN;
  const within = linear_within || Infinity, size = Math.abs(value) / within;
  return size <= 1 ? value * LOG_STEP : Math.sign(value) * within * (LOG_STEP + Math.log10(size));
};
const inverse = ({ kind, linear_within }, place) => {
  if (kind === "log") return 10 ** place;
  const within = linear_within || Infinity, size = Math.abs(place) / within;
  return size <= LOG_STEP ? place / LOG_STEP : Math.sign(place) * within * 10 ** (size - LOG_STEP);
};
const fraction = (scale, value) => {
  const [low, high] = [forward(scale, scale.low), forward(scale, scale.high)];
  return (forward(scale, value) - low) / (high - low);
};
const valueAt = (scale, part) => {
  const [low, high] = [forward(scale, scale.low), forward(scale, scale.high)];
  return inverse(scale, low + part * (high - low));
};
const isLength = (scale) => scale.unit in LENGTHS;
const inBase = (scale, value) => value * scale.factor * (LENGTHS[scale.unit] ?? 1);
const fromBase = (scale, value) => value / scale.factor / (LENGTHS[scale.unit] ?? 1);
const worded = (scale, value) => {
  if (Number.isNaN(value)) return "—";
  if (Object.keys(scale.names).length) return scale.names[String(Number(value.toPrecision(6)))] ?? significant(value);
  if (isLength(scale)) return (scale.label.includes("distance") ? distance : length)(inBase(scale, value));
  return [significant(value * scale.factor), scale.unit].filter(Boolean).join(" ");
};
const sameAxis = (one, other) => one.label === other.label && isLength(one) === isLength(other);
