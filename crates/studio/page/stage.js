// The video: one frame at a time on a canvas, and what is drawn on it with the mouse or the keyboard.

import { digits, el, svg } from "./dom.js";

const KEPT = 90;
const AHEAD = 6;

/// Pictures of frames, loaded once.
class Pictures {
  constructor(address) {
    this.address = address;
    this.kept = new Map();
  }

  load(frame) {
    const known = this.kept.get(frame);
    if (known) return known;
    const picture = new Image();
    picture.decoding = "async";
    picture.src = this.address(frame);
    const loaded = picture.decode().then(() => picture);
    loaded.catch(() => this.kept.delete(frame));
    this.kept.set(frame, loaded);
    if (this.kept.size > KEPT) this.kept.delete(this.kept.keys().next().value);
    return loaded;
  }
}

export class Stage {
  constructor(facts, address) {
    this.facts = facts;
    this.pictures = new Pictures(address);
    this.frame = 0;
    this.canvas = el("canvas", { class: "frame" });
    this.overlay = svg("svg", { class: "overlay", viewBox: `0 0 ${facts.width} ${facts.height}`, role: "group", "aria-label": "Marks on the video" });
    this.node = el("div", { class: "stage" }, this.canvas, this.overlay);
    this.node.style.aspectRatio = `${facts.width} / ${facts.height}`;
    this.node.style.setProperty("--ratio", facts.width / facts.height);
    this.watch = new ResizeObserver(() => this.onresize?.());
    this.watch.observe(this.node);
  }

  leave() {
    this.watch.disconnect();
  }

  /// Replaces the marks; a handle that has the focus keeps it.
  draw(marks) {
    const focused = this.overlay.contains(document.activeElement) ? document.activeElement.dataset.handle : undefined;
    this.overlay.replaceChildren(...marks);
    if (focused) this.overlay.querySelector(`[data-handle="${focused}"]`)?.focus({ preventScroll: true });
  }

  /// Pixels of the video to one of the screen.
  get pixel() {
    return this.facts.width / Math.max(1, this.node.clientWidth);
  }

  async show(frame, available) {
    this.frame = frame;
    try {
      const picture = await this.pictures.load(frame);
      // A later frame may be wanted by now.
      if (this.frame !== frame) return;
      this.canvas.width = picture.naturalWidth;
      this.canvas.height = picture.naturalHeight;
      this.canvas.getContext("2d").drawImage(picture, 0, 0);
      this.canvas.dataset.frame = frame;
      for (let next = frame + 1; next <= Math.min(frame + AHEAD, available - 1); next += 1) this.pictures.load(next).catch(() => {});
    } catch {
      // The picture is not made yet.
    }
  }

  place(event) {
    const box = this.overlay.getBoundingClientRect();
    const { width, height } = this.facts;
    const within = (share, size) => Math.min(size, Math.max(0, share * size));
    return [within((event.clientX - box.left) / box.width, width), within((event.clientY - box.top) / box.height, height)];
  }

  /// A point that is dragged, or moved by arrow keys a pixel at a time.
  handle({ at, label, kind, move, done }) {
    const pixel = this.pixel;
    const knob = svg("g", { class: `handle ${kind}`, tabindex: "0", role: "button", "aria-label": `${label} at ${digits(at[0])}, ${digits(at[1])}; arrow keys move it` },
      svg("circle", { cx: at[0], cy: at[1], r: 16 * pixel, class: "reach" }),
      svg("circle", { cx: at[0], cy: at[1], r: 7 * pixel, class: "knob" }),
      svg("circle", { cx: at[0], cy: at[1], r: 1.5 * pixel, class: "dot" }));
    knob.dataset.handle = kind;
    knob.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      event.stopPropagation();
      // The knob is drawn anew while it moves, so the whole overlay listens.
      const drag = (moved) => move(this.place(moved));
      const end = () => {
        window.removeEventListener("pointermove", drag);
        window.removeEventListener("pointerup", end);
        done();
      };
      window.addEventListener("pointermove", drag);
      window.addEventListener("pointerup", end);
    });
    knob.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      const size = event.shiftKey ? 10 : 1;
      move([at[0] + size * step[0], at[1] + size * step[1]]);
      done();
    });
    return knob;
  }

  line(from, to, kind) {
    return svg("line", { x1: from[0], y1: from[1], x2: to[0], y2: to[1], class: kind });
  }

  path(points, kind) {
    return svg("polyline", { points: points.map((point) => point.join(",")).join(" "), class: kind });
  }

  text(at, words, kind = "tag") {
    const size = 13 * this.pixel;
    return svg("text", { x: at[0], y: at[1], class: kind, "font-size": size, "stroke-width": size / 4 }, words);
  }
}
