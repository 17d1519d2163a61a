// Charts over time with hover values and zoom.

import { digits, el, svg } from "./dom.js";

const SIZE = { width: 520, height: 210, left: 56, right: 12, top: 10, bottom: 26 };

/// Round numbers between two bounds.
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const size = 10 ** Math.floor(Math.log10(rough));
  const step = size * [1, 2, 5, 10].find((it) => it * size >= rough);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + step * 1e-9; at += step) found.push(Math.abs(at) < step * 1e-9 ? 0 : at);
  return found;
}

const label = (at) => String(Number(at.toPrecision(6)));

export class Chart {
  /// `series`: kind (dots or line), colour, name, points `[seconds, value]`, and between which times they are drawn.
  constructor({ title, series, held, end, pick }) {
    Object.assign(this, { held, pick });
    this.series = series.map((it) => ({ ...it, points: it.points.filter(([seconds, value]) => Number.isFinite(value) && seconds >= (it.from ?? -Infinity) && seconds <= (it.until ?? Infinity)) }));
    const seconds = this.series.flatMap((it) => it.points.map(([at]) => at));
    this.whole = seconds.length ? [Math.min(...seconds), Math.max(...seconds, end)] : [0, 1];
    this.range = this.whole;
    this.picture = svg("svg", { viewBox: `0 0 ${SIZE.width} ${SIZE.height}`, class: "chart", role: "img", "aria-label": title.map((part) => part.firstChild?.textContent ?? part).join("") });
    this.value = el("span", { class: "reading muted" });
    this.node = el("figure", {}, el("figcaption", {}, el("span", {}, ...title), this.value), this.picture);
    this.picture.addEventListener("pointermove", (event) => this.hover(event));
    this.picture.addEventListener("pointerleave", () => this.mark(this.marked));
    this.picture.addEventListener("pointerdown", (event) => this.press(event));
    this.picture.addEventListener("dblclick", () => this.zoom(this.whole));
    this.zoom(this.whole);
  }

  zoom(range) {
    this.range = range;
    const inside = this.series.flatMap((it) => it.points.filter(([at]) => at >= range[0] && at <= range[1]).map(([, value]) => value));
    const [low, high] = inside.length ? [Math.min(...inside), Math.max(...inside)] : [0, 1];
    const margin = 0.06 * (high - low) || 0.5 * Math.abs(high) || 1;
    this.bounds = [low - margin, high + margin];
    this.draw();
  }

  x(seconds) {
    return SIZE.left + ((seconds - this.range[0]) / (this.range[1] - this.range[0])) * (SIZE.width - SIZE.left - SIZE.right);
  }

  y(value) {
    return SIZE.height - SIZE.bottom - ((value - this.bounds[0]) / (this.bounds[1] - this.bounds[0])) * (SIZE.height - SIZE.top - SIZE.bottom);
  }

  draw() {
    const [first, last] = this.range;
    const inside = ([seconds]) => seconds >= first && seconds <= last;
    const right = SIZE.width - SIZE.right;
    const floor = SIZE.height - SIZE.bottom;
    const drawn = [];
    if (this.held !== undefined && this.held < last) {
      const from = Math.max(SIZE.left, this.x(this.held));
      drawn.push(svg("rect", { x: from, y: SIZE.top, width: right - from, height: floor - SIZE.top, class: "held" }));
      if (right - from > 60) drawn.push(svg("text", { x: right - 4, y: SIZE.top + 12, class: "axis-text end" }, "held out"));
    }
    for (const at of ticks(...this.bounds, 4)) drawn.push(svg("line", { x1: SIZE.left, x2: right, y1: this.y(at), y2: this.y(at), class: "rule" }), svg("text", { x: SIZE.left - 6, y: this.y(at) + 4, class: "axis-text end" }, label(at)));
    for (const at of ticks(first, last, 6)) drawn.push(svg("text", { x: this.x(at), y: SIZE.height - 8, class: "axis-text middle" }, label(at)));
    drawn.push(svg("text", { x: right, y: SIZE.height - 8, class: "axis-text end faint" }, "s"));
    for (const { kind, colour, points } of this.series) {
      const shown = points.filter(inside);
      if (kind === "dots") drawn.push(...shown.map(([seconds, value]) => svg("circle", { cx: this.x(seconds), cy: this.y(value), r: 2.6, class: `dot ${colour}` })));
      else drawn.push(svg("polyline", { points: shown.map(([seconds, value]) => `${this.x(seconds).toFixed(1)},${this.y(value).toFixed(1)}`).join(" "), class: `curve ${colour}` }));
    }
    this.line = svg("line", { y1: SIZE.top, y2: floor, class: "now-line" });
    this.area = svg("rect", { y: SIZE.top, height: floor - SIZE.top, class: "zoom-area", width: 0 });
    this.picture.replaceChildren(...drawn, this.line, this.area);
    this.mark(this.marked);
  }

  seconds(event) {
    const box = this.picture.getBoundingClientRect();
    const share = ((event.clientX - box.left) / box.width * SIZE.width - SIZE.left) / (SIZE.width - SIZE.left - SIZE.right);
    return this.range[0] + Math.min(1, Math.max(0, share)) * (this.range[1] - this.range[0]);
  }

  read(seconds) {
    const apart = (this.whole[1] - this.whole[0]) / 50;
    const values = this.series.flatMap(({ name, colour, points }) => {
      const near = points.reduce((best, point) => (best && Math.abs(best[0] - seconds) <= Math.abs(point[0] - seconds) ? best : point), undefined);
      return near && Math.abs(near[0] - seconds) < apart ? [" · ", el("span", { class: `ink ${colour}` }, `${name} ${digits(near[1], 4)}`)] : [];
    });
    this.value.replaceChildren(`${seconds.toFixed(3)} s`, ...values);
  }

  hover(event) {
    const seconds = this.seconds(event);
    this.put(seconds);
    this.read(seconds);
  }

  put(seconds) {
    const visible = seconds !== undefined && seconds >= this.range[0] && seconds <= this.range[1];
    this.line.classList.toggle("off", !visible);
    if (visible) {
      this.line.setAttribute("x1", this.x(seconds));
      this.line.setAttribute("x2", this.x(seconds));
    }
  }

  /// The time of the frame that is shown.
  mark(seconds) {
    this.marked = seconds;
    this.put(seconds);
    if (seconds === undefined) this.value.textContent = "";
    else this.read(seconds);
  }

  press(event) {
    const from = this.seconds(event);
    const drag = (moved) => {
      const ends = [from, this.seconds(moved)].sort((a, b) => a - b);
      this.area.setAttribute("x", this.x(ends[0]));
      this.area.setAttribute("width", this.x(ends[1]) - this.x(ends[0]));
    };
    const end = (moved) => {
      window.removeEventListener("pointermove", drag);
      window.removeEventListener("pointerup", end);
      const ends = [from, this.seconds(moved)].sort((a, b) => a - b);
      this.area.setAttribute("width", 0);
      if (ends[1] - ends[0] > 0.03 * (this.range[1] - this.range[0])) this.zoom(ends);
      else this.pick(from);
    };
    window.addEventListener("pointermove", drag);
    window.addEventListener("pointerup", end);
  }
}
