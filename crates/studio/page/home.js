// The first view: a place to drop a video, generated examples, all projects.

import * as api from "./api.js";
import { attempt, el, powers, svg } from "./dom.js";

const KINDS = "video/*,.mp4,.mov,.m4v,.avi,.mkv,.webm,.gif,.npz,.zip,image/png,image/jpeg";
const OUTCOMES = { found: "found", doubtful: "doubtful", not_found: "not found" };

const goTo = (name) => { location.hash = `#/p/${name}`; };

async function bring(files, bar) {
  const list = [...files];
  if (!list.length) return;
  const pictures = list.every((file) => file.type.startsWith("image/") && file.type !== "image/gif");
  // Several videos are several projects; pictures are the frames of one.
  const groups = pictures ? [list] : list.map((file) => [file]);
  let last;
  for (const group of groups) {
    const { name } = await api.create({ title: group[0].name });
    try {
      let sent = 0;
      for (const file of group) {
        await api.upload(name, file, (share) => bar((sent + share) / group.length, file.name));
        sent += 1;
      }
      await api.startPreview(name);
    } catch (error) {
      await api.remove(name);
      throw error;
    } finally {
      bar(undefined);
    }
    last = name;
  }
  if (groups.length === 1) goTo(last);
}

function dropZone(refresh) {
  const input = el("input", { type: "file", accept: KINDS, multiple: true, id: "file", class: "hidden-input" });
  const bar = el("progress", { max: 1, value: 0, hidden: true, "aria-label": "Upload" });
  const label = el("p", { class: "muted", id: "upload-label" }, "mp4, mov, webm, avi, gif, or all pictures of a series. It stays on this computer.");
  const words = label.textContent;
  const progress = (share, name) => {
    bar.hidden = share === undefined;
    bar.value = share ?? 0;
    label.textContent = share === undefined ? words : `${name}: ${Math.round(100 * share)} %`;
  };
  const take = (files) => attempt(async () => {
    await bring(files, progress);
    await refresh();
  });
  input.addEventListener("change", () => take(input.files));
  const zone = el("div", { class: "drop" },
    svg("svg", { viewBox: "0 0 120 60", class: "arc", "aria-hidden": "true" },
      svg("path", { d: "M6 54C26 0 60-6 112 50" }),
      ...[[10, 44, 3], [28, 20, 4], [54, 8, 5], [84, 19, 6], [108, 45, 7]].map(([cx, cy, r]) => svg("circle", { cx, cy, r }))),
    el("h1", {}, "Measure the physics in your own video"),
    el("p", { class: "lead" }, "Drop a video of something that moves. Show a known length. Get g, a spring constant, a damping – with intervals and a verdict."),
    el("label", { class: "button primary", for: "file" }, "Choose a video"), input, bar, label);
  const over = (on) => (event) => {
    event.preventDefault();
    zone.classList.toggle("over", on);
  };
  zone.addEventListener("dragover", over(true));
  zone.addEventListener("dragleave", over(false));
  zone.addEventListener("drop", (event) => {
    over(false)(event);
    take(event.dataTransfer.files);
  });
  return zone;
}

const SKETCHES = {
  throw: () => [svg("path", { d: "M10 64C30 4 60 4 88 62", class: "way" }), svg("rect", { x: 100, y: 24, width: 4, height: 42, class: "stick" }), svg("circle", { cx: 62, cy: 24, r: 6 })],
  pendulum: () => [svg("path", { d: "M24 52Q60 82 96 52", class: "way" }), svg("path", { d: "M60 8L88 58", class: "line" }), svg("circle", { cx: 88, cy: 58, r: 7 })],
  bounce: () => [svg("path", { d: "M10 14Q26 14 32 66Q48 6 62 66Q74 24 86 66Q94 40 104 66", class: "way" }), svg("path", { d: "M4 72H116", class: "line" }), svg("circle", { cx: 48, cy: 36, r: 6 })],
};

function example(it) {
  return el("button", { class: "card example", type: "button", "data-example": it.key, onclick: () => attempt(async () => goTo((await api.create({ example: it.key })).name)) },
    svg("svg", { viewBox: "0 0 120 80", "aria-hidden": "true" }, ...SKETCHES[it.key]()),
    el("strong", {}, it.title), el("span", { class: "muted" }, it.summary));
}

function card(it, refresh) {
  const picture = it.picture === null
    ? el("div", { class: "picture empty" })
    : el("img", { class: "picture", alt: "", loading: "lazy", src: api.frameAddress(it.name, `small-${it.picture}`, it.created) });
  const forget = el("button", { class: "quiet small", type: "button", "aria-label": `Delete ${it.title}`, onclick: () => attempt(async () => {
    if (!confirm(`Delete “${it.title}” with its video and all results? This cannot be undone.`)) return;
    await api.remove(it.name);
    await refresh();
  }) }, "Delete");
  return el("article", { class: "card project" },
    el("a", { href: `#/p/${it.name}` }, picture, el("strong", {}, it.title)),
    el("span", { class: "muted" }, it.equation ?? ""),
    el("span", { class: "value" }, it.running ? "working …" : it.value ? powers(it.value) : "not measured yet"),
    el("div", { class: "foot" }, it.outcome ? el("span", { class: `badge ${it.outcome}` }, OUTCOMES[it.outcome]) : el("span", {}), forget));
}

/// A result of the commands. Its page opens in a tab of its own; there is nothing to delete here.
function resultCard(it) {
  const picture = it.picture ? el("img", { class: "picture", alt: "", loading: "lazy", src: api.resultFile(it.place, it.picture) }) : el("div", { class: "picture empty" });
  const title = el("strong", {}, it.place);
  return el("article", { class: "card project result-card" },
    it.page ? el("a", { href: api.resultFile(it.place, it.page), target: "_blank", rel: "noopener" }, picture, title) : el("div", {}, picture, title),
    el("span", { class: "muted" }, it.equation ?? ""),
    el("span", { class: "value" }, it.value ? powers(it.value) : "not measured yet"),
    el("div", { class: "foot" }, it.outcome ? el("span", { class: `badge ${it.outcome}` }, OUTCOMES[it.outcome]) : undefined));
}

export async function home() {
  const [offered, first, found] = await Promise.all([api.offers(), api.projects(), api.results()]);
  const list = el("div", { class: "cards" });
  const section = el("section", { "aria-labelledby": "projects" }, el("h2", { id: "projects" }, "Your projects"), list);
  const refresh = async () => fill(await api.projects());
  let shown;
  const fill = (cards) => {
    // What is unchanged keeps the focus.
    if (JSON.stringify(cards) === shown) return;
    shown = JSON.stringify(cards);
    section.hidden = cards.length === 0;
    list.replaceChildren(...cards.map((it) => card(it, refresh)));
  };
  fill(first);
  const timer = setInterval(() => refresh().catch(() => {}), 3000);
  const node = el("div", { class: "home" }, dropZone(refresh),
    el("section", { "aria-labelledby": "try" }, el("h2", { id: "try" }, "Try it without a video"),
      el("p", { class: "muted" }, "Three generated films with a known answer. The whole way takes two minutes."),
      el("div", { class: "cards examples" }, ...offered.examples.map(example))),
    section,
    found.length ? el("section", { "aria-labelledby": "commands" }, el("h2", { id: "commands" }, "From the command line"),
      el("div", { class: "cards" }, ...found.map(resultCard))) : undefined);
  return { node, leave: () => clearInterval(timer) };
}
