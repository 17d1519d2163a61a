// What was found: verdict, quantities with intervals, overlay, charts, downloads.

import * as api from "./api.js";
import { Chart } from "./charts.js";
import { attempt, digits, el, powers, rounded, show, svg, term, words } from "./dom.js";

const VERDICTS = {
  found: ["Found", "The numbers can be quoted with their intervals."],
  doubtful: ["Doubtful", "Something speaks against the numbers:"],
  not_found: ["Not found", "The equation does not describe this motion:"],
};
/// Equations that are listed at once.
const SHOWN = 4;
const FILES = [["measurement.html", "Page (HTML)"], ["positions.csv", "Positions (CSV)"], ["measurement.json", "Numbers (JSON)"], ["measurement-positions.png", "Figure (PNG)"], ["overlay.gif", "Overlay (GIF)"]];

/// The rows of positions.csv; its first fifteen columns have this order.
function readPositions(text) {
  const [head, ...lines] = text.trim().split("\n");
  const unit = head.split(",")[9].split("_").at(-1);
  const rows = lines.map((line) => line.split(",")).filter((cells) => cells.length >= 15).map((cells) => {
    const [frame, seconds, object, , ox, oy, fx, fy, x, y, X, Y, vx, vy] = cells.slice(1, 15).map((cell) => (cell === "" ? NaN : Number(cell)));
    return { take: cells[0], frame, seconds, object, heldOut: cells[4] === "held out", observed: [ox, oy], fitted: [fx, fy], place: [x, y], fittedPlace: [X, Y], velocity: [vx, vy] };
  });
  return { unit, rows, byFrame: grouped(rows, (row) => row.frame), ways: [...grouped(rows, (row) => `${row.take} ${row.object}`).values()] };
}

function grouped(rows, key) {
  const groups = new Map();
  rows.forEach((row) => groups.set(key(row), [...(groups.get(key(row)) ?? []), row]));
  return groups;
}

export class Result {
  /// `measureBy` measures again with some settings changed.
  constructor({ name, facts, equations, seek, measureBy, stop, edit }) {
    Object.assign(this, { name, facts, equations, seek, measureBy, stop, edit });
    this.node = el("div", { class: "result" });
    this.charts = el("div", { class: "charts" });
    this.elapsed = el("p", { class: "muted number" });
    this.plots = [];
    this.shown = undefined;
  }

  update(state) {
    const { measured } = state;
    if (!measured) return;
    this.elapsed.textContent = `${measured.seconds ?? 0} s so far.`;
    const key = `${measured.number} ${measured.work.state}`;
    if (key === this.shown) return;
    this.shown = key;
    this.measured = measured;
    if (measured.work.state === "running") this.showWork();
    else if (measured.work.state !== "done" || !measured.result) this.showFailure(measured.work.reason);
    else this.showResult(measured);
  }

  showWork() {
    this.positions = undefined;
    this.charts.replaceChildren();
    this.node.replaceChildren(el("div", { class: "working", role: "status" }, el("h2", {}, "Measuring …"),
      el("p", { class: "muted" }, "Tracks the object in every frame, fits the equation to all of them as one motion, and tests it on the last quarter. Choosing among all equations takes up to some minutes. You may close this page."),
      el("progress", { "aria-label": "Measuring" }), this.elapsed, el("button", { class: "small", type: "button", onclick: this.stop }, "Stop")));
  }

  showFailure(reason) {
    this.positions = undefined;
    this.charts.replaceChildren();
    this.node.replaceChildren(el("div", { class: "verdict not_found", role: "status" }, el("h2", {}, "No result"), el("p", {}, reason ?? "It was stopped.")),
      el("button", { class: "button primary wide", type: "button", onclick: this.edit }, "Change the set-up"));
  }

  showResult(measured) {
    const { result } = measured;
    const [title, sentence] = VERDICTS[result.verdict?.outcome] ?? ["Measured", ""];
    const reasons = result.verdict?.reasons ?? [];
    show(this.node,
      el("div", { class: `verdict ${result.verdict?.outcome ?? ""}`, role: "status", "data-outcome": result.verdict?.outcome },
        el("h2", {}, term("verdict", title)), el("p", {}, sentence), reasons.length ? el("ul", {}, ...reasons.map((it) => el("li", {}, it))) : undefined),
      this.quantities(result),
      el("p", { id: "equation-taken" }, "Equation: ", el("strong", {}, this.title(result.equation)), this.wasChosen() ? " (chosen by the program)" : ""),
      this.prediction(result),
      this.missing(result),
      this.comparison(result),
      result.notes.length ? el("details", {}, el("summary", {}, `${result.notes.length} note${result.notes.length > 1 ? "s" : ""}`), el("ul", { class: "notes" }, ...result.notes.map((it) => el("li", {}, it)))) : undefined,
      el("section", { class: "step" }, el("h2", {}, "Downloads"), el("div", { class: "buttons" }, ...FILES.map(([file, label]) => el("a", { class: "button small", href: `${api.resultAddress(this.name, measured.number, file)}?save=yes`, download: "" }, label)))),
      measured.command ? el("details", { class: "command" }, el("summary", {}, "The same as a command"), el("code", {}, measured.command)) : undefined);
    attempt(async () => {
      this.positions = readPositions(await api.ask("GET", api.resultAddress(this.name, measured.number, "positions.csv")));
      this.plot(result, this.positions.rows[0].take);
      this.seek(this.positions.rows[0].frame);
    });
  }

