// Training from pixels: phase, time left, what the model draws, parameters over time; stop and resume.

import * as api from "./api.js";
import { Chart } from "./charts.js";
import { attempt, digits, el, powers, rounded, term, words } from "./dom.js";

const PHASES = { import: "Cutting the video into clips", discover: "Finding the objects", coarse: "Finding the objects, coarsely", identify: "Fitting the equation", join: "Learning all together", scoring: "Scoring", pictures: "Drawing pictures", measuring: "Measuring" };

function left(seconds) {
  if (seconds === null || seconds === undefined) return "";
  return seconds < 90 ? `at most ${Math.ceil(seconds)} s left` : `at most ${Math.ceil(seconds / 60)} min left`;
}

export class Learn {
  constructor({ name, train, stop }) {
    Object.assign(this, { name, train, stop });
    this.picture = el("img", { class: "drawing", alt: "A clip as the model draws it: prediction, truth, reconstruction" });
    this.drawn = el("figure", { hidden: true }, el("figcaption", {}, "Prediction, truth, reconstruction"), this.picture);
    this.plots = el("div", { class: "grid" });
    this.charts = el("div", { class: "charts" }, this.drawn, this.plots);
    this.node = el("div", { class: "result" });
  }

  update(state) {
    this.trained = state.trained;
    const { trained } = this;
    if (!trained) return this.offer();
    const { work, live, result } = trained;
    const parts = [];
    if (work.state === "running") parts.push(this.progress(live), el("button", { class: "small", type: "button", id: "stop-training", onclick: this.stop }, "Stop (it can be resumed)"));
    else if (work.state === "done") parts.push(el("h2", {}, "Learned"), result ? this.table(result) : undefined);
    else {
      parts.push(el("div", { class: "verdict doubtful", role: "status" }, el("h2", {}, work.state === "stopped" ? "Stopped" : "It failed"), el("p", {}, work.reason ?? "What was learned is saved.")));
      // An import that failed fails again.
      if (work.state === "stopped" || live?.phase !== "import") parts.push(el("button", { class: "button primary wide", type: "button", id: "resume", onclick: () => this.train(true) }, "Resume"));
    }
    if (work.state !== "running") parts.push(el("button", { class: "small", type: "button", onclick: () => this.train(false) }, "Train anew with the present set-up"));
    this.drawn.hidden = !live?.pictures;
    if (live?.pictures) {
      const address = `${api.trainingAddress(this.name, trained.number, "preview.png")}?v=${live.pictures}`;
      if (this.picture.getAttribute("src") !== address) this.picture.src = address;
    }
    if (live && live.phase !== "import" && work.state !== "running") parts.push(el("a", { class: "button small", href: api.trainingAddress(this.name, trained.number, "task.zip"), download: "" }, "Task folder (ZIP)"));
    parts.push(el("details", { class: "command" }, el("summary", {}, "The same as commands"), ...trained.commands.map((it) => el("code", {}, it))));
    this.node.replaceChildren(...parts.filter(Boolean));
    this.course();
    return undefined;
  }

  offer() {
    this.node.replaceChildren(
      el("p", {}, "“Find it” tracks the object and fits the equation to its positions. Here a neural network learns from the pixels alone what the objects are, how they look and what moves them, given only the equation."),
      el("p", { class: "muted" }, "It needs some 80 frames, takes minutes to an hour, and goes on when you close the page."),
      el("button", { class: "button primary wide", type: "button", id: "train", onclick: () => this.train(false) }, "Start to learn"));
  }

  progress(live) {
    const phase = live?.phase ?? "import";
    const parameters = Object.entries(live?.parameters ?? {});
    return el("div", { class: "working", role: "status", "data-phase": phase }, el("h2", {}, `${PHASES[phase] ?? phase} …`),
      live?.of ? el("progress", { max: live.of, value: live.done, "aria-label": phase }) : el("progress", { "aria-label": phase }),
      el("p", { class: "muted" }, [live?.of ? `step ${live.done} of at most ${live.of}` : "", left(live?.seconds_left), live?.loss ? `loss ${digits(live.loss, 3)}` : ""].filter(Boolean).join(" · ")),
      parameters.length ? el("table", { class: "quantities" }, el("tbody", {}, ...parameters.map(([name, value]) => el("tr", {}, el("th", { scope: "row" }, words(name)), el("td", { class: "number" }, digits(value, 4)), el("td", { class: "muted" }, "pixels of a frame"))))) : undefined);
  }

  table(result) {
    return el("table", { class: "quantities" }, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Quantity"), el("th", { scope: "col" }, "Value"), el("th", { scope: "col" }, term("interval", "95 % interval")))),
      el("tbody", {}, ...result.quantities.map((it) => el("tr", { "data-learned": it.name }, el("th", { scope: "row" }, words(it.name)), el("td", { class: "number" }, rounded(it.value, it.low, it.high), " ", el("span", { class: "unit" }, powers(it.unit))),
        el("td", { class: "number muted" }, it.low === null ? "–" : `${rounded(it.low, it.low, it.high)} … ${rounded(it.high, it.low, it.high)}`)))));
  }

  /// Losses and parameters over time, from the run's own records.
  course() {
    const key = `${this.trained.number} ${this.trained.records}`;
    if (key === this.shown || !this.trained.records) return;
    this.shown = key;
    attempt(async () => {
      const text = await api.ask("GET", api.trainingAddress(this.name, this.trained.number, "metrics.jsonl"));
      const records = text.trim().split("\n").map((line) => JSON.parse(line)).filter((it) => it.seconds !== undefined);
      const known = new Set(["kind", "phase", "seconds", "step", "epoch", "score", "residual", "iterations"]);
      const names = Object.keys(this.trained.live?.parameters ?? {});
      const series = (name, of) => ({ kind: "line", colour: "fitted", name, points: records.filter((it) => Number.isFinite(of(it))).map((it) => [it.seconds, of(it)]) });
      const end = records.at(-1)?.seconds ?? 1;
      const plots = [new Chart({ title: ["Loss (logarithm to base 10)"], series: [series("log loss", (it) => (it.kind === "train" ? Math.log10(it.train_loss) : NaN))], end, pick: () => {} }),
        ...names.filter((name) => !known.has(name)).map((name) => new Chart({ title: [words(name)], series: [series(words(name), (it) => it[name])], end, pick: () => {} }))];
      this.plots.replaceChildren(...plots.map((plot) => plot.node));
    });
  }
}
