// The screen "region": the first photograph, what is drawn on it, and the numbers of what is chosen.

import { ask } from "./api.js";
import { button, empty, fill, h, refill } from "./dom.js";
import { drawMarks } from "./marks.js";
import { Pen } from "./pen.js";
import { SORTS, pathsOf, probesOf, regionOf, rounded, simplified } from "./shapes.js";
import { Viewer } from "./viewer.js";

export const title = "Region and probes";
const MOST_ROWS = 300;
const TOLERANCES = [1, 2, 4, 8]; // [px]
const FEWER = 0.75;

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  const screen = new RegionScreen(place, app);
  await screen.open();
  return screen;
}

class RegionScreen {
  constructor(place, app) {
    Object.assign(this, { place, app });
    this.viewer = new Viewer(() => this.pen && drawMarks(this.viewer, this.pen));
    this.pen = new Pen(this.viewer, (words) => this.commit(words), () => this.panel());
    this.pen.isBarred = (sort) => this.barred(sort) !== "";
    this.pen.onpoint = ([x, y]) => { this.where.textContent = `x ${x.toFixed(1)}  y ${y.toFixed(1)} px`; };
    this.renamed = {};
    this.atRest = [];
  }

  async open() {
    await this.read();
    if (!this.drawing.regions.length) {
      fill(this.place, empty(title, "This pipeline has no stage 'region', so there is nothing to draw. The command 'dicflow init' writes files that have one."));
      return;
    }
    this.where = h("span", { className: "where" });
    this.tools = h("div", { className: "tools", role: "toolbar", "aria-label": "Drawing" });
    [this.list, this.details] = [h("div", {}), h("div", {})];
    fill(this.place, this.tools, h("div", { className: "stage" }, this.viewer.element, h("aside", { className: "panel" }, this.list, this.details)), h("div", { className: "status" }, this.where, h("span", { className: "hint" })));
    this.panel();
    this.viewer.open(await ask("photograph", { file: this.app.file, stage: this.drawing.images }));
    this.lookAtRest();
  }

  /** What the extensometers of the last run read where nothing deforms. */
  async lookAtRest() {
    if (!this.saved.some((path) => path.sort === "extensometer")) return;
    try {
      this.atRest = await ask("rest", { file: this.app.file });
      this.panel();
    } catch { /* said by the screen of the run */ }
  }

  leave() {
    this.isLeft = true;
    this.pen.settle();
    this.viewer.leave();
  }

  /** Digests of the files as this screen has them, beside the pipeline file's. */
  seen() {
    return this.drawing?.region ? { [this.drawing.region.file]: this.drawing.region.digest } : {};
  }

  async read() {
    this.drawing = await ask("drawing", { file: this.app.file });
    this.saved = pathsOf(this.drawing.region, this.drawing.probes);
    this.pen.load(structuredClone(this.saved));
  }

  /** Why a sort of path cannot be drawn; "" if it can. */
  barred(sort) {
    if (!SORTS[sort].probe) return "";
    return this.drawing?.probes?.unit === "mm" ? "the probes are given in mm; type them in the settings" : "";
  }

  /** Write a complete change to the files, one after the other. */
  commit(words) {
    return this.app.inTurn(() => this.save()).then(() => { this.panel(); this.app.say(`saved: ${words}`); }, async (error) => {
      await this.app.fail(error);
      if (error.status !== 409) this.pen.load(structuredClone(this.saved));
      this.panel();
    });
  }

  /** Write what is drawn now and not written yet. */
  async save() {
    const { app, drawing, renamed, saved } = this;
    const now = structuredClone(this.pen.paths);
    const isOther = (of) => JSON.stringify(of(now)) !== JSON.stringify(of(saved));
    const [region, probes] = [isOther(regionOf), isOther(probesOf)];
    if (region) await app.put("draw", { stage: drawing.regions[0], drawn: regionOf(now) }, this.seen());
    if (probes) {
      this.renamed = {};
      await app.put("probe", { stage: drawing.probes?.stage ?? "probes", probes: probesOf(now), renamed });
    }
    this.saved = now;
    if (region || probes) this.drawing = await ask("drawing", { file: app.file });
  }

  /** The tools, the list of paths, and the numbers of the chosen one. */
  panel() {
    if (!this.tools) return;
    const { pen } = this;
    const tool = (name, words, key) => button([words, h("kbd", {}, key)], () => { pen.take(name); this.viewer.element.focus(); }, {
      "aria-pressed": String(pen.tool === name), disabled: name !== "select" && this.barred(name) !== "", title: this.barred(name === "select" ? "outline" : name) || SORTS[name]?.words || "choose and move corners",
    });
    fill(this.tools,
      h("div", { className: "group" }, tool("select", "Select", "V")),
      h("div", { className: "group" }, ["outline", "hole", "cut"].map((sort) => tool(sort, SORTS[sort].title, SORTS[sort].key.toUpperCase()))),
      h("div", { className: "group" }, ["point", "line", "extensometer", "area"].map((sort) => tool(sort, SORTS[sort].title, SORTS[sort].key.toUpperCase()))),
      h("div", { className: "group" },
        pen.draft ? button(["Finish", h("kbd", {}, "F")], () => pen.finish(), { className: "main" }) : null,
        button("−", () => this.viewer.zoomAt(null, 1 / 1.4), { "aria-label": "Zoom out" }),
        button("+", () => this.viewer.zoomAt(null, 1.4), { "aria-label": "Zoom in" }),
        button("Whole", () => this.viewer.fit())));
    refill(this.list, this.proposal(), this.listed("Region", (sort) => !SORTS[sort].probe), this.listed("Probes", (sort) => SORTS[sort].probe), this.rest());
    this.detail();
    fill(this.place.querySelector(".hint"), this.hint());
  }

