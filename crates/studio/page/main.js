// The page: which view is shown, and in which colours.

import { attempt, el, notice } from "./dom.js";
import { home } from "./home.js";
import { projectView } from "./project.js";

const main = document.getElementById("main");
const where = document.getElementById("where");
let leave = () => {};

function show() {
  leave();
  leave = () => {};
  where.replaceChildren();
  const match = location.hash.match(/^#\/p\/([a-z0-9-]+)$/);
  attempt(async () => {
    const view = match ? await projectView(match[1]) : await home();
    where.replaceChildren(...(view.title ? [el("span", {}, view.title)] : []));
    document.title = view.title ? `${view.title} – PAIG studio` : "PAIG studio";
    main.replaceChildren(view.node);
    leave = view.leave;
    view.shown?.();
  });
}

const theme = document.getElementById("theme");

function paint(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  theme.textContent = dark ? "Light" : "Dark";
  theme.setAttribute("aria-label", dark ? "Light colours" : "Dark colours");
}

let dark = (localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
paint(dark);
theme.addEventListener("click", () => {
  dark = !dark;
  localStorage.setItem("theme", dark ? "dark" : "light");
  paint(dark);
});

// The token is in a cookie by now; the address is free of it.
if (location.search) history.replaceState(null, "", location.pathname + location.hash);
window.addEventListener("hashchange", show);
window.addEventListener("unhandledrejection", (event) => notice(event.reason?.message ?? "Something went wrong.", true));
show();
