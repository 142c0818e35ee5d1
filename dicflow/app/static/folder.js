// The screen "folder": what each series of photographs is; the first pipeline file; pairs, and bad ones left out.

import { ask } from "./api.js";
import { button, empty, fill, h } from "./dom.js";
import { Pairings } from "./pairings.js";

export const title = "Folder";
const PAGE = 40;
const NAMED = 8;

export async function show(place, app) {
  const page = h("div", { className: "page" });
  fill(place, page);
  if (app.file) return pairs(page, app);
  if (app.files.length) {
    fill(page, h("h1", {}, "Choose a pipeline file"), h("p", {}, "This folder has several; each is a measurement."),
      h("ul", { className: "choices" }, app.files.map((file) => h("li", {}, button(file, () => app.open(file))))));
    return null;
  }
  series(page, app).catch((error) => app.fail(error));
  return null;
}

const picture = (name, words) => h("img", { src: `/picture/thumbnail?path=${encodeURIComponent(name)}`, alt: words, title: words, loading: "lazy", decoding: "async" });

const MAKE = "Make the pipeline file";

/** No pipeline file yet: say which series is what. */
async function series(page, app) {
  fill(page, h("h1", {}, "What the folder holds"), h("p", { className: "faint" }, "looking at the photographs …"));
  let found;
  try {
    found = await ask("series");
  } catch (error) {
    fill(page, empty("No photographs to measure", "", h("p", { className: "problem" }, error.message)));
    return null;
  }
  const square = h("input", { id: "square", placeholder: "such as 14.5 mm", size: 14 });
  const roles = found.series.map((one) => one.role);
  const make = async () => {
    if (hasBoards() && !square.value.trim()) {
      square.focus();
      app.say("Measure one square of the board first, and type its side.");
      return;
    }
    if (pairings.open) {
      pairings.element.querySelector("input")?.focus();
      app.say(pairings.open);
      return;
    }
    start.disabled = true;
    start.textContent = "Making the pipeline file …";
    try {
      const made = await ask("make", { series: found.series.map(({ names }, k) => ({ names, role: roles[k] })), square: square.value.trim(), pair_by: pairings.chosen });
      app.say(made.said.join("\n"));
      await app.open(made.file, "region");
    } catch (error) {
      await app.fail(error);
    } finally {
      start.disabled = false;
      start.textContent = MAKE;
    }
  };
  const start = button(MAKE, make, { className: "main" });
  const hasBoards = () => roles.some((role) => role.endsWith("boards"));
  const foot = h("div", {});
  const pairings = new Pairings(picture);
  const pair = () => pairings.look(found.series.map(({ names }, k) => ({ names, role: roles[k] }))).catch((error) => app.fail(error));
  const drawFoot = () => fill(foot, counts(found, roles), h("div", { className: "row" },
    hasBoards() ? h("label", {}, "Side of one square of the board, measured: ", square) : null,
    start));
  fill(page, h("h1", {}, "What the folder holds"),
    h("p", {}, "Say what each series of photographs is. The proposal comes from the names, and from what the photographs show."),
    found.reason ? h("p", { className: "problem" }, `Not certain: ${found.reason}. Look at the roles.`) : null,
    found.calibration ? h("p", {}, `The rig comes from ${found.calibration}.`) : null,
    found.series.map((one, k) => h("div", { className: "card series" },
      h("div", { className: "thumbs" }, sample(one.names).map((name) => picture(name, name))),
      h("div", {}, h("strong", {}, one.pattern), h("div", { className: "faint" }, `${one.names.length} photographs; ${one.shows}${one.camera ? `; ${one.camera}` : ""}`),
        h("label", {}, "is ", h("select", { "aria-label": `what ${one.pattern} is`, onchange: (event) => { roles[k] = event.target.value; drawFoot(); pair(); } },
          Object.entries(found.roles).map(([role, words]) => h("option", { value: role, selected: role === one.role }, words))))))),
    found.copies.length ? h("p", { className: "faint" }, `Copies of others, left out: ${brief(found.copies)}`) : null,
    found.single.length ? h("p", { className: "faint" }, `In no series: ${brief(found.single)}`) : null,
    pairings.element, foot);
  drawFoot();
  await pair();
  return null;
}

const brief = (names) => `${names.slice(0, NAMED).join(", ")}${names.length > NAMED ? " …" : ""}`;

/** First, middle and last of a series. */
function sample(names) {
  return [...new Set([names[0], names[Math.floor(names.length / 2)], names[names.length - 1]])];
}

/** Unequal numbers, side by side. */
function counts(found, roles) {
  const count = (role) => found.series.reduce((sum, one, k) => sum + (roles[k] === role ? one.names.length : 0), 0);
  const rows = [["specimen", count("left"), count("right")], ["board", count("left_boards"), count("right_boards")]].filter(([, left, right]) => left + right);
  return h("table", { className: "narrow" }, h("thead", {}, h("tr", {}, ["", "left", "right", ""].map((word) => h("th", {}, word)))),
    h("tbody", {}, rows.map(([name, left, right]) => h("tr", {}, h("td", {}, name), h("td", {}, String(left)), h("td", {}, String(right)),
      h("td", { className: "problem" }, left !== right && right ? `${Math.abs(left - right)} without a partner` : "")))));
}

/** The pairs of each stage of photographs, page by page; bad ones can be left out. */
async function pairs(page, app) {
  const [stage, number] = (app.detail || "").split("|");
  const stages = app.document.stages.filter((one) => one.stage === "images").map((one) => one.name);
  const chosen = stages.includes(stage) ? stage : stages[0];
  const found = await ask("pairs", { file: app.file, stage: chosen });
  const first = Math.min(Number(number) || 0, Math.floor((found.steps.length - 1) / PAGE) * PAGE);
  const out = new Set();
  const save = h("div", { className: "row" });
  const drawSave = () => fill(save, out.size ? [button(`Leave out ${out.size}`, leave, { className: "main" }), h("span", { className: "faint" }, [...out].join(", "))] : h("span", { className: "faint" }, "Tick photographs that are blurred or wrong, to leave them out."));
  const leave = async () => {
    try {
      await app.write("leave_out", { stage: chosen, steps: [...out] });
      app.say(`left out: ${[...out].join(", ")}`);
      await app.show();
    } catch (error) {
      await app.fail(error);
    }
  };
  const go = (to) => app.go("folder", `${chosen}|${to}`);
  fill(page, h("h1", {}, "Photographs"),
    h("div", { className: "row" }, stages.map((name) => button(name, () => app.go("folder", name), { "aria-pressed": String(name === chosen) }))),
    h("p", {}, `${found.steps.length.toLocaleString("en")} ${found.steps[0]?.right ? "pairs" : "photographs"}; the first is the reference.`),
    save,
    h("div", { className: "pairs" }, found.steps.slice(first, first + PAGE).map((step) => h("label", { className: "pair" },
      h("span", { className: "thumbs" }, ["left", "right"].filter((side) => step[side]).map((side) => picture(step[side], `${side}: ${step[side]}`))),
      h("span", { className: "row" }, h("input", { type: "checkbox", onchange: (event) => { if (event.target.checked) out.add(step.name); else out.delete(step.name); drawSave(); } }), step.name)))),
    found.steps.length > PAGE ? h("div", { className: "row" }, button("Earlier", () => go(first - PAGE), { disabled: first === 0 }),
      `${first + 1} … ${Math.min(first + PAGE, found.steps.length)} of ${found.steps.length}`, button("Later", () => go(first + PAGE), { disabled: first + PAGE >= found.steps.length })) : null);
  drawSave();
  return null;
}
