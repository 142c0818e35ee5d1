// The screen "settings": what a stage does, its parameters, what a change would compute, and a preview of the grid.

import { Newest, ask } from "./api.js";
import { about, button, empty, fill, h } from "./dom.js";
import { GridPreview } from "./preview.js";
import { resolutionCard } from "./resolution.js";

export const title = "Settings";

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  if (!app.detail) return overview(place, app);
  const screen = new StageScreen(place, app, app.detail);
  await screen.open();
  return screen;
}

/** All stages, and what a run would compute of each and why. */
async function overview(place, app) {
  const page = h("div", { className: "page" }, h("h1", {}, "Stages and settings"),
    h("p", { className: "faint" }, "Choose a stage to see and change its settings. The file stays as you wrote it; comments and order are kept."),
    h("p", { className: "faint" }, "looking at what is stored …"));
  fill(place, page);
  const states = await app.plan();
  page.lastChild.remove();
  page.append(planTable(app, states, app.planProblem), resolutionCard(app));
  return null;
}

/** A table of the stages, and of what a run would compute, or why it cannot begin. */
function planTable(app, states, problem) {
  return h("div", { className: "card scroll" }, states ? null : h("p", { className: "problem" }, problem), h("table", {},
    h("thead", {}, h("tr", {}, ["stage", "does", "stored", "to compute", "because"].map((word, k) => h("th", { className: k === 2 || k === 3 ? "number" : "" }, word)))),
    h("tbody", {}, app.document.stages.map((stage) => {
      const counts = states ? states.stages[stage.name] ?? { hit: 0, run: 0, pending: 0, reasons: [] } : null;
      return h("tr", {}, h("td", {}, h("a", { href: `#settings/${encodeURIComponent(stage.name)}` }, stage.name)), h("td", {}, stage.title),
        h("td", { className: "number" }, counts ? String(counts.hit) : ""), h("td", { className: "number" }, counts ? String(counts.run + counts.pending) : ""),
        h("td", { className: "faint" }, counts ? because(counts.reasons) : ""));
    }))), states ? [h("p", {}, expected(states)), states.warnings.map((words) => h("p", { className: "problem" }, words))] : null);
}

/** The two most frequent reasons. */
function because(reasons) {
  const words = reasons.slice(0, 2).map(([one, times]) => (times > 1 ? `${one} (${times} ×)` : one));
  return words.join("; ") + (reasons.length > 2 ? "; …" : "");
}

/** How long a run would take, in a sentence. */
export function expected(states) {
  const { run, pending } = states.counts;
  if (!run && !pending) return "Everything is computed.";
  const tasks = `${run + pending} ${run + pending === 1 ? "task" : "tasks"} to compute`;
  if (states.seconds === null) return `${tasks}; how long that takes is known after the first run.`;
  const { workers } = states;
  return `${tasks}, ${about(states.seconds / workers)} with ${workers} ${workers === 1 ? "worker" : "workers"}, by the times of the last run.`;
}

/** Names as a pipeline file lists them. */
const listed = (names) => `[${names.join(", ")}]`;

class StageScreen {
  constructor(place, app, name) {
    Object.assign(this, { place, app, name });
    this.texts = new Map(); // parameter or input → text as typed; "" takes the key away
    [this.plans, this.sides] = [new Newest(), new Newest()];
  }