  quantities(result) {
    const rows = result.quantities.map((it) => el("tr", { class: it.outcome ?? "", "data-quantity": it.name },
      el("th", { scope: "row" }, words(it.name)),
      el("td", { class: "number" }, rounded(it.value, it.low, it.high), " ", el("span", { class: "unit" }, powers(it.unit))),
      el("td", { class: "number muted" }, it.low === null ? "–" : `${rounded(it.low, it.low, it.high)} … ${rounded(it.high, it.low, it.high)}`),
      el("td", {}, it.outcome ? el("span", { class: `mark-${it.outcome}`, title: words(it.outcome), role: "img", "aria-label": words(it.outcome) }, { found: "✓", doubtful: "?", not_found: "×" }[it.outcome]) : "")));
    return el("table", { class: "quantities" },
      el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Quantity"), el("th", { scope: "col" }, "Value"), el("th", { scope: "col" }, term("interval", "95 % interval")), el("th", { scope: "col" }, el("span", { class: "unseen" }, "Outcome")))),
      el("tbody", {}, ...rows));
  }

  prediction(result) {
    const it = result.held_out;
    return el("p", { class: "muted" }, "The last ", String(it.frames), " frames were ", term("held out"), " and predicted to ",
      `${digits(it.error, 3)} ${it.unit} (${digits(it.percent_of_amplitude, 2)} % of the amplitude); constant velocity misses by ${digits(it.constant_velocity, 3)} ${it.unit}.`);
  }

  wasChosen() {
    const { settings } = this.measured;
    return settings?.equation === "auto" && settings.extended === null;
  }

  missing({ missing }) {
    if (!missing) return undefined;
    const [before, after] = missing.held_out_error;
    const sizes = missing.quantities.map((it) => `${words(it.name)} = ${rounded(it.value, it.low, it.high)} ${powers(it.unit)}`).join(", ");
    return el("section", { class: "step", id: "missing" }, el("h2", {}, term("missing term", "A term is missing")),
      el("p", {}, el("strong", {}, missing.name), `: ${sizes}. With it the held-out part is predicted to ${digits(after, 3)} instead of ${digits(before, 3)}.`),
      missing.equation ? el("button", { class: "small", type: "button", id: "extend", onclick: () => this.measureBy({ extended: this.measured.number }) }, "Measure with this term") : undefined);
  }

