// The page: screens, the sidebar, the open pipeline file, undo, and messages.

import { ask } from "./api.js";
import { button, empty, fill, h } from "./dom.js";
import { sidebar } from "./sidebar.js";
import * as caliper from "./caliper.js";
import * as calibration from "./calibration.js";
import * as compare from "./compare.js";
import * as explore from "./explore.js";
import * as folder from "./folder.js";
import * as handOver from "./hand_over.js";
import * as region from "./region.js";
import * as run from "./run.js";
import * as settings from "./settings.js";

const SCREENS = { folder, calibration, region, settings, run, explore, caliper, compare, hand_over: handOver };
const place = document.getElementById("screen");

/** What all screens share. document : the open file as the page has seen it; states : of the stages, by the plan */
const app = {
  files: [], file: "", folder: "", document: null, states: null, shown: null, name: "", detail: "",
  go(name, detail = "") {
    location.hash = detail ? `#${name}/${encodeURIComponent(detail)}` : `#${name}`;
  },
  watched: null, planProblem: "",
  open: choose, say, fail, refresh, changed, plan, redraw: drawSidebar,
};

/** Show a sentence for a while; errors stay until they are closed. */
function say(words, isError = false) {
  const messages = document.getElementById("messages");
  const lines = String(words).split("\n").map((line) => h("div", {}, line));
  const shown = h("div", { className: isError ? "message error" : "message", role: isError ? "alert" : null }, h("div", {}, lines));
  shown.append(button("Close", () => shown.remove(), { className: "quiet" }));
  if (isError) for (const old of messages.querySelectorAll(".error")) old.remove();
  messages.append(shown);
  if (!isError) setTimeout(() => shown.remove(), 4000);
}

/** Say an error in its own words; of a file that has changed meanwhile, show what is there now. */
async function fail(error) {
  console.info(error.message);
  say(error.message, true);
  if (error.status === 409) await refresh(true);
}

/** Read the open file again, and draw the sidebar; with `again` the screen too. */
async function refresh(again = false) {
  app.document = app.file ? await ask("document", { file: app.file }) : null;
  drawSidebar();
  if (again) await show();
}

/** After an edit: read the file again, and what a run would compute. */
async function changed(again = false) {
  await refresh(again);
  plan();
}

/** What a run would compute, for the states in the sidebar. */
async function plan() {
  if (!app.file || !app.document || app.document.problems.length) return null;
  try {
    app.states = await ask("plan", { file: app.file });
    app.planProblem = "";
  } catch (error) {
    [app.states, app.planProblem] = [null, error.message];
  }
  drawSidebar();
  return app.states;
}

function drawSidebar() {
  sidebar(document.getElementById("sidebar"), app, SCREENS, { choose, step });
}

/** Open another pipeline file. */
async function choose(file) {
  app.file = file;
  if (!app.files.includes(file)) app.files = [...app.files, file].sort();
  [app.states, app.watched] = [null, null];
  sessionStorage.setItem("file", file);
  await refresh(true);
  plan();
}

/** Take back the last change, or make it again. */
async function step(way) {
  try {
    const seen = app.document ? { [app.file]: app.document.digest } : {};
    const { words } = await ask(way, { seen: { ...seen, ...(app.shown?.seen?.() ?? {}) } });
    say(words ? `${way === "undo" ? "taken back" : "made again"}: ${words}` : `nothing to ${way}`);
    await changed(true);
  } catch (error) {
    await fail(error);
  }
}

/** Show the screen that the address names. */
async function show() {
  const [name, detail] = location.hash.slice(1).split("/");
  const screen = SCREENS[name] ? name : app.file ? "region" : "folder";
  app.shown?.leave?.();
  for (const one of place.querySelectorAll("img")) if (!one.complete) one.removeAttribute("src"); // it is not loaded any more
  const isOther = app.name !== screen;
  [app.name, app.detail, app.shown] = [screen, decodeURIComponent(detail ?? ""), null];
  document.title = `${SCREENS[screen].title} – ${app.document?.title ?? app.folder} – dicflow`;
  drawSidebar();
  const own = h("section", { className: `screen ${screen}`, "aria-label": SCREENS[screen].title });
  fill(place, own);
  try {
    if (app.document?.problems.length) problems(own);
    else app.shown = (await SCREENS[screen].show(own, app)) ?? null;
  } catch (error) {
    fill(own, empty(SCREENS[screen].title, "", h("p", { className: "problem" }, error.message), ways(screen)));
  }
  if (isOther && !own.contains(document.activeElement)) place.focus({ preventScroll: true });
}

/** What can be done where a screen cannot be shown. */
function ways(screen) {
  const settings = app.file && screen !== "settings" ? button("Settings", () => app.go("settings")) : null;
  return h("div", { className: "row" }, button("Try again", () => show()), settings);
}

/** A file that is not valid: what the command line says, and its text, unless that cannot be read. */
function problems(own) {
  const isText = app.document.text !== null;
  const text = h("textarea", { className: "text", value: app.document.text ?? "", spellcheck: false, "aria-label": app.file });
  fill(own, h("div", { className: "page" }, h("h1", {}, `${app.file} is not valid`),
    h("ul", { className: "problems" }, app.document.problems.map((line) => h("li", {}, line))),
    h("p", {}, `Correct it ${isText ? "here or " : ""}in an editor, or undo the last change.`), isText ? text : null,
    h("div", { className: "row" }, isText ? button("Save", () => rewrite(text.value), { className: "main" }) : null, button("Read again", () => changed(true)))));
}

/** Write the text of a file that is corrected by hand. */
async function rewrite(text) {
  try {
    await ask("rewrite", { file: app.file, digest: app.document.digest, text });
    await changed(true);
  } catch (error) {
    await fail(error);
  }
}

function onKey(event) {
  const typing = event.target.closest?.("input, textarea, select");
  if ((event.ctrlKey || event.metaKey) && !typing && event.key.toLowerCase() === "z") {
    event.preventDefault();
    step(event.shiftKey ? "redo" : "undo");
  } else if ((event.ctrlKey || event.metaKey) && !typing && event.key.toLowerCase() === "y") {
    event.preventDefault();
    step("redo");
  }
}

/** Notice that an editor or another page has changed the file: when this page is looked at again. */
async function look() {
  if (!app.file || document.hidden) return;
  try {
    const now = await ask("document", { file: app.file });
    if (now.digest !== app.document?.digest) {
      say(`${app.file} was changed by another program or page`);
      await changed(true);
    }
  } catch { /* said when something is asked for next */ }
}

async function begin() {
  history.replaceState(null, "", `/${location.hash}`);
  const found = await ask("project");
  Object.assign(app, { files: found.files, folder: found.folder });
  const last = sessionStorage.getItem("file");
  app.file = found.files.includes(last) && !found.named ? last : found.chosen;
  await refresh();
  await show();
  document.body.dataset.ready = "yes";
  plan();
}

addEventListener("hashchange", show);
addEventListener("keydown", onKey);
addEventListener("focus", look);
const theme = localStorage.getItem("theme");
if (theme) document.documentElement.dataset.theme = theme;
begin().catch((error) => say(error.message, true));
