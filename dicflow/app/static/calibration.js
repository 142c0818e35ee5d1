// The screen "calibration": pairs by error, residuals on the photographs, pairs left out and the rig solved again.

import { Newest, ask } from "./api.js";
import { button, empty, fill, h, s } from "./dom.js";
import { Viewer } from "./viewer.js";

export const title = "Calibration";
const TIMES = [5, 20, 100, 500, 2000, 5000]; // how much longer residuals are drawn
const LABEL = 130; // width of the words on a ninth [px]
const NEAR = 12; // of a click to its corner [px of the screen]
const SAME = 5; // of a place in the file to its corner [px], as the stage has it
const LISTED = 6; // corners of a photograph, the worst first
const REFINED = "refined_rig";
const LONG = 40; // wanted length of a usual residual [px of the photograph]
const FIGURES = [
  ["rms_px", "reprojection error (RMS)", "px", 3], ["epipolar_px", "epipolar error (mean)", "px", 3], ["pairs_used", "pairs used", "", 0],
  ["coverage_left", "frame covered, left", "%", 0], ["coverage_right", "frame covered, right", "%", 0],
  ["baseline_mm", "baseline", "mm", 2], ["angle_deg", "angle between the cameras", "°", 2], ["square_mm", "square in pairs left out", "mm", 4],
];
const NINTHS = {
  "upper left": [0, 0], top: [0, 1], "upper right": [0, 2], left: [1, 0], centre: [1, 1], right: [1, 2], "lower left": [2, 0], bottom: [2, 1], "lower right": [2, 2],
};

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  fill(place, empty(title, "solving, or reading what is stored …"));
  const screen = new CalibrationScreen(place, app);
  await screen.open();
  return screen;
}

class CalibrationScreen {
  constructor(place, app) {
    Object.assign(this, { place, app });
    this.viewer = new Viewer(() => this.draw());
    this.viewer.element.addEventListener("keydown", (event) => this.viewer.key(event));
    let [press, moved] = [null, 0];
    const { element } = this.viewer;
    element.addEventListener("pointerdown", (event) => { if (!this.viewer.pinch(event, true)) { element.setPointerCapture(event.pointerId); [press, moved] = [this.viewer.at(event), 0]; } });
    element.addEventListener("pointermove", (event) => {
      if (this.viewer.pinch(event) || !press) return;
      const at = this.viewer.at(event);
      moved += Math.hypot(at[0] - press[0], at[1] - press[1]);
      this.viewer.panBy(at[0] - press[0], at[1] - press[1]);
      press = at;
    });
    element.addEventListener("pointerup", (event) => {
      this.viewer.pinch(event, false);
      if (press && moved < 4) this.click(this.viewer.at(event));
      press = null;
    });
    [this.photographs, this.trials] = [new Newest(), new Newest()];
    [this.side, this.times, this.without] = ["left", TIMES[0], new Set()];
  }

  async open() {
    this.saved = await ask("calibration", { file: this.app.file });
    this.found = this.saved;
    this.corners = structuredClone(this.saved.left_out ?? {});
    const wanted = LONG / (this.saved.summary.rms_px || 1);
    this.times = TIMES.findLast((times) => times <= wanted) ?? TIMES[0];
    this.chosen = this.sorted()[0]?.name;
    if (!this.saved.boards) {
      fill(this.place, h("div", { className: "page" }, h("h1", {}, title), h("div", { className: "card" }, this.answer(), this.verdict(), this.figures()),
        h("p", { className: "faint" }, "The rig comes from a file, so there are no pairs of boards to judge.")));
      return;
    }
    this.list = h("aside", { className: "panel wide" });
    this.tools = h("div", { className: "tools" });
    fill(this.place, this.tools, h("div", { className: "stage wide" }, this.viewer.element, this.list));
    this.panel();
    await this.photograph();
  }

  leave() {
    this.photographs.drop();
    this.trials.drop();
    this.viewer.leave();
  }

  /** Pairs, the worst first; those without marks behind. */
  sorted() {
    const error = (pair) => Math.max(pair.left_px ?? -1, pair.right_px ?? -1);
    return [...this.found.pairs].sort((one, other) => error(other) - error(one));
  }

  get pair() {
    return this.found.pairs.find((one) => one.name === this.chosen) ?? this.saved.pairs.find((one) => one.name === this.chosen);
  }

  async photograph() {
    if (!this.chosen || !this.saved.boards) return;
    try {
      const found = await this.photographs.of(ask("photograph", { file: this.app.file, stage: this.saved.boards, step: this.chosen, side: this.side }));
      if (found) this.viewer.open(found);
    } catch (error) {
      await this.app.fail(error);
    }
  }