  async open() {
    const { app, name } = this;
    this.stage = await ask("parameters", { file: app.file, stage: name });
    const [first, ...more] = this.stage.about;
    this.pending = h("div", { className: "pending", "aria-live": "polite" });
    this.past = h("div", {});
    const usual = this.stage.parameters.filter((one) => one.affects === "result").sort((one, other) => other.given - one.given);
    const others = this.stage.parameters.filter((one) => one.affects !== "result");
    const own = h("div", { className: "page" },
      h("p", {}, h("a", { href: "#settings" }, "All stages")),
      h("h1", {}, `${name}: ${this.stage.title}`),
      h("p", {}, first), more.length ? h("details", {}, h("summary", {}, "More on this stage"), more.map((part) => h("p", {}, part))) : null,
      this.pending, this.past,
      this.stage.inputs.length ? h("div", { className: "card" }, h("h2", {}, "Takes"), this.stage.inputs.map((one) => (one.several ? this.inputs(one) : this.input(one)))) : null,
      h("div", { className: "card" }, h("h2", {}, "Parameters"), usual.length ? usual.map((one) => this.parameter(one)) : h("p", { className: "faint" }, "none")),
      others.length ? h("details", { className: "card", open: Boolean(app.planProblem) }, h("summary", {}, "Speed and files; these change no result"), others.map((one) => this.parameter(one))) : null);
    if (this.stage.stage === "correlate") {
      this.preview = new GridPreview(app, name, () => this.edits());
      fill(this.place, h("div", { className: "halves" }, own, this.preview.element));
      await this.preview.open();
    } else fill(this.place, own);
    this.lookBack();
  }

  /** The newest run in which this stage had other settings, to be seen beside what it gives now. */
  async lookBack() {
    const sides = await this.sides.of(ask("sides", { file: this.app.file }));
    const stem = this.app.file.replace(/\.ya?ml$/i, "");
    const before = sides?.runs.find(({ pipeline, changes }) => pipeline === stem && changes?.some((one) => this.concerns(one)));
    if (!before) return;
    const counts = this.app.states?.stages[this.name];
    const others = before.changes.filter((one) => !this.concerns(one));
    fill(this.past, h("div", { className: "card" }, h("h2", {}, "Before and after"),
      h("ul", {}, before.changes.filter((one) => this.concerns(one)).map(({ text }) => h("li", { className: "change" }, text))),
      others.length ? h("p", { className: "faint" }, `Changed since then too: ${others.map(({ text }) => text).join(", ")}.`) : null,
      h("p", { className: "faint" }, `Before: the run of ${new Date(before.started * 1000).toLocaleString()}.`, counts?.run || counts?.pending ? " After: not computed yet, the next run gives it." : ""),
      h("div", { className: "row" }, button("See both side by side", () => this.app.go("compare", `before=${before.run}`)))));
  }

  /** Whether a change is one of this stage that affects its results. */
  concerns({ name }) {
    const [stage, parameter] = name.split(".");
    const found = this.stage.parameters.find((one) => one.name === parameter);
    return stage === this.name && (found ? found.affects === "result" : parameter === "inputs");
  }

  leave() {
    this.plans.drop();
    this.sides.drop();
    this.preview?.leave();
  }

  /** One parameter: name, a field for its value, unit, sentence, limits. */
  parameter(one) {
    const limits = [one.allowed, one.default === "null" ? "" : `default ${one.default}`].filter(Boolean).join("; ");
    const field = one.choices ? this.choice(one) : this.field(one);
    return h("label", { className: one.given ? "parameter given" : "parameter" },
      h("span", { className: "key" }, one.name),
      h("span", { className: "value" }, field, one.unit && !one.value.endsWith(one.unit) ? h("span", { className: "unit" }, one.unit) : null),
      h("span", { className: "about" }, one.words, h("span", { className: "faint" }, ` (${limits})`)));
  }

  field(one) {
    return h("input", { type: "text", value: one.value === "null" ? "" : one.value, spellcheck: false, autocomplete: "off", onchange: (event) => this.type(one, event.target.value) });
  }

  choice(one) {
    const values = one.choices.includes(one.value) ? one.choices : [...one.choices, one.value];
    return h("select", { onchange: (event) => this.type(one, event.target.value) },
      values.map((value) => h("option", { value, selected: value === one.value }, value === "null" ? "none" : value)));
  }