  /** The numbers of the chosen path; those that somebody is typing stay. */
  detail() {
    const path = this.pen.paths[this.pen.chosen.path];
    const isTyped = document.activeElement?.matches("input") && this.details.contains(document.activeElement);
    if (!isTyped || path !== this.detailed) refill(this.details, this.numbers());
    this.detailed = path;
  }

  hint() {
    const { pen } = this;
    if (pen.tool === "select") {
      return pen.chosen.corner >= 0 ? "arrows move the corner (Shift: 10 px), . and , go to the next, I inserts, Delete removes" : "drag a corner; double-click on a line inserts one; drag beside it moves the photograph; wheel zooms";
    }
    const { most, closed } = SORTS[pen.tool];
    return most ? `click ${most === 1 ? "the place" : "both ends"}; Esc cancels` : `click corner after corner; ${closed ? "the first one again" : "double-click"} or F ends; Esc cancels; or arrows and Enter`;
  }

  proposal() {
    const note = this.drawing.region?.note;
    return h("div", { className: "block" }, note ? h("p", { className: "faint" }, note) : null,
      button("Propose the region", () => this.propose(), { title: "the largest speckled part of the photograph, as the stage finds it" }));
  }

  async propose() {
    this.app.say("looking for the speckled specimen …");
    try {
      const { polygons } = await ask("proposed", { file: this.app.file, stage: this.drawing.regions[0] });
      if (this.isLeft) return;
      const probes = this.pen.paths.filter((path) => SORTS[path.sort].probe || path.sort === "cut");
      this.pen.load([...pathsOf({ polygons }, null), ...probes]);
      this.pen.choose(0);
      await this.commit("the proposed region; edit it, or undo");
    } catch (error) {
      await this.app.fail(error);
    }
  }

  listed(words, fits) {
    const rows = this.pen.paths.map((path, number) => [path, number]).filter(([path]) => fits(path.sort));
    return h("div", { className: "block" }, h("h2", {}, words),
      rows.length ? null : h("p", { className: "faint" }, words === "Region" ? "Draw an outline (O), or let one be proposed." : "Place a point (P), a line (L), an extensometer (E) or an area (A)."),
      h("ul", { className: "paths" }, rows.map(([path, number]) => h("li", {}, h("button", {
        type: "button", className: "path-name", "aria-pressed": String(number === this.pen.chosen.path), onclick: () => this.pen.choose(number),
      }, h("span", { className: `swatch ${path.sort}` }), path.name || SORTS[path.sort].title, h("span", { className: "faint" }, SORTS[path.sort].most ? SORTS[path.sort].title : `${path.places.length} corners`))))));
  }

  rest() {
    if (!this.atRest.length) return null;
    return h("div", { className: "block rest" }, h("h2", {}, "At rest, in the last run"), this.atRest.map((words) => h("p", {}, words)));
  }

  /** Numbers of the chosen path, to be typed. */
  numbers() {
    const { path: number } = this.pen.chosen;
    const path = this.pen.paths[number];
    if (!path) return null;
    const sort = SORTS[path.sort];
    return h("div", { className: "block" }, h("h2", {}, path.name ? "Name and places" : `Corners of the ${sort.title.toLowerCase()}`),
      sort.probe ? h("label", {}, "name ", h("input", { value: path.name, onchange: (event) => this.rename(path, event.target) })) : null,
      h("table", {}, h("thead", {}, h("tr", {}, ["", "x [px]", "y [px]"].map((word) => h("th", {}, word)))),
        h("tbody", {}, path.places.slice(0, MOST_ROWS).map((place, k) => h("tr", { className: k === this.pen.chosen.corner ? "chosen" : "" },
          h("td", { className: "faint" }, String(k + 1)), [0, 1].map((axis) => h("td", {}, this.coordinate(number, k, axis))))))),
      h("div", { className: "row" },
        button("Delete", () => this.pen.remove()),
        path.places.length > 12 && !sort.most ? button("Fewer corners", () => this.thin(path)) : null));
  }

  coordinate(number, corner, axis) {
    const places = this.pen.paths[number].places;
    return h("input", {
      type: "number", step: "any", inputMode: "decimal", value: String(rounded(places[corner][axis])),
      "aria-label": `${axis ? "y" : "x"} of corner ${corner + 1}`,
      onfocus: () => { if (this.pen.chosen.corner !== corner) { this.pen.chosen.corner = corner; this.viewer.draw(); } },
      onchange: (event) => {
        const value = event.target.valueAsNumber;
        if (Number.isFinite(value)) {
          const typed = [...places[corner]];
          typed[axis] = value;
          places[corner] = this.pen.inFrame(typed);
          event.target.value = String(places[corner][axis]);
          this.viewer.draw();
          this.commit(`corner of ${this.pen.title(number)}`);
        } else event.target.value = places[corner][axis];
      },
    });
  }

  rename(path, input) {
    const name = input.value.trim();
    if (!name || this.pen.paths.some((other) => other !== path && other.name === name)) {
      this.app.say(name ? `there is a probe '${name}' already; choose another name` : "a probe needs a name", true);
      input.value = path.name;
      return;
    }
    this.renamed = { [path.name]: name };
    path.name = name;
    this.viewer.draw();
    this.commit(`name ${name}`);
  }

  /** Leave out corners that lie near the line between others: within 1 px, or more until a quarter of them goes. */
  thin(path) {
    const thinned = TOLERANCES.map((tolerance) => simplified(path.places, tolerance, SORTS[path.sort].closed));
    path.places = thinned.find((places) => places.length <= FEWER * path.places.length) ?? thinned[thinned.length - 1];
    this.pen.choose(this.pen.chosen.path);
    this.commit(`${path.places.length} corners`);
  }
}