  panel() {
    const side = (name) => button(name, () => { this.side = name; this.panel(); this.photograph(); }, { "aria-pressed": String(this.side === name) });
    fill(this.tools, h("div", { className: "group" }, side("left"), side("right")),
      h("label", {}, "residuals ", h("select", { onchange: (event) => { this.times = Number(event.target.value); this.viewer.draw(); } }, TIMES.map((times) => h("option", { value: times, selected: times === this.times }, `${times} ×`)))),
      button("Whole", () => this.viewer.fit()), h("span", { className: "faint" }, this.chosen ? `${this.chosen}, ${this.side}` : ""));
    fill(this.list, this.answer(), this.verdict(), this.weigh(), this.figures(), this.table(), this.cornerTable());
  }

  verdict() {
    const { verdict } = this.found;
    const kind = /^poor/.test(verdict) ? "problem" : /^usable/.test(verdict) ? "doubt" : "";
    return h("p", { className: `verdict ${kind}` }, verdict);
  }

  /** Whether the photographs of the specimen still fit the rig, and what to do. */
  answer() {
    const { answer, refines, matches } = this.saved;
    const question = h("strong", {}, "Is the rig still calibrated? ");
    if (!matches) return h("p", {}, question, "This pipeline does not tell it: a stage 'stereo' matches points, whose distance from their epipolar lines is the answer.");
    if (!answer) return h("p", {}, question, "The photographs of the specimen tell it once a run has matched them.");
    return h("div", {}, h("p", { className: answer.fits ? "answer" : "answer problem" }, question, answer.sentence),
      answer.fits || !refines ? null : h("div", { className: "row" }, button("Add the stage that refines the rig", () => this.refine(refines), { className: "main" })));
  }

  async refine(entry) {
    try {
      await this.app.write("edit", { edits: [{ place: ["stages", REFINED], value: entry }], words: "stage that refines the rig" });
      this.app.say("saved: stage that refines the rig; the next run takes it");
      await this.app.show();
    } catch (error) {
      await this.app.fail(error);
    }
  }

  /** Key figures; after a trial those of the file beside the new ones. */
  figures() {
    const { found, saved } = this;
    return h("table", {}, h("tbody", {}, FIGURES.filter(([key]) => key in found.summary).map(([key, words, unit, digits]) => h("tr", {}, h("th", {}, words),
      h("td", { className: "number" }, this.figure(saved.summary[key], unit, digits), found === saved ? "" : ` → ${this.figure(found.summary[key], unit, digits)}`)))));
  }

  figure(value, unit, digits) {
    return value === undefined ? "" : unit === "%" ? `${(100 * value).toFixed(0)} %` : `${value.toFixed(digits)} ${unit}`;
  }

  /** What is ticked and not in the file yet, in words. */
  get changes() {
    const places = (sides) => JSON.stringify(["left", "right"].map((side) => sides?.[side] ?? []));
    const { left_out: before } = this.saved;
    const others = [...new Set([...Object.keys(before), ...Object.keys(this.corners)])].filter((name) => places(before[name]) !== places(this.corners[name]));
    return [...this.without, ...others.filter((name) => !this.without.has(name)).map((name) => `corners of ${name}`)];
  }

  weigh() {
    const { changes } = this;
    if (!changes.length) return h("p", { className: "faint" }, "Tick pairs to leave out, or click single corners in the photograph, and solve again.");
    return h("div", { className: "card offer" }, h("p", {}, `Without ${changes.join(", ")}`),
      h("div", { className: "row" }, button("Solve again", () => this.solve(), { className: this.found === this.saved ? "main" : "" }),
        this.found === this.saved ? null : button("Leave them out of the file", () => this.keep(), { className: "main" })));
  }

  table() {
    const shown = (value) => (value === null || value === undefined ? "–" : value.toFixed(3));
    const limit = this.found.limit_px;
    return h("table", { className: "pairs-table" },
      h("thead", {}, h("tr", {}, ["out", "pair", "left [px]", "right [px]", "epipolar [px]"].map((word, k) => h("th", { className: k > 1 ? "number" : "" }, word)))),
      h("tbody", {}, this.sorted().map((pair) => h("tr", { className: pair.name === this.chosen ? "chosen" : "" },
        h("td", {}, h("input", { type: "checkbox", "aria-label": `leave out ${pair.name}`, checked: this.without.has(pair.name), onchange: (event) => this.tick(pair.name, event.target.checked) })),
        h("td", {}, button(pair.name, () => { this.chosen = pair.name; this.panel(); this.photograph(); }, { className: "quiet pair-name" }), pair.used ? null : h("div", { className: "faint small" }, pair.reason ?? "dropped: its error is too large")),
        ["left_px", "right_px", "epipolar_px"].map((key) => h("td", { className: pair[key] > limit ? "number problem" : "number" }, shown(pair[key])))))));
  }

