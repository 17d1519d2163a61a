// Filmstrip, scrub bar, the measured part, play and step.

import { el } from "./dom.js";

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

export class Timeline {
  /// `stripAddress` gives the small picture of a frame; `change` is called with a new frame, `part` with a new part.
  constructor({ facts, stripAddress, change, part }) {
    Object.assign(this, { facts, stripAddress, change, part });
    this.frame = 0;
    this.available = 1;
    this.range = [0, facts.frames];
    this.made = 0;
    this.playing = undefined;
    this.strip = el("div", { class: "strip", "aria-hidden": "true" });
    this.shade = [el("div", { class: "shade" }), el("div", { class: "shade" })];
    this.pieces = el("div", { class: "pieces" });
    this.cursor = el("div", { class: "cursor" });
    this.scrub = el("input", { type: "range", min: 0, max: facts.frames - 1, step: 1, value: 0, class: "scrub", "aria-label": "Frame", oninput: () => this.go(Number(this.scrub.value)) });
    this.ends = [this.end(0, "Start of the measured part"), this.end(1, "End of the measured part")];
    this.band = el("div", { class: "band" }, this.strip, ...this.shade, this.pieces, this.cursor, this.scrub, ...this.ends);
    this.time = el("output", { class: "time" });
    this.playButton = el("button", { class: "round", type: "button", "aria-label": "Play", onclick: () => this.toggle() }, "▶");
    this.node = el("div", { class: "timeline" },
      el("div", { class: "controls" },
        this.button("|‹", "Start of the part", () => this.go(this.range[0])),
        this.button("‹", "One frame back", () => this.go(this.frame - 1)),
        this.playButton,
        this.button("›", "One frame on", () => this.go(this.frame + 1)),
        this.time),
      this.band);
  }

  button(sign, label, work) {
    return el("button", { class: "round quiet", type: "button", "aria-label": label, title: label, onclick: work }, sign);
  }

  end(which, label) {
    const handle = el("div", { class: `end end-${which}`, role: "slider", tabindex: "0", "aria-label": label, "aria-valuemin": 0, "aria-valuemax": this.facts.frames });
    const set = (frame, isDone) => {
      const range = [...this.range];
      range[which] = which === 0 ? clamp(frame, 0, range[1] - 2) : clamp(frame, range[0] + 2, this.facts.frames);
      this.setRange(range);
      this.go(which === 0 ? range[0] : range[1] - 1);
      if (isDone) this.part(range);
    };
    handle.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      handle.setPointerCapture(event.pointerId);
      const at = (moved) => {
        const box = this.band.getBoundingClientRect();
        return Math.round(((moved.clientX - box.left) / box.width) * this.facts.frames);
      };
      handle.onpointermove = (moved) => set(at(moved), false);
      handle.onpointerup = () => {
        handle.onpointermove = handle.onpointerup = null;
        this.part(this.range);
      };
    });
    handle.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      set(this.range[which] + step * (event.shiftKey ? 10 : 1), true);
    });
    return handle;
  }

  /// Pictures up to this one are made.
  setAvailable(count) {
    this.available = Math.max(1, count);
    const step = this.facts.strip_step;
    const wanted = Math.ceil(this.facts.shown / step);
    while (this.made < wanted && this.made * step < count) {
      const picture = el("img", { src: this.stripAddress(this.made * step), alt: "" });
      picture.style.width = `${100 / wanted}%`;
      this.strip.append(picture);
      this.made += 1;
    }
  }

  setRange(range) {
    this.range = range;
    const share = (frame) => `${(100 * frame) / this.facts.frames}%`;
    this.shade[0].style.width = share(range[0]);
    this.shade[1].style.left = share(range[1]);
    this.shade[1].style.right = "0";
    this.ends.forEach((end, which) => {
      end.style.left = share(range[which]);
      end.setAttribute("aria-valuenow", range[which]);
      end.setAttribute("aria-valuetext", `frame ${range[which]}`);
    });
  }

  setPieces(pieces) {
    this.pieces.replaceChildren(...pieces.map((piece) => {
      const bar = el("div", { class: "piece", title: piece.reason });
      bar.style.left = `${(100 * piece.start) / this.facts.frames}%`;
      bar.style.width = `${(100 * (piece.end - piece.start)) / this.facts.frames}%`;
      return bar;
    }));
  }

  seconds(frame) {
    return this.facts.times?.[frame];
  }

  go(frame) {
    this.frame = clamp(frame, 0, Math.min(this.facts.frames, this.available) - 1);
    this.scrub.value = this.frame;
    this.cursor.style.left = `${(100 * (this.frame + 0.5)) / this.facts.frames}%`;
    const seconds = this.seconds(this.frame);
    const time = seconds === undefined ? "no times" : `${seconds.toFixed(3)} s`;
    this.time.textContent = `frame ${this.frame} of ${this.facts.frames} · ${time}`;
    this.scrub.setAttribute("aria-valuetext", this.time.textContent);
    this.change(this.frame);
  }

  toggle() {
    if (this.playing) return this.pause();
    if (this.frame >= this.range[1] - 1) this.go(this.range[0]);
    this.playButton.textContent = "⏸";
    this.playButton.setAttribute("aria-label", "Pause");
    const begun = performance.now();
    const first = this.frame;
    const origin = this.seconds(first) ?? first / 30;
    const tick = (now) => {
      const passed = (now - begun) / 1000;
      let frame = this.frame;
      while (frame + 1 < this.range[1] && (this.seconds(frame + 1) ?? (frame + 1) / 30) - origin <= passed) frame += 1;
      if (frame !== this.frame) this.go(frame);
      if (this.frame >= this.range[1] - 1 || this.frame >= this.available - 1) return this.pause();
      this.playing = requestAnimationFrame(tick);
      return undefined;
    };
    this.playing = requestAnimationFrame(tick);
    return undefined;
  }

  pause() {
    cancelAnimationFrame(this.playing);
    this.playing = undefined;
    this.playButton.textContent = "▶";
    this.playButton.setAttribute("aria-label", "Play");
  }

  key(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) {
      event.preventDefault();
      this.pause();
      this.go(this.frame + step * (event.shiftKey ? 10 : 1));
    } else if (event.key === " ") {
      event.preventDefault();
      this.toggle();
    }
  }
}
