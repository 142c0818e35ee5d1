// Two results side by side: explorers that follow one another, and what both read at a point.

import { Link } from "/explorer/linked.js";
import { mountExplorer } from "/explorer/view.js";
import { fill, h } from "./dom.js";
import { carry, sourceOf } from "./explore.js";

const REST = "Point at a field to read both.";

export class TwoFields {
  constructor() {
    this.element = h("div", { className: "pair" });
    this.explorers = [];
    this.isTouched = false;
    for (const way of ["pointerdown", "keydown"]) this.element.addEventListener(way, () => { this.isTouched = true; });
  }

  /**
   * Show two answers to "explore".
   * titles : what each is; names : short ones; isChange : whether the difference is the second minus the first;
   * shares : false for a result beside a difference, whose colours are its own
   */
  async show(found, { titles, names, isChange = false, shares = true }) {
    const before = this.isTouched ? this.explorers[0] : null;
    this.leave();
    this.element.setAttribute("aria-busy", "true");
    this.captions = titles.map((title, k) => ({ title, element: h("h2", { className: `caption side${k}` }) }));
    this.figures = h("p", { className: "figures", role: "status" }, REST);
    const elements = found.map((_, k) => h("div", { className: `fields side${k}` }));
    this.explorers = found.map(({ view, manifest }, k) => mountExplorer(elements[k], sourceOf(view, manifest)));
    this.element.classList.toggle("apart", !shares);
    this.element.style.setProperty("--pair-aspect", elements[0].style.getPropertyValue("--x-aspect"));
    fill(this.element, this.captions.map(({ element }) => element), elements, this.figures);
    this.link = new Link(...this.explorers, { names, isChange, shares });
    elements[1].addEventListener("keydown", (event) => this.play(event), { capture: true });
    for (const element of elements) {
      element.addEventListener("explorer-change", () => this.caption());
      element.addEventListener("explorer-hover", (event) => this.read(element.explorer, event.detail.index));
    }
    if (before) await carry(before, this.explorers[0]);
    await this.link.start();
    this.caption();
    this.element.setAttribute("aria-busy", "false");
  }

  leave() {
    this.link?.end();
    for (const one of this.explorers) one.play(false);
  }

  /** The first plays, also by the key on the second. */
  play(event) {
    const [one] = this.explorers;
    if (event.key === "Escape") one.play(false);
    if (event.key !== " " || event.target.matches("button, input, select")) return;
    event.preventDefault();
    event.stopPropagation();
    one.play(!one.playing);
  }

  /** What each shows, at which step, and what it lacks. */
  caption() {
    this.captions.forEach(({ title, element }, k) => {
      const { manifest, scene } = this.explorers[k];
      const lacks = this.link.lacks.get(this.explorers[k]);
      this.explorers[k].element.classList.toggle("lacks", Boolean(lacks));
      fill(element, title, h("span", { className: lacks ? "problem" : "faint" }, ` ${lacks || manifest.steps[scene.step].name}`));
    });
  }

  /** Say what both read; the explorer under the pointer comes first. */
  read(explorer, k) {
    if (explorer === this.link.led) return;
    this.figures.textContent = (k >= 0 && this.link.sentence(explorer, k)) || REST;
  }
}
