// What is set by pointing: object, part, scale, axes, equation.

import { digits, el, svg, term } from "./dom.js";

export const COLOURS = ["#e5484d", "#3b82f6", "#22a06b", "#e9962b", "#a855f7", "#0ea5b7"];
const LENGTHS = [[1, "1 m"], [0.5, "50 cm"], [0.3, "30 cm"], [0.297, "A4 sheet, long side"], [0.067, "tennis ball"], [0.04, "table tennis ball"], [0.24, "basketball"], [0.22, "football"]];
/// Share of the picture's width that a new stick has.
const STICK = 0.3;
/// Pixels of the screen from which on a press is a drag.
const DRAGGED = 12;

/// A control by what stays when it is drawn anew.
const keyOf = (control) => control.id || [control.type, control.name, control.name ? control.value : control.textContent].join(" ");

/// Whether a mover is among those that are measured.
function isTaken({ settings, preview: { proposals } }, place) {
  return settings.marks.length ? nearest(proposals, settings.marks[0]) === place : place < settings.objects;
}

/// The mover that a point lies on.
function nearest(proposals, mark) {
  let best = [Infinity, -1];
  proposals.movers.forEach((mover, place) => mover.path.forEach(([frame, x, y]) => {
    const away = Math.hypot(x - mark.at[0], y - mark.at[1]) + 5 * Math.abs(frame - mark.frame);
    if (away < best[0]) best = [away, place];
  }));
  return best[1];
}

/// The part that is measured: the frames that were set, or from the first free motion of the movers to the last one.
export function partOf(state) {
  const { settings, preview: { proposals, facts } } = state;
  if (settings.frames) return settings.frames;
  const pieces = (proposals?.pieces ?? []).filter((piece) => isTaken(state, piece.mover));
  if (!pieces.length) return [0, facts.frames];
  return [Math.min(...pieces.map((piece) => piece.start)), Math.max(...pieces.map((piece) => piece.end))];
}

export class Setup {
  /// `change` is called with new settings, whether they are to be saved now; `reveal` brings the video into view.
  constructor({ facts, equations, change, measure, seek, reveal }) {
    Object.assign(this, { facts, equations, change, measure, seek, reveal });
    this.mode = undefined;
    this.video = el("div", {});
    this.movers = el("div", { class: "rows" });
    this.part = el("div", {});
    this.scale = el("div", {});
    this.axes = el("div", {});
    this.equation = el("div", { class: "choices", role: "radiogroup", "aria-label": "Equation" });
    this.command = el("code", {});
    this.find = el("button", { class: "button primary wide", type: "button", id: "find", onclick: measure }, "Find it");
    this.node = el("div", { class: "setup" },
      this.step("Video", this.video),
      this.step("What moves", this.movers),
      this.step("Part", this.part),
      this.step("Scale", this.scale),
      this.step("Axes", this.axes),
      this.step("Equation", this.equation),
      el("div", { class: "finding" }, this.find,
        el("details", { class: "command" }, el("summary", {}, "The same as a command"), this.command,
          el("button", { class: "quiet small", type: "button", onclick: () => navigator.clipboard.writeText(this.command.textContent) }, "Copy"))));
  }

  step(title, node) {
    return el("section", { class: "step" }, el("h2", {}, title), node);
  }

  button(words, work, extra = {}) {
    return el("button", { class: "small", type: "button", onclick: work, ...extra }, words);
  }

  update(state) {
    this.state = state;
    const { settings, preview, preview_work: work, command } = state;
    // What is unchanged stays, with the focus and what is being typed.
    const shown = JSON.stringify([settings, preview, work, command, this.mode, this.firstEnd]);
    if (shown === this.shown) return;
    this.shown = shown;
    const focused = this.node.contains(document.activeElement) ? keyOf(document.activeElement) : undefined;
    this.command.textContent = command ?? "";
    this.showVideo(preview, work);
    this.showMovers(settings, preview.proposals, work);
    this.showPart(settings, preview.proposals);
    this.showScale(settings);
    this.showAxes(settings);
    this.showEquations(settings, preview.proposals);
    if (focused && !this.node.contains(document.activeElement)) [...this.node.querySelectorAll("button, input, select, summary")].find((it) => keyOf(it) === focused)?.focus({ preventScroll: true });
  }

