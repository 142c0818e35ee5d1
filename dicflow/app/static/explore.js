// The screen "explore": the maps of the last run, large, step by step.

import { ask } from "./api.js";
import { button, empty, fill, h } from "./dom.js";

export const title = "Explore";
const PLAY_MS = 250;

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  const { maps } = await ask("maps", { file: app.file });
  if (!maps.length) {
    fill(place, empty(title, "There are no maps yet. A run writes them.", button("Go to the run", () => app.go("run"), { className: "main" })));
    return null;
  }
  return new Explorer(place, app, maps);
}

class Explorer {
  constructor(place, app, maps) {
    Object.assign(this, { app, maps });
    this.map = maps.find((one) => app.detail === `${one.folder}/${one.quantity}`) ?? maps.find((one) => one.quantity === "eyy") ?? maps[0];
    this.step = Object.keys(this.map.steps).length - 1;
    this.tools = h("div", { className: "tools" });
    this.picture = h("img", { className: "map" });
    this.element = h("div", { className: "explore", tabIndex: 0, role: "application", "aria-label": "Map. Left and right arrows go from step to step, space plays.", onkeydown: (event) => this.key(event) }, this.picture);
    fill(place, this.tools, this.element);
    this.draw();
    this.element.focus();
  }

  leave() {
    clearInterval(this.playing);
  }

  draw() {
    const steps = Object.keys(this.map.steps);
    const name = steps[this.step];
    const label = (one) => (new Set(this.maps.map((other) => other.folder)).size > 1 ? `${one.folder}: ${one.quantity}` : one.quantity);
    fill(this.tools,
      h("label", {}, "quantity ", h("select", { onchange: (event) => this.choose(Number(event.target.value)) }, this.maps.map((one, k) => h("option", { value: k, selected: one === this.map }, label(one))))),
      button("◀", () => this.go(-1), { "aria-label": "Earlier step" }),
      h("input", { type: "range", min: 0, max: steps.length - 1, value: String(this.step), "aria-label": "step", oninput: (event) => { this.step = Number(event.target.value); this.show(); } }),
      button("▶", () => this.go(1), { "aria-label": "Later step" }),
      button(this.playing ? "Pause" : "Play", () => this.play()),
      h("span", { className: "step" }, `${name}, ${this.step + 1} of ${steps.length}`));
    this.show();
  }

  show() {
    const steps = Object.keys(this.map.steps);
    const name = steps[this.step];
    this.picture.src = `/map?file=${encodeURIComponent(this.app.file)}&name=${encodeURIComponent(this.map.steps[name])}`;
    this.picture.alt = `${this.map.quantity} at ${name}`;
    const shown = this.tools.querySelector(".step");
    if (shown) shown.textContent = `${name}, ${this.step + 1} of ${steps.length}`;
    const range = this.tools.querySelector("input");
    if (range) range.value = String(this.step);
  }

  choose(number) {
    this.map = this.maps[number];
    this.step = Math.min(this.step, Object.keys(this.map.steps).length - 1);
    this.draw();
  }

  go(way) {
    const count = Object.keys(this.map.steps).length;
    this.step = (this.step + way + count) % count;
    this.show();
  }

  play() {
    clearInterval(this.playing);
    this.playing = this.playing ? null : setInterval(() => this.go(1), PLAY_MS);
    this.draw();
  }

  key(event) {
    const acts = { ArrowLeft: () => this.go(-1), ArrowRight: () => this.go(1), " ": () => this.play() };
    if (!acts[event.key]) return;
    event.preventDefault();
    acts[event.key]();
  }
}
