// The screen "compare": two results side by side, or one beside the difference of both.

import { ask, queue } from "./api.js";
import { button, empty, fill, h, refill } from "./dom.js";
import { FIRST_STEPS, USUAL_STEPS, survey } from "./explore.js";
import { TwoFields } from "./two.js";

export const title = "Compare";

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  const screen = new CompareScreen(place, app);
  await screen.begin();
  return screen;
}

/** What was other in an earlier run than it is now, and when it was. run : of the answer to "sides" */
function runWords({ run, pipeline, started, changes }, file) {
  const when = new Date(started * 1000).toLocaleString([], { dateStyle: "short", timeStyle: "medium" });
  if (pipeline !== stem(file)) return `${pipeline} · ${when}`;
  if (!changes) return `run ${run}, settings unknown · ${when}`;
  return `${changes.length ? listed(changes.map(({ was }) => was)) : "settings as now"} · ${when}`;
}

const stem = (file) => file.replace(/\.ya?ml$/i, "");
const listed = (texts) => (texts.length > 2 ? `${texts.slice(0, 2).join(", ")} and ${texts.length - 2} more` : texts.join(", "));

class CompareScreen {
  constructor(place, app) {
    Object.assign(this, { place, app, isLeft: false, isMap: false, reading: queue() });
    this.tools = h("div", { className: "tools", role: "toolbar", "aria-label": "Results" });
    this.two = new TwoFields();
    this.body = h("div", { className: "field" });
    fill(place, this.tools, this.body);
  }

  async begin() {
    this.sides = await ask("sides", { file: this.app.file });
    const asked = new URLSearchParams(this.app.detail);
    this.isChange = asked.has("before");
    const past = asked.get("before") ?? asked.get("with");
    const ours = { file: this.app.file, variant: 0, run: "" };
    const other = past ? { ...ours, run: past } : await this.proposed(ours);
    if (!other) return this.nothing();
    this.chosen = this.isChange ? [other, ours] : [ours, other];
    this.choices();
    this.bar();
    fill(this.body, h("p", { className: "faint" }, "reading both results …"));
    await this.read(FIRST_STEPS);
    if (this.found?.some(({ steps }) => steps > FIRST_STEPS)) this.inTurn(() => this.readMore());
  }

  async readMore() {
    for (const { view } of this.found) if (view) await survey(this, view, USUAL_STEPS);
    if (!this.isLeft) await this.read(USUAL_STEPS, true);
  }

  nothing() {
    fill(this.body, empty(title, "There is only one result yet. Change a setting and run again: earlier runs stay in the store. A sweep, or another pipeline file in the folder, can be chosen too.", button("Go to the settings", () => this.app.go("settings"), { className: "main" })));
  }

  leave() {
    this.isLeft = true;
    this.two.leave();
  }

  /** The newest run with other settings, else the next variant, another file, or the run before; null if none is there. */
  async proposed(ours) {
    const { files, runs } = this.sides;
    const own = runs.filter(({ pipeline }) => pipeline === stem(this.app.file));
    const changed = own.find(({ changes }) => changes?.length);
    if (changed) return { ...ours, run: changed.run };
    const { variants } = await ask("explore", { ...ours, steps: 1 });
    if (variants.length > 1) return { ...ours, variant: 1 };
    const file = files.find((one) => one.file !== this.app.file)?.file;
    if (file) return { file, variant: 0, run: "" };
    return own.length > 1 ? { ...ours, run: own[1].run } : null;
  }

  inTurn(act) {
    return this.reading(() => this.isLeft || act()).catch((error) => this.isLeft || this.app.fail(error));
  }

  get names() {
    return this.isChange ? ["Before", "After"] : ["A", "B"];
  }

  /** Read both, or one and the difference, and show them if they are others than before. more : of the same steps */
  async read(steps, more = false) {
    const { chosen } = this;
    const found = [];
    for (const side of chosen) found.push(await this.opened({ ...side, steps, more }));
    const [one, other] = this.isChange ? [1, 0] : [0, 1];
    const map = this.isMap && found.every(({ manifest }) => manifest)
      ? await this.opened({ ...chosen[one], minus: chosen[other], steps, more }) : null;
    if (this.isLeft || chosen !== this.chosen) return;
    this.found = found;
    this.problem = map?.problem ?? "";
    this.bar();
    await this.mount(map?.manifest ? [found[0], map] : found, Boolean(map?.manifest));
  }

  /** The answer to "explore"; what cannot be opened says so in its place. */
  async opened(side) {
    try {
      return await ask("explore", side);
    } catch (error) {
      if (error.status !== 422) throw error;
      return { view: "", manifest: null, variants: [], steps: 0, notes: [], problem: error.message };
    }
  }