  showVideo(preview, work) {
    const { width, height, frames, times, shown, remarks } = this.facts;
    const last = times?.at(-1);
    const rate = last ? ` · ${digits((frames - 1) / last, 4)} frames a second · ${last.toFixed(2)} s` : " · the file has no times";
    const notes = [...new Set([...remarks, ...(preview.proposals?.remarks ?? [])])];
    if (shown < frames) notes.push(`Only the first ${shown} frames are shown.`);
    const made = preview.made.pictures;
    this.video.replaceChildren(
      el("p", {}, `${width} × ${height} pixels · ${frames} frames${rate}`),
      ...(work.state === "running" && made < shown ? [el("progress", { max: shown, value: made, "aria-label": "Frames read" })] : []),
      ...(notes.length ? [el("details", {}, el("summary", {}, `${notes.length} remark${notes.length > 1 ? "s" : ""} on time and camera`), el("ul", { class: "notes" }, ...notes.map((note) => el("li", {}, note))))] : []),
      ...(times ? [] : [this.fps()]));
  }

  fps() {
    const input = el("input", { type: "number", min: 0.1, step: "any", value: this.state.settings.fps ?? "", "aria-label": "Frames a second" });
    input.addEventListener("change", () => this.change({ fps: Number(input.value) || null }));
    return el("label", { class: "field" }, "Frames a second", input);
  }

  showMovers(settings, proposals, work) {
    const rows = [];
    if (!proposals) rows.push(el("p", { class: "muted busy" }, work.state === "failed" ? work.reason : "Looking for what moves …"));
    else if (proposals.failure) rows.push(el("p", { class: "wrong" }, proposals.failure));
    proposals?.movers.forEach((mover, place) => {
      const [first] = mover.path;
      const last = mover.path.at(-1);
      const chosen = isTaken(this.state, place);
      rows.push(el("button", { class: chosen ? "row chosen" : "row", type: "button", "aria-pressed": String(chosen), onclick: () => this.choose(mover, place) },
        this.chip(place), el("span", {}, `Object ${place + 1}`), el("span", { class: "muted" }, `frames ${first[0]}–${last[0]}, Ø ${Math.round(mover.diameter)} px`)));
    });
    rows.push(el("div", { class: "buttons" },
      this.button(this.mode === "mark" ? "Click on the object …" : "Point at it", () => this.setMode("mark"), { "aria-pressed": String(this.mode === "mark"), id: "point" }),
      this.button(this.mode === "ignore" ? "Drag a box …" : "Leave an area out", () => this.setMode("ignore"), { "aria-pressed": String(this.mode === "ignore") }),
      ...(settings.marks.length || settings.ignore.length ? [this.button("Clear", () => this.change({ marks: [], ignore: [] }), { class: "quiet small" })] : [])));
    this.movers.replaceChildren(...rows);
  }

  chip(place) {
    return svg("svg", { viewBox: "0 0 12 12", class: "chip", "aria-hidden": "true" }, svg("circle", { cx: 6, cy: 6, r: 5, fill: COLOURS[place % COLOURS.length] }));
  }

  setMode(mode) {
    this.mode = this.mode === mode ? undefined : mode;
    this.firstEnd = undefined;
    if (this.mode) this.reveal();
    this.change({}, false);
  }

  choose(mover, place) {
    const [frame, x, y] = mover.path[Math.floor(mover.path.length / 2)];
    this.seek(frame);
    // The first object is what the program takes by itself.
    this.change({ marks: place === 0 ? [] : [{ frame, at: [x, y] }] });
  }

  showPart(settings, proposals) {
    const [start, end] = partOf(this.state);
    const choice = (words, frames, title) => this.button(words, () => {
      this.change({ frames });
      this.seek(partOf(this.state)[0]);
    }, { title, "aria-pressed": String(JSON.stringify(settings.frames) === JSON.stringify(frames)) });
    const chips = (proposals?.pieces ?? []).slice(0, 6).map((piece) => choice(`${piece.start}–${piece.end - 1}`, [piece.start, piece.end], piece.reason));
    this.part.replaceChildren(
      el("p", {}, settings.frames ? `Frames ${start} to ${end - 1}. ` : "All free motion that the program finds. ", el("span", { class: "muted" }, "Drag the ends of the filmstrip to take another part.")),
      el("div", { class: "buttons" }, choice("All free motion", null), ...chips, choice("Whole video", [0, this.facts.frames])));
  }

