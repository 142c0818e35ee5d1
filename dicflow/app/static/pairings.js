// What belongs together: the ways to pair the photographs of two cameras, with the first and the last pair of each.

import { Newest, ask } from "./api.js";
import { fill, h } from "./dom.js";

const SIDES = ["left", "right"];
const ORDER = "Pair in order";
const TITLES = { name: "By the names", taken: "By the time taken", order: ORDER };

/** The choice of a way for each subject that two cameras have taken. picture : of a name, with words */
export class Pairings {
  constructor(picture) {
    Object.assign(this, { picture, found: [], chosen: {}, ways: new Newest() });
    this.element = h("div", { className: "pairings" });
  }

  /** Look for the ways of other roles. series : the names of each, and its role */
  async look(series) {
    const found = await this.ways.of(ask("pairings", { series }));
    if (!found) return;
    this.found = found;
    this.chosen = Object.fromEntries(found.map(({ subject, usual }) => [subject, usual]));
    this.draw();
  }

  /** What a person must do before the photographs can be paired; "" if nothing. */
  get open() {
    const one = this.found.find(({ subject, ways }) => !this.chosen[subject] && ways.length);
    return one ? `Choose what makes the pairs of the ${one.subject} first: look whether the first and the last pair show the same moment.` : "";
  }

  draw() {
    fill(this.element, this.found.filter(({ ways, usual }) => usual !== "name").map((one) => this.subject(one)));
  }

  subject({ subject, ways, usual }) {
    const title = h("h2", {}, `Pairs of the ${subject}`);
    if (!ways.length) {
      return h("div", { className: "card" }, title, h("p", { className: "problem" },
        "Neither names nor times tell which photographs belong together, and there are not as many left ones as right ones. Add those that are missing, or move those without a partner out of the folder."));
    }
    return h("fieldset", { className: "card" }, h("legend", {}, title),
      usual ? null : h("p", { className: "problem" }, "Nothing is certain here. Look whether the first and the last pair show the same moment, and choose."),
      ways.map((way) => h("label", { className: "way" },
        h("input", { type: "radio", name: `pairs of the ${subject}`, checked: this.chosen[subject] === way.by, onchange: () => { this.chosen[subject] = way.by; } }),
        h("span", {}, h("strong", {}, TITLES[way.by]), `: ${way.pairs} pairs${way.note ? `; ${way.note}` : ""}`,
          h("span", { className: "ends" }, this.end("first", way.first), this.end("last", way.last))))));
  }

  end(words, names) {
    const shown = names.map((name, k) => this.picture(name, `${words} pair, ${SIDES[k]}: ${name}`));
    return h("span", { className: "end" }, h("span", { className: "thumbs" }, shown), h("span", { className: "faint" }, `${words}: ${names.map((name) => name.split("/").pop()).join(" with ")}`));
  }
}
