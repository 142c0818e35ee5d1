// The grid of points and one subset on the first photograph, with what the speckles allow.

import { Newest, ask } from "./api.js";
import { button, fill, h, s } from "./dom.js";
import { Viewer } from "./viewer.js";

const DOT = 1.6; // radius of a point [px of the screen]

export class GridPreview {
  /** edits : gives the changes of the file that are not saved */
  constructor(app, stage, edits) {
    Object.assign(this, { app, stage, edits });
    this.viewer = new Viewer(() => this.draw());
    this.viewer.element.addEventListener("keydown", (event) => this.viewer.key(event));
    this.viewer.element.addEventListener("pointerdown", (event) => this.down(event));
    this.viewer.element.addEventListener("pointermove", (event) => this.move(event));
    this.viewer.element.addEventListener("pointerup", (event) => this.up(event));
    this.facts = h("div", { className: "facts" }, h("p", { className: "faint" }, "The grid, a subset and its σ can be seen before anything is computed."));
    this.element = h("div", { className: "preview" }, h("div", { className: "tools" }, button("Preview the grid", () => this.look(), { className: "main" }), h("span", { className: "faint" }, "click shows the subset there")), this.viewer.element, this.facts);
    this.previews = new Newest();
    this.found = null;
    this.saved = null;
    this.chosen = null;
  }

  async open() {
    const { images } = await ask("drawing", { file: this.app.file });
    if (images) this.viewer.open(await ask("photograph", { file: this.app.file, stage: images }));
  }

  leave() {
    this.previews.drop();
    this.viewer.leave();
  }

  async look() {
    fill(this.facts, h("p", { className: "faint" }, "laying out the grid; the first time takes longer …"));
    try {
      const both = await this.previews.of(this.beforeAndAfter(this.edits()));
      if (!both) return;
      [this.saved, this.found] = both;
      const { points, is_valid: valid } = this.found;
      this.chosen = points[Math.max(0, valid.indexOf(true, Math.floor(points.length / 2)))];
      this.tell();
    } catch (error) {
      this.found = null;
      fill(this.facts, h("p", { className: "problem" }, error.message));
    }
    this.viewer.draw();
  }

  /** The grid of the file as it is, null where it has none, and with edits. */
  async beforeAndAfter(edits) {
    const preview = (some) => ask("preview", { file: this.app.file, stage: this.stage, edits: some });
    const found = await preview(edits);
    return [edits.length ? this.saved ?? await preview([]).catch(() => null) : found, found];
  }

  /** What the grid is like; with values that are not saved, beside what it is like without them. */
  tell() {
    const { advice } = this.found;
    const columns = this.isChange ? [this.saved, this.found] : [this.found];
    const rows = columns.map(factsOf);
    const head = this.isChange ? h("thead", {}, h("tr", {}, ["", "before", "after"].map((word) => h("th", {}, word)))) : null;
    fill(this.facts, h("table", { className: this.isChange ? "both" : "" }, head, h("tbody", {}, Object.keys(rows[0]).map((name) => h("tr", {}, h("th", {}, name), rows.map((one) => h("td", {}, one[name])))))),
      h("ul", {}, advice.map(([good, words]) => h("li", { className: good ? "" : "problem" }, words))),
      this.found.as_taken ? null : h("p", { className: "faint" }, "The grid lies in the rectified image, so it is not drawn here."));
  }

  draw() {
    const found = this.found;
    if (!found || !found.as_taken) return fill(this.viewer.marks);
    const path = { true: [], false: [] };
    found.points.forEach((place, k) => {
      const [x, y] = this.viewer.toScreen(place);
      path[found.is_valid[k]].push(`M${x.toFixed(1)} ${y.toFixed(1)}h0`);
    });
    const parts = [["good", path.true], ["lost", path.false]].map(([look, marks]) =>
      s("path", { class: `grid ${look}`, d: marks.join(""), "stroke-width": 2 * DOT, "stroke-linecap": "round" }));
    if (this.chosen) {
      parts.push(...this.subset(found.subset_size, "under"), ...this.subset(found.subset_size, "over"));
      if (this.isChange) parts.push(...this.subset(this.saved.subset_size, "under"), ...this.subset(this.saved.subset_size, "before"));
    }
    return fill(this.viewer.marks, parts);
  }

  /** Whether values are previewed that are not saved. */
  get isChange() {
    return Boolean(this.saved) && this.found !== this.saved;
  }

  subset(size, look) {
    const [x, y] = this.viewer.toScreen([this.chosen[0] - size / 2, this.chosen[1] - size / 2]);
    const side = size * this.viewer.scale;
    return [s("rect", { class: `subset ${look}`, x, y, width: side, height: side })];
  }

  down(event) {
    if (this.viewer.pinch(event, true)) return;
    this.viewer.element.setPointerCapture(event.pointerId);
    this.press = { at: this.viewer.at(event), moved: false };
  }

  move(event) {
    if (this.viewer.pinch(event) || !this.press) return;
    const at = this.viewer.at(event);
    if (!this.press.moved && Math.hypot(at[0] - this.press.at[0], at[1] - this.press.at[1]) < 4) return;
    this.viewer.panBy(at[0] - this.press.at[0], at[1] - this.press.at[1]);
    this.press = { at, moved: true };
  }

  up(event) {
    this.viewer.pinch(event, false);
    if (this.press && !this.press.moved && this.found) {
      const place = this.viewer.toPhotograph(this.viewer.at(event));
      const gap = ([x, y]) => Math.hypot(x - place[0], y - place[1]);
      this.chosen = this.found.points.reduce((best, one) => (gap(one) < gap(best) ? one : best), this.found.points[0]);
      this.viewer.draw();
    }
    this.press = null;
  }
}

/** Facts of a grid by their names. */
function factsOf({ count, valid, sigma_px: sigma, noise_grey: noise, noise_source: source, speckle_px: speckle, subset_size: size }) {
  return {
    points: `${valid.toLocaleString("en")} of ${count.toLocaleString("en")} can be followed`,
    "σ of a displacement by noise": `x ${sigma[0].toPrecision(2)} px, y ${sigma[1].toPrecision(2)} px (median)`,
    noise: `${noise.toPrecision(2)} grey levels, ${source}`,
    speckles: speckle === null ? "none" : `${speckle.toPrecision(2)} px, ${(size / speckle).toFixed(1)} along a subset's side`,
  };
}