  async mount(found, isMap) {
    const facts = JSON.stringify([this.chosen, found.map(({ view, manifest }) => [view, manifest]), isMap, this.names]);
    if (facts === this.shown) return;
    this.shown = facts;
    if (found.some(({ manifest }) => !manifest)) {
      this.two.leave();
      fill(this.body, h("div", { className: "page" }, found.map((one, k) => this.missing(one, k))));
      return;
    }
    if (!this.two.element.isConnected) fill(this.body, this.two.element);
    const [first, second] = this.names;
    const names = isMap ? [first, this.isChange ? `${second} − ${first}` : `${first} − ${second}`] : this.names;
    const titles = names.map((name, k) => [h("span", { className: "badge" }, name), isMap && k ? "" : ` ${this.words(this.chosen[k])}`]);
    await this.two.show(found, { titles, names, isChange: this.isChange, shares: !isMap });
  }

  missing({ manifest, problem, notes }, k) {
    const words = manifest ? "has fields" : problem || "No step has fields: they are not computed yet, or were cleaned up.";
    return h("div", { className: manifest ? "card" : "card bad" }, h("h2", {}, `${this.names[k]} ${this.words(this.chosen[k])}`),
      h("p", { className: manifest ? "faint" : "problem" }, words), notes.map((note) => h("p", {}, note)));
  }

  /** A side in words. */
  words({ file, run, variant }) {
    const past = this.sides.runs.find((one) => one.run === run);
    const name = past ? `run: ${runWords(past, this.app.file)}` : run ? `run ${run}` : `${file}, now`;
    const values = this.found?.[this.chosen.findIndex((one) => one.file === file && one.run === run && one.variant === variant)]?.variants[variant] ?? {};
    return [name, ...Object.entries(values).map(([key, value]) => `${key} = ${value}`)].join(", ");
  }

  /** Selects that stay, so that keys go on where they are while results are read; what else stands there is drawn anew. */
  choices() {
    const { files, runs } = this.sides;
    const unlisted = this.chosen.map(({ run }) => run).filter((run) => run && !runs.some((one) => one.run === run));
    const option = (value, words) => h("option", { value }, words);
    this.selects = [0, 1].map((k) => h("select", { onchange: (event) => this.pick(k, event.target.value) },
      h("optgroup", { label: "now" }, files.map(({ file, title: words }) => option(`file ${file}`, `${file} · ${words}`))),
      h("optgroup", { label: "earlier runs" }, runs.map((run) => option(`run ${run.run}`, runWords(run, this.app.file))), unlisted.map((run) => option(`run ${run}`, run)))));
    this.badges = [0, 1].map(() => h("span", { className: "badge" }));
    this.variants = [0, 1].map(() => h("span", { className: "variants" }));
    this.rest = h("span", { className: "rest" });
    fill(this.tools, [0, 1].map((k) => h("span", { className: "side" }, this.badges[k], this.selects[k], this.variants[k])), this.rest);
  }

  /** Which two, whether the second or the difference is shown, and what is missing. */
  bar() {
    this.names.forEach((name, k) => {
      const { file, run } = this.chosen[k];
      fill(this.badges[k], name);
      this.selects[k].setAttribute("aria-label", name);
      this.selects[k].value = run ? `run ${run}` : `file ${file}`;
      if (this.found) refill(this.variants[k], this.variant(k));
    });
    const notes = (this.found ?? []).flatMap(({ notes: each }, k) => each.map((note) => `${this.names[k]}: ${note}`));
    const shown = this.found?.[0]?.manifest?.steps.filter((one) => one.blobs.status);
    refill(this.rest,
      button("Swap", () => this.choose([this.chosen[1], this.chosen[0]]), { title: "Exchange both sides" }),
      h("span", { className: "group", role: "group", "aria-label": "right side" },
        button(this.names[1], () => this.map(false), { "aria-pressed": String(!this.isMap) }),
        button("Difference", () => this.map(true), { "aria-pressed": String(this.isMap), title: "A map of the difference, point by point" })),
      shown && h("span", { className: "shown faint" }, `${shown.length} of ${this.found[0].steps} steps`),
      button("Read again", () => this.again()),
      [this.isMap && this.problem, ...notes].filter(Boolean).map((note) => h("span", { className: "note" }, note)));
  }

  variant(k) {
    const { variants } = this.found[k];
    if (variants.length < 2) return null;
    const words = (one) => Object.entries(one).map(([name, value]) => `${name} = ${value}`).join(", ");
    return h("select", { "aria-label": `variant of ${this.names[k]}`, onchange: (event) => this.put(k, { ...this.chosen[k], variant: Number(event.target.value) }) },
      variants.map((one, j) => h("option", { value: j, selected: j === this.chosen[k].variant }, words(one))));
  }

  pick(k, text) {
    const name = text.slice(text.indexOf(" ") + 1);
    return this.put(k, text.startsWith("run ") ? { file: this.app.file, variant: 0, run: name } : { file: name, variant: 0, run: "" });
  }

  put(k, side) {
    return this.choose(this.chosen.map((one, j) => (j === k ? side : one)));
  }

  /** Other sides are no longer before and after. */
  choose(sides) {
    [this.chosen, this.isChange] = [sides, false];
    return this.again();
  }

  map(isMap) {
    this.isMap = isMap;
    return this.again();
  }

  /** Read what is chosen by the time that earlier reading has ended. */
  again() {
    this.bar();
    const asked = (this.asked = (this.asked ?? 0) + 1);
    return this.inTurn(() => asked === this.asked && this.read(USUAL_STEPS));
  }
}
