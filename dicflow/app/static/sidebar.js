// The sidebar: the screens, and the stages of the open file with their states.

import { button, fill, h } from "./dom.js";

const WORDS = {
  hit: "computed", run: "to compute", pending: "to compute, after others", running: "running", failed: "failed", unknown: "not known yet",
};

/** Draw the sidebar. acts : choose(file), step("undo" or "redo") */
export function sidebar(place, app, screens, acts) {
  const found = app.document;
  const held = place.contains(document.activeElement) ? nameOf(document.activeElement) : null;
  fill(place,
    h("div", { className: "title" },
      h("strong", {}, found?.title ?? app.folder),
      app.files.length > 1
        ? h("select", { "aria-label": "Pipeline file", value: app.file, onchange: (event) => acts.choose(event.target.value) },
          app.file ? null : h("option", { value: "" }, "choose a pipeline file"),
          app.files.map((file) => h("option", { value: file, selected: file === app.file }, file)))
        : h("span", { className: "faint" }, app.file || "no pipeline file yet")),
    h("ul", { className: "screens" }, Object.entries(screens).map(([name, screen]) =>
      h("li", {}, h("a", { href: `#${name}`, "aria-current": app.name === name ? "page" : null }, screen.title)))),
    found?.stages.length ? h("h2", {}, "Stages") : null,
    h("ul", { className: "stages" }, (found?.stages ?? []).map((stage) => entry(stage, app))),
    app.planProblem ? h("p", { className: "problem small" }, app.planProblem) : null,
    h("div", { className: "foot" },
      button("Undo", () => acts.step("undo"), { disabled: !found?.can.undo, title: found?.can.undo ? `Undo ${found.can.undo} (Ctrl+Z)` : "nothing to undo" }),
      button("Redo", () => acts.step("redo"), { disabled: !found?.can.redo, title: found?.can.redo ? `Redo ${found.can.redo} (Ctrl+Y)` : "nothing to redo" }),
      button("Light/dark", swapTheme, { className: "quiet" })));
  showCurrent(place);
  if (held) [...place.querySelectorAll("a, button, select")].find((one) => nameOf(one) === held)?.focus({ preventScroll: true });
}

/** What stays the same of an element when the sidebar is drawn again, so that the keyboard does not lose its place. */
function nameOf(element) {
  return element.getAttribute("href") ?? element.getAttribute("aria-label") ?? element.textContent;
}

/** Bring the link of the shown screen into view, where the list of screens scrolls sideways. */
function showCurrent(place) {
  const [list, link] = [place.querySelector(".screens"), place.querySelector(".screens [aria-current=page]")];
  if (list && link) list.scrollLeft = link.offsetLeft - list.offsetLeft - (list.clientWidth - link.offsetWidth) / 2;
}

function entry(stage, app) {
  const state = stateOf(stage, app);
  const { done, all } = countsOf(stage, app);
  const words = `${stage.name}: ${stage.title}; ${WORDS[state]}${stage.takes.length ? `; takes from ${stage.takes.join(", ")}` : ""}`;
  return h("li", {}, h("a", {
    href: `#settings/${encodeURIComponent(stage.name)}`, title: words, "aria-label": words, className: state,
    "aria-current": app.name === "settings" && app.detail === stage.name ? "true" : null,
  }, h("span", { className: "dot" }), h("span", { className: "name" }, stage.name),
  h("span", { className: "count" }, all > 1 && done < all ? `${done}/${all}` : "")));
}

/** Tasks of a stage that are done, and all: of the run that goes on, else by the plan. */
function countsOf(stage, app) {
  const live = app.watched?.state === "running" ? app.watched.stages?.[stage.name] : null;
  if (live) return { done: live.hit + live.computed, all: live.all };
  const { hit, run, pending } = app.states?.stages[stage.name] ?? { hit: 0, run: 0, pending: 0 };
  return { done: hit, all: hit + run + pending };
}

/** In one word: hit, run, pending, running, failed, unknown. */
export function stateOf(stage, app) {
  const live = app.watched?.state === "running" ? app.watched.stages?.[stage.name] : null;
  if (live) {
    if (live.failed) return "failed";
    const done = live.hit + live.computed + live.failed + live.skipped;
    return done === live.all ? "hit" : live.computed ? "running" : "pending";
  }
  if (app.watched?.failures?.some((one) => one.task.split("/")[0] === stage.name)) return "failed";
  const counts = app.states?.stages[stage.name];
  if (!counts) return "unknown";
  return counts.run ? "run" : counts.pending ? "pending" : "hit";
}

function swapTheme() {
  const isDark = document.documentElement.dataset.theme === "dark"
    || (!document.documentElement.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.dataset.theme = isDark ? "light" : "dark";
  localStorage.setItem("theme", isDark ? "light" : "dark");
}
