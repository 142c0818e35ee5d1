// The screen "explore": the fields of a result in the explorer, also while a run makes them.

import { mountExplorer } from "/explorer/view.js";
import { fetchedSource } from "/explorer/source.js";
import { ask, queue } from "./api.js";
import { button, empty, fill, h } from "./dom.js";
import { keep, keepable } from "./keep.js";

export const title = "Explore";
export const FIRST_STEPS = 6; // are shown at once, while more are read
export const USUAL_STEPS = 400;
const ALL_STEPS = 1e6;
const LOOK_MS = 4000;

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  const screen = new ExploreScreen(place, app);
  await screen.begin();
  return screen;
}

class ExploreScreen {
  constructor(place, app) {
    Object.assign(this, { place, app, explorer: null, found: null, isLeft: false, isTouched: false, isRunning: false, variant: Number(app.detail) || 0, most: USUAL_STEPS });
    this.tools = h("div", { className: "tools", role: "toolbar", "aria-label": "Result" });
    this.keeps = h("span", { className: "keeps" });
    this.field = h("div", { className: "field" }, h("p", { className: "faint" }, "reading the result …"));
    for (const event of ["explorer-change", "explorer-chosen"]) this.field.addEventListener(event, () => this.offer());
    fill(place, this.tools, this.field);
    this.reading = queue();
  }

  async begin() {
    await this.read(FIRST_STEPS);
    this.wait();
    if (this.found.steps > FIRST_STEPS) this.inTurn(() => this.readMore());
  }

  async readMore() {
    await survey(this, this.found.view, this.most);
    if (!this.isLeft) await this.read(this.most, true);
  }

  leave() {
    this.isLeft = true;
    clearTimeout(this.timer);
    this.explorer?.play(false);
  }

  /** Do things one after the other, so that the last answer is the one that is shown. */
  inTurn(act) {
    return this.reading(() => this.isLeft || act()).catch((error) => this.isLeft || this.app.fail(error));
  }

  /** Read the result, and show it if it is another one than before. more : of the steps of what was read last */
  async read(steps, more = false) {
    const { file } = this.app;
    const found = await ask("explore", { file, variant: this.variant, steps, more });
    if (this.isLeft) return;
    const facts = ({ view, manifest }) => JSON.stringify([view, manifest]);
    const isOther = !this.found || facts(this.found) !== facts(found);
    this.found = found;
    this.bar();
    if (!found.manifest) this.nothing();
    else if (isOther) await this.mount(found);
  }

  nothing() {
    this.explorer = null;
    fill(this.field, empty(title, "No step has fields yet. A run measures them.", button("Go to the run", () => this.app.go("run"), { className: "main" })));
  }

  /** Show a result with the scene of the one before; of a run that goes on the last step, until somebody chooses. */
  async mount({ view, manifest }) {
    const old = this.explorer;
    old?.play(false);
    const element = h("div", { className: "fields" });
    const explorer = mountExplorer(element, sourceOf(view, manifest));
    this.explorer = explorer;
    fill(this.field, element);
    for (const way of ["pointerdown", "keydown"]) element.addEventListener(way, () => { this.isTouched = true; });
    if (old && this.isTouched) await carry(old, explorer);
    else if (this.isRunning) await explorer.change({ step: manifest.steps.length - 1 });
    await explorer.ready;
  }

  /** The variant, how many steps are shown, and to read the result again. */
  bar() {
    const { found, variant } = this;
    const words = (one, k) => Object.entries(one).map(([name, value]) => `${name} = ${value}`).join(", ") || `variant ${k}`;
    const shown = found.manifest ? found.manifest.steps.filter((one) => one.blobs.status).length : 0;
    const isUsual = this.most === USUAL_STEPS && found.steps > USUAL_STEPS && shown >= USUAL_STEPS;
    fill(this.tools,
      found.variants.length > 1 && h("label", {}, "variant ", h("select", { onchange: (event) => this.choose(Number(event.target.value)) }, found.variants.map((one, k) => h("option", { value: k, selected: k === variant }, words(one, k))))),
      h("span", { className: "shown faint" }, `${shown} of ${found.steps} steps${shown ? ", each against the first photograph" : ""}`),
      isUsual && button("Show all steps", () => { this.most = ALL_STEPS; this.inTurn(() => this.readMore()); }),
      button("Read again", () => this.inTurn(() => this.read(this.most))),
      button("Compare", () => this.app.go("compare"), { title: "Beside an earlier run, another variant or file" }),
      this.keeps,
      found.notes.map((note) => h("span", { className: "note" }, note)));
  }

  /** Buttons for what can be kept of the points and the line that are shown. */
  offer() {
    if (this.explorer) fill(this.keeps, keepable(this.explorer).map((one) => button(one.words, () => this.keep(one), { title: "As a probe; the next run gives its values" })));
  }

  async keep(one) {
    try {
      const names = await keep(this.app, one);
      this.app.say(`saved: ${names.join(", ")}; the next run gives their values`);
      await this.inTurn(() => this.read(this.most));
    } catch (error) {
      await this.app.fail(error);
    }
  }

  choose(variant) {
    [this.variant, this.isTouched] = [variant, true];
    return this.inTurn(() => this.read(this.most));
  }

  /** Read again while a run goes on, and once more when it has ended. */
  wait() {
    this.timer = setTimeout(async () => {
      try {
        const { state } = await ask("watch", { file: this.app.file });
        const wasRunning = this.isRunning;
        this.isRunning = state === "running" || state === "starting";
        if (this.isRunning || wasRunning) await this.inTurn(() => this.read(this.most));
      } catch { /* said when something is asked for next */ }
      if (!this.isLeft) this.wait();
    }, LOOK_MS);
  }
}

/** Look at more steps of a result, bit by bit, so that what is shown already can be used meanwhile. */
export async function survey(screen, view, steps) {
  for (let [next, count] = [0, 1]; !screen.isLeft && next < count;) {
    ({ next, count } = await ask("survey", { view, steps, start: next }));
  }
}

/** The numbers and photographs of an answer to "explore". */
export function sourceOf(view, manifest) {
  const curve = (quantity, point) => ask("curve", { view, quantity, point });
  return fetchedSource(manifest, (name) => new URL(`/field/${view}/${name}`, location).href, curve);
}

/** Carry the scene of one explorer over to another: what is shown by its name, ranges that were typed, and points. */
export async function carry(old, explorer) {
  const { scene, manifest, quantity } = old;
  const [from, to] = [manifest.steps, explorer.manifest.steps];
  const place = (list, name) => list.findIndex((one) => one.name === name);
  const step = place(to, from[scene.step].name);
  const number = place(explorer.manifest.quantities, quantity.name);
  const camera = scene.camera in explorer.cameras ? scene.camera : explorer.scene.camera;
  const { line, over, opacity, tool, reasons, directions, rig, colours } = scene;
  const named = { ...(step >= 0 ? { step } : {}), ...(number >= 0 ? { quantity: number } : {}) };
  explorer.ranges = new Map(old.ranges);
  await explorer.change({ ...named, camera });
  await explorer.change({ over, opacity, tool, reasons, directions, rig, line, ...(number === explorer.scene.quantity ? { colours } : {}) });
  const [rows, cols] = from[scene.step].shape;
  const now = explorer.manifest.steps[explorer.scene.step].shape;
  if (now[0] === rows && now[1] === cols) for (const point of old.points) await explorer.pick(point.index);
}
