// Elements, notices, numbers and explained terms.

const SVG = "http://www.w3.org/2000/svg";

/// Puts children in place of all there are; those that are absent are left out.
export function show(node, ...children) {
  // Text goes in as text: names of files are never markup.
  node.replaceChildren(...children.flat().filter((child) => child !== undefined && child !== null && child !== false));
  return node;
}

function fill(node, properties, children) {
  for (const [name, value] of Object.entries(properties ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value === true ? "" : value);
  }
  return show(node, ...children);
}

export const el = (tag, properties, ...children) => fill(document.createElement(tag), properties, children);
export const svg = (tag, properties, ...children) => fill(document.createElementNS(SVG, tag), properties, children);

export function notice(text, isError = false) {
  const note = el("div", { class: isError ? "notice wrong" : "notice" }, text);
  document.getElementById("notices").append(note);
  setTimeout(() => note.remove(), isError ? 9000 : 3500);
}

/// Runs what may fail, and says so.
export async function attempt(work) {
  try {
    return await work();
  } catch (error) {
    notice(error.message, true);
    return undefined;
  }
}

/// So many significant digits, without an exponent where that is readable.
export function digits(value, count = 4) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e7)) return value.toExponential(count - 1);
  const text = value.toPrecision(count);
  return text.includes("e") ? String(Number(text)) : text;
}

/// A value and its half interval with as many digits as the interval allows.
export function rounded(value, low, high) {
  const half = 0.5 * (high - low);
  if (!(half > 0)) return digits(value);
  const places = Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(half))));
  return value.toFixed(places);
}

const TERMS = {
  interval: "A range that should hold the true value in 95 of 100 such videos. It does not cover errors that are always the same, such as a wrong length of the stick.",
  "held out": "The last quarter of the video is not used for the fit. The equation predicts it, which shows whether it really describes the motion.",
  residual: "The distance between an observed and a computed position. Small and without a pattern is good.",
  observed: "Where the program sees the object in a frame.",
  fitted: "Where the equation has the object, in the frames that it was fitted to.",
  predicted: "Where the equation has the object in frames that it was not fitted to.",
  verdict: "Whether the numbers can be quoted: found, doubtful or not found, with the reasons.",
  scale: "Pixels of the video to a metre. Without it, lengths come in pixels.",
  "cross-check": "The same quantity from positions found by another method. The two should agree.",
  BIC: "Bayesian information criterion above the least one: how well an equation fits, with a penalty for each unknown. Differences above 10 are clear.",
  "missing term": "A term that, added to the equation, makes fit and prediction clearly better.",
  restitution: "The share of its speed that a ball keeps at a bounce.",
  energy: "For each kilogram: kinetic energy from the fitted speed, potential energy from the measured g and the height above the origin.",
};

let terms = 0;

/// A word with its explanation on hover and focus.
export function term(word, shown = word) {
  const id = `term-${++terms}`;
  return el("span", { class: "term", tabindex: "0", "aria-describedby": id }, shown,
    el("span", { class: "tip", role: "tooltip", id }, TERMS[word]));
}

/// `m/s^2` as `m/s²`.
export function powers(unit) {
  return unit.replace(/\^(-?\d)/g, (_, power) => [...power].map((it) => ({ "-": "⁻", 2: "²", 3: "³", 4: "⁴", 1: "¹" })[it] ?? it).join(""));
}

export function words(name) {
  return name.replaceAll("_", " ");
}