  showScale(settings) {
    const { stick } = settings;
    if (!stick) {
      const isOn = this.mode === "stick";
      const hint = this.firstEnd ? "Click on its other end." : "Click on one end of a known length in the plane of the motion.";
      // Without a pointer the stick is laid anywhere, and its ends are moved by arrow keys.
      const begin = (event) => (event.detail === 0 ? this.change({ stick: this.newStick() }) : this.setMode("stick"));
      this.scale.replaceChildren(
        isOn ? el("p", { role: "status" }, hint) : el("p", { class: "muted" }, "Without a known length the result comes in ", term("scale", "pixels"), "."),
        this.button(isOn ? "Cancel" : "Mark a known length with two clicks", begin, { id: "stick", "aria-pressed": String(isOn) }));
      return;
    }
    const length = el("input", { type: "number", min: 0, step: "any", value: stick.metres, id: "metres", "aria-label": "Length of the stick in metres" });
    length.addEventListener("change", () => { if (Number(length.value) > 0) this.change({ stick: { ...stick, metres: Number(length.value) } }); });
    const known = el("select", { "aria-label": "Known lengths", onchange: () => this.change({ stick: { ...stick, metres: Number(known.value) } }) },
      el("option", { value: "" }, "a known thing …"), ...LENGTHS.map(([metres, words]) => el("option", { value: metres }, words)));
    const pixels = Math.hypot(stick.to[0] - stick.from[0], stick.to[1] - stick.from[1]);
    this.scale.replaceChildren(
      el("p", {}, "How long is it? Its ends can be dragged."),
      el("div", { class: "buttons" }, el("label", { class: "field" }, length, " m"), known,
        this.button("Remove", () => this.change({ stick: null }), { class: "quiet small" })),
      el("p", { class: "muted" }, `${digits(pixels / stick.metres)} pixels to a metre`));
  }

  newStick() {
    const { width, height } = this.facts;
    const [x, y, half] = [width / 2, height * 0.85, (STICK * width) / 2];
    return { from: [x - half, y], to: [x + half, y], metres: 1 };
  }

  showAxes(settings) {
    if (!settings.origin) {
      this.axes.replaceChildren(
        el("p", { class: "muted" }, "Positions count from the top left corner, y upwards, unless you set an origin. g and the like do not depend on it."),
        this.button("Set origin and axes", () => this.change({ origin: [this.facts.width * 0.25, this.facts.height * 0.75] }), { id: "axes" }));
      return;
    }
    this.axes.replaceChildren(
      el("p", {}, `Origin ${settings.origin.map((it) => it.toFixed(0)).join(", ")}, x axis at ${digits(settings.angle, 3)}°. `, el("span", { class: "muted" }, "Drag the origin, or the arrow's tip to turn the axes.")),
      this.button("Remove", () => this.change({ origin: null, angle: 0 }), { class: "quiet small" }));
  }

  showEquations(settings, proposals) {
    const likely = proposals?.equation;
    const choice = (it) => {
      const chosen = settings.equation === it.key && settings.extended === null;
      const input = el("input", { type: "radio", name: "equation", value: it.key, checked: chosen });
      input.addEventListener("change", () => this.change({ equation: it.key, extended: null, objects: it.objects || settings.objects }));
      return el("label", { class: "choice" }, input,
        el("span", { class: "choice-title" }, it.title, likely === it.key ? el("span", { class: "badge likely" }, "looks like it") : undefined),
        el("span", { class: "formula" }, it.formula), el("span", { class: "muted choice-text" }, it.summary));
    };
    const fits = ({ objects }) => objects === 0 || objects === settings.objects;
    const others = this.equations.filter((it) => !fits(it));
    const isOpen = this.equation.querySelector("details")?.open;
    this.equation.replaceChildren(
      ...(settings.extended === null ? [] : [el("p", { class: "muted" }, `The equation of measurement ${settings.extended} with its missing term. Choose another one to leave it.`)]),
      ...this.equations.filter(fits).map(choice),
      el("details", { open: isOpen }, el("summary", {}, "For another number of objects"), ...others.map(choice)));
  }

  /// What is drawn on a stage.
  draw(stage, frame) {
    const { settings, preview } = this.state;
    const [start, end] = partOf(this.state);
    const drawn = [];
    for (const [x, y, width, height] of settings.ignore) drawn.push(svg("rect", { x, y, width, height, class: "ignored" }));
    (preview.proposals?.movers ?? []).forEach((mover, place) => {
      const colour = COLOURS[place % COLOURS.length];
      const inside = mover.path.filter(([number]) => number >= start && number < end);
      const line = stage.path(inside.map(([, x, y]) => [x, y]), "way");
      line.setAttribute("stroke", colour);
      drawn.push(line);
      const now = mover.path.find(([number]) => number === frame);
      if (now) drawn.push(svg("circle", { cx: now[1], cy: now[2], r: Math.max(mover.diameter / 2, 5 * stage.pixel), class: "mover", stroke: colour }));
    });
    for (const mark of settings.marks) drawn.push(svg("circle", { cx: mark.at[0], cy: mark.at[1], r: 5 * stage.pixel, class: mark.frame === frame ? "mark" : "mark faint" }));
    if (this.firstEnd) drawn.push(svg("circle", { cx: this.firstEnd[0], cy: this.firstEnd[1], r: 5 * stage.pixel, class: "mark" }));
    if (settings.origin) drawn.push(...this.drawAxes(stage, settings));
    if (settings.stick) drawn.push(...this.drawStick(stage, settings.stick));
    return drawn;
  }

