// The section "report" of the pipeline file as a form: what a report must state and no photograph shows.

import { ask } from "./api.js";
import { fill, h } from "./dom.js";

/** The card with one field per fact; each is written to the file when it is left. */
export async function factsCard(app) {
  const { facts, logos } = await ask("facts", { file: app.file });
  const count = h("p", { className: "faint" });
  const say = () => {
    const given = facts.filter((one) => one.value).length;
    fill(count, `${given} of ${facts.length} filled in. They stand in the section "report" of ${app.file}, and the report has a blank row for each of the others.`);
  };
  const write = async (one, field) => {
    const words = field.value.trim().replace(/\s*\n\s*/g, " ");
    field.value = words;
    if (words === one.value) return;
    const before = one.value;
    one.value = words;
    try {
      await app.write("edit", { edits: [edit(facts, one, words)], words: `report.${one.name}` });
      say();
      app.say(`saved: report.${one.name}`);
    } catch (error) {
      one.value = field.value = before;
      await app.fail(error);
    }
  };
  say();
  return h("div", { className: "card" }, h("h2", {}, "What only you know of the test"), count,
    facts.map((one) => row(one, one.name === "logo" ? logos : null, write)),
    h("datalist", { id: "logos" }, logos.map((name) => h("option", { value: name }))));
}

/** The edit for a fact; the last one that is taken away takes the section along. */
function edit(facts, one, words) {
  if (words) return { place: ["report", one.name], value: words };
  return facts.some((other) => other !== one && other.value) ? { place: ["report", one.name] } : { place: ["report"] };
}

function row(one, logos, write) {
  const facts = { value: one.value, maxLength: 2000, onchange: (event) => write(one, event.target) };
  const field = logos ? h("input", { ...facts, type: "text", list: "logos" }) : h("textarea", { ...facts, rows: 1 });
  return h("label", { className: "fact" }, h("span", { className: "key" }, one.name), field, h("span", { className: "about faint small" }, one.words));
}