  input(one) {
    const automatic = one.given ? "the only one that fits" : `${one.value ?? "none"}, by itself`;
    return h("label", { className: "parameter" }, h("span", { className: "key" }, one.name),
      h("span", { className: "value" }, h("select", { onchange: (event) => this.type(one, event.target.value) },
        h("option", { value: "", selected: !one.given }, automatic),
        one.fitting.map((name) => h("option", { value: name, selected: one.given && name === one.value }, name)),
        one.optional ? h("option", { value: "null", selected: one.given && one.value === null }, "none") : null)),
      h("span", { className: "about" }, `${one.kinds.join(" or ")}${one.optional ? ", optional" : ""}`));
  }

  /** An input that takes several stages: all that fit, or those that are ticked. */
  inputs(one) {
    const names = [...one.value, ...one.fitting.filter((name) => !one.value.includes(name))];
    const tick = (words, checked, onchange) => h("input", { type: "checkbox", checked, onchange, "aria-label": `${one.name}: ${words}` });
    const tell = () => this.type(one, all.checked ? "" : listed(names.filter((_, k) => boxes[k].checked)));
    const boxes = names.map((name) => tick(name, one.value.includes(name), () => { all.checked = false; tell(); }));
    const all = tick("all that fit", !one.given, () => { if (all.checked) boxes.forEach((box) => { box.checked = true; }); tell(); });
    return h("fieldset", { className: one.given ? "parameter given" : "parameter", "aria-label": one.name }, h("span", { className: "key" }, one.name),
      h("span", { className: "several" }, h("label", {}, all, "all that fit, by itself"), names.map((name, k) => h("label", {}, boxes[k], name))),
      h("span", { className: "about" }, `${one.kinds.join(" or ")}, of one or several stages`));
  }

  type(one, text) {
    const before = !one.given ? "" : one.several ? listed(one.value) : one.value ?? "null";
    if (text === before || (!one.given && text === (one.value === "null" ? "" : one.value))) this.texts.delete(one.name);
    else this.texts.set(one.name, text);
    this.weigh();
  }

  edits() {
    return [...this.texts].map(([name, text]) => ({ place: ["stages", this.name, name], text }));
  }

  /** What the typed values would compute. */
  async weigh() {
    this.plans.drop();
    const edits = this.edits();
    if (!edits.length) return fill(this.pending);
    fill(this.pending, h("div", { className: "card" }, "looking at what would be computed …"));
    try {
      const plan = await this.plans.of(ask("edit", { file: this.app.file, edits, dry: true }));
      if (plan) this.offer(plan);
    } catch (error) {
      this.refuse(error.message);
    }
    return null;
  }

  offer(plan) {
    const again = Object.values(plan.stages).filter((one) => one.run + one.pending).map((one) => `${one.name} ${one.run + one.pending}`);
    fill(this.pending, h("div", { className: "card offer" },
      h("h2", {}, "What would be computed"), h("p", { className: "would" }, again.length ? again.join(", ") : "nothing: all of it is stored"), h("p", { className: "faint" }, expected(plan)),
      h("div", { className: "row" }, button("Save to the file", () => this.save(), { className: "main" }), this.discard())));
  }

  /** What is wrong with the typed values; of a pipeline that could not be run before either it may be something else. */
  refuse(problem) {
    const save = this.app.planProblem ? button("Save to the file", () => this.save()) : null;
    fill(this.pending, h("div", { className: "card bad" }, h("p", { className: "problem" }, problem), h("div", { className: "row" }, save, this.discard())));
  }

  discard() {
    return button("Discard", () => { this.texts.clear(); this.again(); });
  }

  async again() {
    this.leave();
    fill(this.place);
    await this.open();
  }

  async save() {
    const words = [...this.texts.keys()].map((name) => `${this.name}.${name}`).join(", ");
    this.plans.drop();
    this.place.inert = true; // nothing is typed into fields that are about to be drawn again
    try {
      await this.app.write("edit", { edits: this.edits(), words });
      this.texts.clear();
      await this.again();
      this.app.say(`saved: ${words}`);
    } catch (error) {
      await this.app.fail(error);
    } finally {
      this.place.inert = false;
    }
  }
}
