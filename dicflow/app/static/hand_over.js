// The screen "hand over": the report, and files for other programs.

import { ask } from "./api.js";
import { button, empty, fill, h } from "./dom.js";
import { factsCard } from "./facts.js";

export const title = "Hand over";

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  const { formats, stages } = await ask("formats", { file: app.file });
  const facts = await factsCard(app);
  const cards = Object.keys(stages).length
    ? [reportCard(app, (await ask("written", { file: app.file })).report), facts, exportCard(app, formats, stages)]
    : [nothing(app), facts];
  fill(place, h("div", { className: "page" }, h("h1", {}, title), cards));
  return null;
}

function nothing(app) {
  return h("div", { className: "card" }, h("p", {}, "Nothing is measured yet. After a run there is a report, and files for other programs."),
    h("div", { className: "row" }, button("Go to the run", () => app.go("run"), { className: "main" })));
}

function reportCard(app, isThere) {
  const said = h("div", { "aria-live": "polite" });
  const link = h("a", { href: `/report?file=${encodeURIComponent(app.file)}`, target: "_blank", rel: "noopener" }, "Open the report");
  link.hidden = !isThere;
  const name = h("input", { value: app.document.title, size: 40, onchange: async (event) => {
    try {
      const words = event.target.value.trim();
      await app.write("edit", { edits: [words ? { place: ["title"], value: words } : { place: ["title"], text: "" }], words: "title" });
      app.say("saved: title");
    } catch (error) {
      await app.fail(error);
    }
  } });
  const write = async () => {
    fill(said, h("p", { className: "faint" }, "writing …"));
    try {
      const { path, notes } = await ask("report", { file: app.file });
      fill(said, h("p", {}, `written: ${path}`), notes.map((words) => h("p", { className: "faint" }, words)));
      link.hidden = false;
    } catch (error) {
      fill(said, h("p", { className: "problem" }, error.message));
    }
  };
  return h("div", { className: "card" }, h("h2", {}, "Report"),
    h("p", { className: "faint" }, "One page that can be mailed and read without a server."),
    h("label", { className: "row" }, "title", name),
    h("div", { className: "row" }, button("Write the report", write, { className: "main" }), link), said);
}

function exportCard(app, formats, stages) {
  const asked = { format: "csv", stage: "", step: "", quantities: "", folder: "export", force: false };
  const said = h("div", { "aria-live": "polite" });
  const step = h("select", { onchange: (event) => { asked.step = event.target.value; } });
  const drawSteps = () => fill(step, h("option", { value: "" }, "every step"), (stages[asked.stage] ?? []).map((name) => h("option", { value: name }, name)));
  const write = async () => {
    fill(said, h("p", { className: "faint" }, "writing …"));
    try {
      const { files, notes } = await ask("export", { file: app.file, ...asked, quantities: asked.quantities.split(/[\s,]+/).filter(Boolean) });
      fill(said, h("p", {}, `${files.length} ${files.length === 1 ? "file" : "files"} written`), h("ul", { className: "files" }, files.slice(0, 60).map((name) => h("li", {}, name))), notes.map((words) => h("p", { className: "faint" }, words)));
    } catch (error) {
      fill(said, h("p", { className: "problem" }, error.message));
    }
  };
  const row = (words, field, about) => h("label", { className: "parameter" }, h("span", { className: "key" }, words), h("span", { className: "value" }, field), h("span", { className: "about faint" }, about));
  drawSteps();
  return h("div", { className: "card" }, h("h2", {}, "Files for other programs"),
    row("format", h("select", { onchange: (event) => { asked.format = event.target.value; } }, Object.entries(formats).map(([name, words]) => h("option", { value: name, selected: name === "csv" }, `${name}: ${words}`))), "of numbers, pictures or movies"),
    row("what", h("select", { onchange: (event) => { asked.stage = event.target.value; asked.step = ""; drawSteps(); } }, h("option", { value: "" }, "the whole test"), Object.keys(stages).map((name) => h("option", { value: name }, name))), "every total with its tables, or one stage"),
    row("step", step, "of one stage"),
    row("quantities", h("input", { placeholder: "all", onchange: (event) => { asked.quantities = event.target.value; } }), "such as U, V, eyy"),
    row("folder", h("input", { value: "export", onchange: (event) => { asked.folder = event.target.value; } }), "below the folder of the pipeline file"),
    h("label", { className: "row" }, h("input", { type: "checkbox", onchange: (event) => { asked.force = event.target.checked; } }), "overwrite files that exist"),
    h("div", { className: "row" }, button("Write the files", write, { className: "main" })), said);
}
