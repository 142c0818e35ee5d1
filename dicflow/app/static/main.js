// The page: screens, the sidebar, the open pipeline file, undo, and messages.

import { Newest, ask, queue } from "./api.js";
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
const inTurn = queue(); // what reads or writes the open file
const plans = new Newest();
let planned = null; // the newest question for the plan
let shows = 0;

/** What all screens share. document : the open file as the page has seen it; states : of the stages, by the plan */
const app = {
  files: [], file: "", folder: "", document: null, states: null, shown: null, name: "", detail: "",
  go(name, detail = "") {
    location.hash = detail ? `#${name}/${encodeURIComponent(detail)}` : `#${name}`;
  },
  watched: null, planProblem: "",
  open: choose, say, fail, show, inTurn, put, write, plan, redraw: drawSidebar,
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
  if (error.status === 409) await refresh();
}

/** Read the open file again; only in turn, as all that writes it. */
async function read() {
  app.document = app.file ? await ask("document", { file: app.file }) : null;
  drawSidebar();
}

/** Read the open file again, and show it. */
async function refresh() {
  await inTurn(read);
  await show();
  plan();
}

/** Write to the open file, as all that was written before has left it; only in turn. seen : digests of other files that it changes */
async function put(name, asked, seen = {}) {
  const { file, document: { digest } } = app;
  const answer = await ask(name, { file, digest, seen: { [file]: digest, ...seen }, ...asked });
  await read();
  plan();
  return answer;
}

/** The same, when its turn comes. */
function write(name, asked, seen) {
  return inTurn(() => put(name, asked, seen));
}

/** What a run would compute, for the states in the sidebar. */
function plan() {
  planned = newestPlan();
  return planned;
}

async function newestPlan() {
  plans.drop();
  if (!app.file || !app.document || app.document.problems.length) return null;
  const found = await plans.of(ask("plan", { file: app.file }).then((states) => [states, ""], (error) => [null, error.message]));
  if (!found) return planned;
  [app.states, app.planProblem] = found;
  drawSidebar();
  return app.states;
}

function drawSidebar() {
  sidebar(document.getElementById("sidebar"), app, SCREENS, { choose, step });
}

/** Open another pipeline file, once everything is written to this one. screen : to show; the same as before without it */
async function choose(file, screen = "") {
  leave();
  await inTurn(async () => {
    app.file = file;
    if (!app.files.includes(file)) app.files = [...app.files, file].sort();
    [app.states, app.watched, app.planProblem] = [null, null, ""];
    sessionStorage.setItem("file", file);
    await read();
  });
  if (screen) history.pushState(null, "", `#${screen}`);
  await show();
  plan();
}

/** Take back the last change, or make it again. */
async function step(way) {
  try {
    const { words } = await inTurn(async () => {
      const seen = app.document ? { [app.file]: app.document.digest } : {};
      const answer = await ask(way, { seen: { ...seen, ...(app.shown?.seen?.() ?? {}) } });
      await read();
      return answer;
    });
    say(words ? `${way === "undo" ? "taken back" : "made again"}: ${words}` : `nothing to ${way}`);
    await show();
    plan();
  } catch (error) {
    await fail(error);
  }
}

/** The screen that is shown ends what it does. */
function leave() {
  app.shown?.leave?.();
  app.shown = null;
}

/** Show the screen that the address names; a screen that is left before it has opened ends when it has. */
async function show() {
  const number = ++shows;
  const [name, detail] = location.hash.slice(1).split("/");
  const screen = SCREENS[name] ? name : app.file ? "region" : "folder";
  leave();
  for (const one of place.querySelectorAll("img")) if (!one.complete) one.removeAttribute("src"); // it is not loaded any more
  const isOther = app.name !== screen;
  [app.name, app.detail] = [screen, decodeURIComponent(detail ?? "")];
  document.title = `${SCREENS[screen].title} – ${app.document?.title ?? app.folder} – dicflow`;
  drawSidebar();
  const own = h("section", { className: `screen ${screen}`, "aria-label": SCREENS[screen].title });
  fill(place, own);
  try {
    if (app.document?.problems.length) problems(own);
    else {
      const opened = (await SCREENS[screen].show(own, app)) ?? null;
      if (number === shows) app.shown = opened;
      else opened?.leave?.();
    }
  } catch (error) {
    fill(own, empty(SCREENS[screen].title, "", h("p", { className: "problem" }, error.message), ways(screen)));
  }
  if (isOther && number === shows && !own.contains(document.activeElement)) place.focus({ preventScroll: true });
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
    h("div", { className: "row" }, isText ? button("Save", () => rewrite(text.value), { className: "main" }) : null, button("Read again", () => refresh()))));
}

/** Write the text of a file that is corrected by hand. */
async function rewrite(text) {
  try {
    await write("rewrite", { text });
    await show();
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
    const isOther = await inTurn(async () => (await ask("document", { file: app.file })).digest !== app.document?.digest);
    if (isOther) {
      say(`${app.file} was changed by another program or page`);
      await refresh();
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
  document.body.dataset.ready = "yes";
}

addEventListener("hashchange", show);
addEventListener("keydown", onKey);
addEventListener("focus", look);
const theme = localStorage.getItem("theme");
if (theme) document.documentElement.dataset.theme = theme;
begin().catch((error) => say(error.message, true));