  /** The corners of the photograph that fit worst, and those that are left out. */
  cornerTable() {
    const own = this.pair?.[this.side];
    if (!own) return null;
    const rows = own.marks.map((place, k) => ({ place, error: Math.hypot(...own.residuals[k]), isOut: this.outAt(place) >= 0, isGross: own.gross[k] }));
    const shown = rows.sort((one, other) => other.error - one.error).filter((one, k) => k < LISTED || one.isOut || one.isGross);
    return h("table", { className: "corners-table" }, h("caption", {}, `Corners of ${this.chosen}, ${this.side}, that fit worst`),
      h("thead", {}, h("tr", {}, ["out", "x, y [px]", "residual [px]", ""].map((word, k) => h("th", { className: k === 1 || k === 2 ? "number" : "" }, word)))),
      h("tbody", {}, shown.map(({ place, error, isOut, isGross }) => {
        const where = place.map((value) => value.toFixed(1)).join(", ");
        return h("tr", {}, h("td", {}, h("input", { type: "checkbox", "aria-label": `leave out the corner at ${where}`, checked: isOut, onchange: () => this.toggle(place) })),
          h("td", { className: "number" }, where), h("td", { className: isGross ? "number problem" : "number" }, error.toFixed(3)), h("td", { className: "faint" }, isGross ? "gross: left out by itself" : ""));
      })));
  }

  /** Number of the entry for a corner of the chosen photograph that is left out; −1 if it is used. */
  outAt([x, y]) {
    return (this.corners[this.chosen]?.[this.side] ?? []).findIndex((one) => Math.hypot(one[0] - x, one[1] - y) <= SAME);
  }

  /** Leave a corner of the chosen photograph out, or use it again. */
  toggle(place) {
    const sides = (this.corners[this.chosen] ??= {});
    const list = (sides[this.side] ??= []);
    const k = this.outAt(place);
    if (k >= 0) list.splice(k, 1);
    else list.push(place.map((value) => Number(value.toFixed(1))));
    this.changed();
  }

  /** A click leaves out the corner that is near, or uses it again. */
  click([x, y]) {
    const near = (this.pair?.[this.side]?.marks ?? []).map((place) => ({ place, off: Math.hypot(...this.viewer.toScreen(place).map((value, k) => value - [x, y][k])) }));
    const found = near.sort((one, other) => one.off - other.off)[0];
    if (found && found.off <= NEAR) this.toggle(found.place);
  }

  tick(name, isOut) {
    if (isOut) this.without.add(name);
    else this.without.delete(name);
    this.changed();
  }

  /** Others are ticked: what was solved is of no use any more. */
  changed() {
    this.trials.drop();
    this.found = this.saved;
    this.panel();
    this.viewer.draw();
  }

  get choice() {
    return { file: this.app.file, boards: this.saved.boards, rig: this.saved.stage, without: [...this.without], corners: this.corners };
  }

  async solve() {
    this.app.say("solving again …");
    try {
      const found = await this.trials.of(ask("calibration", this.choice));
      if (!found) return;
      this.found = found;
    } catch (error) {
      await this.app.fail(error);
    }
    this.panel();
    this.viewer.draw();
  }

  async keep() {
    const words = `without ${this.changes.join(", ")}`;
    try {
      await this.app.write("leave_out_of_rig", { ...this.choice, words });
      this.app.say(`saved: ${words}`);
      await this.app.show();
    } catch (error) {
      await this.app.fail(error);
    }
  }

  /** Residual arrows of the chosen pair, the boards of all pairs faintly, and the ninths that no board covers. */
  draw() {
    if (!this.found || !this.viewer.photograph) return;
    const at = (place) => this.viewer.toScreen(place);
    const parts = this.empty(at);
    for (const pair of this.found.pairs) {
      for (const place of pair.name === this.chosen || !pair.used ? [] : pair[this.side]?.marks ?? []) {
        const [x, y] = at(place);
        parts.push(s("circle", { class: "other", cx: x.toFixed(1), cy: y.toFixed(1), r: 1.5 }));
      }
    }
    const own = this.pair?.[this.side];
    own?.marks.forEach((place, k) => {
      const [x, y] = at(place);
      const [u, v] = own.residuals[k].map((value) => value * this.times * this.viewer.scale);
      const isOut = own.gross[k] || this.outAt(place) >= 0;
      const cross = isOut ? ["under", "over"].map((look) => s("path", { class: `out ${look}`, d: `M${x - 5} ${y - 5}l10 10m0 -10l-10 10` })) : [s("circle", { class: "mark", cx: x, cy: y, r: 2.5 })];
      parts.push(s("path", { class: "arrow under", d: `M${x} ${y}l${u} ${v}` }), s("path", { class: "arrow", d: `M${x} ${y}l${u} ${v}` }), ...cross);
    });
    fill(this.viewer.marks, parts);
  }

  empty(at) {
    const { width, height } = this.viewer.photograph;
    return (this.found.empty?.[this.side] ?? []).flatMap((words) => {
      const [row, column] = NINTHS[words];
      const [x0, y0] = at([(column * width) / 3, (row * height) / 3]);
      const [w, hgt] = [(width / 3) * this.viewer.scale, (height / 3) * this.viewer.scale];
      const box = s("rect", { class: "missing", x: x0, y: y0, width: w, height: hgt });
      if (w < LABEL) return [box];
      return [box, ...["under", "over"].map((look) => s("text", { class: `name ${look}`, x: x0 + 6, y: y0 + 16 }, "show the board here"))];
    });
  }
}
