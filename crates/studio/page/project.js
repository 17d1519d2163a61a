// A project: the video with its timeline, and beside it what is set or what was found.

import * as api from "./api.js";
import { attempt, el, notice } from "./dom.js";
import { Learn } from "./learn.js";
import { Result } from "./result.js";
import { Setup, partOf } from "./setup.js";
import { Stage } from "./stage.js";
import { Timeline } from "./timeline.js";

/// Milliseconds between two requests: until the first frame is there, while something runs, and else.
const FIRST = 150;
const POLL = 700;
const REST = 3000;
const TABS = { setup: "Set up", result: "Result", learn: "Learn" };

/// Waits until the file is understood, or tells why it is not.
function waiting(state) {
  const { state: work, reason } = state.preview_work;
  if (work === "failed") return [el("h1", {}, "This file could not be read"), el("p", { class: "wrong" }, reason), el("p", {}, el("a", { href: "#/" }, "Choose another one"))];
  const title = state.record.example ? "Making the film …" : "Reading the video …";
  return [el("h1", {}, title), el("progress", { "aria-label": title })];
}

export async function projectView(name) {
  const [{ equations }, first] = await Promise.all([api.offers(), api.project(name)]);
  const node = el("div", { class: "project-view" });
  let state = first;
  let view;
  let timer;
  let gone = false;

  const receive = (next) => {
    state = next;
    if (!view && state.preview.facts) {
      view = new ProjectView(state, equations);
      node.replaceChildren(view.node);
      view.start();
    } else if (view) view.update(state);
    else node.replaceChildren(el("div", { class: "waiting" }, ...waiting(state)));
  };
  const poll = async () => {
    try {
      const next = await api.project(name);
      if (gone) return;
      // What is being dragged is not taken back by an older answer.
      if (!view?.busy) receive(next);
    } catch (error) {
      if (!gone) notice(error.message, true);
    }
    const works = state.preview_work.state === "running" || state.measured?.work.state === "running" || state.trained?.work.state === "running";
    if (!gone) timer = setTimeout(poll, !works ? REST : view?.stage.canvas.dataset.frame === undefined ? FIRST : POLL);
  };
  return {
    node,
    title: state.record.title,
    shown: () => {
      receive(state);
      poll();
    },
    leave: () => {
      gone = true;
      clearTimeout(timer);
      view?.leave();
    },
  };
}

class ProjectView {
  constructor(state, equations) {
    this.state = state;
    const { facts } = state.preview;
    const address = (frame) => api.frameAddress(state.name, frame, state.record.created);
    this.stage = new Stage(facts, address);
    this.timeline = new Timeline({
      facts,
      stripAddress: (frame) => address(`small-${frame}`),
      change: (frame) => this.showFrame(frame),
      part: (frames) => this.change({ frames }),
    });
    this.setup = new Setup({
      facts, equations,
      change: (settings, save) => this.change(settings, save),
      measure: () => this.measure(),
      seek: (frame) => this.timeline.go(frame),
      reveal: () => this.stage.node.scrollIntoView({ block: "nearest" }),
    });
    this.result = new Result({ name: state.name, facts, equations, seek: (frame) => this.timeline.go(frame), measureBy: (settings) => {
        this.change(settings);
        this.measure();
      }, stop: () => attempt(() => api.stop(state.name)), edit: () => this.open("setup") });
    this.learn = new Learn({ name: state.name, train: (resume) => this.train(resume), stop: () => attempt(() => api.stop(state.name)) });
    this.tabs = Object.entries(TABS).map(([tab, words]) => el("button", { class: "tab", type: "button", role: "tab", id: `tab-${tab}`, "aria-controls": "panel", onclick: () => this.open(tab) }, words));
    this.panel = el("div", { class: "panel-body", id: "panel", role: "tabpanel" });
    this.below = el("div", { class: "below" });
    this.node = el("div", { class: "work" },
      el("div", { class: "left" }, this.stage.node, this.timeline.node, this.below),
      el("aside", { class: "panel" }, el("div", { class: "tabs", role: "tablist" }, ...this.tabs), this.panel));
    this.stage.overlay.addEventListener("pointerdown", (event) => this.tab === "setup" && this.setup.press(this.stage, event, this.timeline.frame));
    this.stage.onresize = () => this.draw();
    this.keys = (event) => {
      if (!event.target.closest("input:not([type=range]), select, textarea, [data-handle], .end, button, summary, label")) this.timeline.key(event);
    };
    document.addEventListener("keydown", this.keys);
  }

  start() {
    this.setup.update(this.state);
    this.open(this.state.measured ? "result" : "setup");
    this.update(this.state);
    this.timeline.go(partOf(this.state)[0]);
  }

  leave() {
    this.timeline.pause();
    this.stage.leave();
    document.removeEventListener("keydown", this.keys);
  }

  update(state) {
    const had = this.timeline.available;
    this.state = state;
    const { facts, made, proposals } = state.preview;
    this.timeline.setAvailable(Math.min(made.pictures, facts.shown));
    this.timeline.setPieces(proposals?.pieces ?? []);
    this.timeline.setRange(partOf(state));
    this.setup.update(state);
    this.result.update(state);
    this.learn.update(state);
    if (had <= this.timeline.frame + 1 || this.stage.canvas.dataset.frame === undefined) this.showFrame(this.timeline.frame);
    this.tabs[1].disabled = !state.measured;
    this.propose();
    this.draw();
  }

  /// Goes to the beginning of the free motion once it is known.
  propose() {
    if (!this.state.preview.proposals || this.proposed) return;
    this.proposed = true;
    if (!this.state.measured) this.timeline.go(partOf(this.state)[0]);
  }

  open(tab) {
    this.tab = tab;
    this.tabs.forEach((button) => button.setAttribute("aria-selected", String(button.id === `tab-${tab}`)));
    const shown = this[tab];
    this.panel.replaceChildren(shown.node);
    this.below.replaceChildren(...(shown.charts ? [shown.charts] : []));
    this.draw();
  }

  /// New settings: drawn at once, and saved unless something is still being dragged.
  change(settings, save = true) {
    this.state = { ...this.state, settings: { ...this.state.settings, ...settings } };
    if (Object.keys(settings).length) this.busy = true;
    this.timeline.setRange(partOf(this.state));
    this.setup.update(this.state);
    this.draw();
    if (!save) return;
    const wanted = this.state.settings;
    this.saving = (this.saving ?? Promise.resolve()).then(() => attempt(async () => {
      const next = await api.saveSettings(this.state.name, wanted);
      // Settings that were made meanwhile are saved next.
      if (this.state.settings === wanted) {
        this.busy = false;
        this.update(next);
      }
    }));
  }

  async measure() {
    await this.saving;
    await attempt(async () => {
      await api.measure(this.state.name);
      this.update(await api.project(this.state.name));
      this.open("result");
    });
  }

  async train(resume) {
    await this.saving;
    await attempt(async () => {
      await api.train(this.state.name, resume);
      this.update(await api.project(this.state.name));
    });
  }

  showFrame(frame) {
    this.stage.show(frame, this.timeline.available);
    this.result.showFrame(frame);
    this.draw();
  }

  draw() {
    const drawn = this.tab === "result" ? this.result.draw(this.stage, this.timeline.frame) : this.tab === "setup" ? this.setup.draw(this.stage, this.timeline.frame) : [];
    this.stage.draw(drawn);
    this.stage.overlay.classList.toggle("pointing", this.tab === "setup" && this.setup.mode !== undefined);
  }
}