  /// The equation among those that were fitted to the same positions, the best prediction first.
  comparison(result) {
    if (!result.alternatives.length) return el("button", { class: "small", type: "button", id: "compare", onclick: () => this.measureBy({ equation: "auto", extended: null }) }, "Compare with all other equations");
    const ranked = [...result.alternatives].sort((a, b) => (a.equation === result.equation ? -1 : b.equation === result.equation ? 1 : a.held_out_error - b.held_out_error));
    const least = Math.min(...ranked.map((it) => it.bic));
    const row = (it) => el("tr", { class: it.equation === result.equation ? "best" : "" }, el("th", { scope: "row" }, this.title(it.equation)),
      el("td", { class: "number" }, digits(it.held_out_error, 3)), el("td", { class: "number" }, (it.bic - least).toFixed(0)),
      el("td", {}, it.equation === result.equation || !this.offers(it.equation) ? "" : el("button", { class: "quiet small", type: "button", "aria-label": `Measure by ${this.title(it.equation)}`, onclick: () => this.measureBy({ equation: it.equation, extended: null }) }, "take it")));
    const table = (rows) => el("table", { class: "quantities" },
      el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Equation"), el("th", { scope: "col" }, term("held out"), `, ${result.residuals.unit}`), el("th", { scope: "col" }, term("BIC", "BIC")), el("th", { scope: "col" }, el("span", { class: "unseen" }, "Choice")))), el("tbody", {}, ...rows.map(row)));
    const rest = ranked.slice(SHOWN);
    return el("section", { class: "step", id: "alternatives" }, el("h2", {}, "Which equation"), table(ranked.slice(0, SHOWN)),
      rest.length ? el("details", {}, el("summary", {}, `${rest.length} more`), table(rest)) : undefined);
  }

  offers(key) {
    return this.equations.some((it) => it.key === key);
  }

  title(file) {
    if (file.endsWith(".toml")) return "with the missing term";
    return this.equations.find((it) => file === it.key)?.title ?? words(file);
  }

  /// The first object in one of the parts that are measured together.
  plot(result, take) {
    const { unit, rows } = this.positions;
    this.take = take;
    const first = rows.filter((row) => row.object === 1 && row.take === take);
    const held = first.find((row) => row.heldOut)?.seconds;
    const end = first.at(-1).seconds;
    const points = (value) => first.map((row) => [row.seconds, value(row)]);
    const g = result.quantities.find((it) => it.name === "g" && it.unit === "m/s^2")?.value;
    const speed = (row) => Math.hypot(...row.velocity);
    // Across a bounce a difference of positions is no velocity.
    const difference = (axis) => first.slice(1, -1).map((row, place) => {
      const [before, after] = [first[place], first[place + 2]];
      return [row.seconds, (after.place[axis] - before.place[axis]) / (after.seconds - before.seconds)];
    });
    const pair = (axis, of) => [
      { kind: "line", colour: "fitted", name: "fitted", until: held, points: points((row) => (of === "place" ? row.fittedPlace : row.velocity)[axis]) },
      { kind: "line", colour: "predicted", name: "predicted", from: held, points: points((row) => (of === "place" ? row.fittedPlace : row.velocity)[axis]) },
      { kind: "dots", colour: "observed", name: "observed", points: of === "place" ? points((row) => row.place[axis]) : difference(axis) },
    ];
    const energy = [{ kind: "line", colour: "observed", name: "kinetic", points: points((row) => speed(row) ** 2 / 2) }];
    if (g !== undefined) {
      energy.push({ kind: "line", colour: "fitted", name: "potential", points: points((row) => g * row.fittedPlace[1]) });
      energy.push({ kind: "line", colour: "predicted", name: "total", points: points((row) => speed(row) ** 2 / 2 + g * row.fittedPlace[1]) });
    }
    const plots = [
      [["x, ", unit], pair(0, "place")], [["y, ", unit], pair(1, "place")],
      [[`x velocity, ${unit}/s`], pair(0, "velocity")], [[`y velocity, ${unit}/s`], pair(1, "velocity")],
      [[term("residual", "Residuals"), ", px"], [0, 1].map((axis) => ({ kind: "line", colour: axis ? "fitted" : "observed", name: axis ? "y" : "x", points: points((row) => row.observed[axis] - row.fitted[axis]) }))],
      [[term("energy", "Energy"), unit === "m" ? ", J/kg" : `, ${unit}²/s²`], energy],
    ];
    this.plots = plots.map(([title, series]) => new Chart({ title, series, held, end, pick: (seconds) => this.seek(this.frameAt(first, seconds)) }));
    this.charts.replaceChildren(
      el("p", { class: "legend" }, el("span", { class: "key observed" }), term("observed"), el("span", { class: "key fitted" }), term("fitted"), el("span", { class: "key predicted" }), term("predicted"), el("span", { class: "muted" }, "Drag to zoom, double-click to zoom out.")),
      el("div", { class: "grid" }, ...this.plots.map((plot) => plot.node)));
  }

  frameAt(rows, seconds) {
    return rows.reduce((best, row) => (Math.abs(row.seconds - seconds) < Math.abs(best.seconds - seconds) ? row : best)).frame;
  }

  showFrame(frame) {
    const row = this.positions?.byFrame.get(frame)?.[0];
    if (row && row.take !== this.take) this.plot(this.measured.result, row.take);
    this.plots.forEach((plot) => plot.mark(row?.seconds));
  }

  /// The observed way, the fitted and the predicted one, and all three in this frame.
  draw(stage, frame) {
    if (!this.positions) return [];
    const drawn = [];
    for (const rows of this.positions.ways) {
      const until = rows.findIndex((row) => row.heldOut);
      const split = until < 0 ? rows.length : until;
      drawn.push(stage.path(rows.slice(0, split + 1).map((row) => row.fitted), "way fitted"), stage.path(rows.slice(split).map((row) => row.fitted), "way predicted"));
      for (const row of rows) if (Number.isFinite(row.observed[0])) drawn.push(svg("circle", { cx: row.observed[0], cy: row.observed[1], r: 2 * stage.pixel, class: "trace" }));
    }
    for (const row of this.positions.byFrame.get(frame) ?? []) {
      if (Number.isFinite(row.observed[0])) drawn.push(svg("circle", { cx: row.observed[0], cy: row.observed[1], r: 10 * stage.pixel, class: "now observed" }));
      drawn.push(svg("circle", { cx: row.fitted[0], cy: row.fitted[1], r: 4 * stage.pixel, class: `now ${row.heldOut ? "predicted" : "fitted"}` }));
    }
    return drawn;
  }
}