  drawStick(stage, stick) {
    const { from, to } = stick;
    const end = (name) => stage.handle({
      at: stick[name], label: name === "from" ? "First end of the stick" : "Second end of the stick", kind: `stick-${name}`,
      move: (at) => this.change({ stick: { ...this.state.settings.stick, [name]: at } }, false), done: () => this.change({}),
    });
    const middle = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2 - 8 * stage.pixel];
    const isLeft = middle[0] < 0.8 * this.facts.width;
    const length = stage.text([middle[0] + (isLeft ? 8 : -8) * stage.pixel, middle[1]], `${stick.metres} m`, isLeft ? "tag" : "tag end");
    return [stage.line(from, to, "stick-under"), stage.line(from, to, "stick"), length, end("from"), end("to")];
  }

  drawAxes(stage, settings) {
    const { origin, angle } = settings;
    const length = 70 * stage.pixel;
    const [cos, sin] = [Math.cos((angle * Math.PI) / 180), Math.sin((angle * Math.PI) / 180)];
    const x = [origin[0] + length * cos, origin[1] - length * sin];
    const y = [origin[0] - length * sin, origin[1] - length * cos];
    const gap = 10 * stage.pixel;
    return [
      stage.line(origin, x, "axis"), stage.line(origin, y, "axis"),
      stage.text([x[0] + gap, x[1] + gap / 2], "x"), stage.text([y[0] + gap / 2, y[1] - gap / 2], "y"),
      stage.handle({ at: x, label: "Direction of the x axis", kind: "axis-tip", done: () => this.change({}),
        move: (at) => this.change({ angle: this.angle(this.state.settings.origin, at) }, false) }),
      stage.handle({ at: origin, label: "Origin", kind: "origin", done: () => this.change({}),
        move: (at) => this.change({ origin: at }, false) }),
    ];
  }

  /// Degrees, counter-clockwise; near a level or an upright axis just that.
  angle(origin, at) {
    const degrees = (Math.atan2(origin[1] - at[1], at[0] - origin[0]) * 180) / Math.PI;
    const right = 90 * Math.round(degrees / 90);
    return Math.abs(degrees - right) < 1.5 ? right : Math.round(10 * degrees) / 10;
  }

  /// An end of the stick: two clicks, or one drag.
  markEnd(stage, at) {
    if (this.firstEnd) {
      this.finishStick(at);
      return;
    }
    this.firstEnd = at;
    this.change({}, false);
    const lift = (event) => {
      const end = stage.place(event);
      if (this.firstEnd && Math.hypot(end[0] - at[0], end[1] - at[1]) > DRAGGED * stage.pixel) this.finishStick(end);
    };
    window.addEventListener("pointerup", lift, { once: true });
  }

  finishStick(to) {
    const from = this.firstEnd;
    if (Math.hypot(to[0] - from[0], to[1] - from[1]) < 1) return;
    this.mode = this.firstEnd = undefined;
    this.change({ stick: { from, to, metres: 1 } });
    const length = this.scale.querySelector("#metres");
    length.focus();
    length.select();
  }

  /// A press on the video itself: points at an object, or begins a box.
  press(stage, event, frame) {
    if (this.mode === "stick") this.markEnd(stage, stage.place(event));
    else if (this.mode === "mark") {
      this.mode = undefined;
      this.change({ marks: [...this.state.settings.marks, { frame, at: stage.place(event) }] });
    } else if (this.mode === "ignore") {
      const from = stage.place(event);
      const box = (to) => [Math.min(from[0], to[0]), Math.min(from[1], to[1]), Math.abs(to[0] - from[0]) + 1, Math.abs(to[1] - from[1]) + 1].map(Math.floor);
      const others = this.state.settings.ignore;
      const drag = (moved) => this.change({ ignore: [...others, box(stage.place(moved))] }, false);
      const end = () => {
        window.removeEventListener("pointermove", drag);
        window.removeEventListener("pointerup", end);
        this.mode = undefined;
        this.change({});
      };
      window.addEventListener("pointermove", drag);
      window.addEventListener("pointerup", end);
    }
  }
}
