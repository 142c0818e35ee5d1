// The screen "caliper": strains beside those of a caliper as a curve and a table, and what is compared.

import { Chart } from "/explorer/chart.js";
import { axisText, withError } from "/explorer/numbers.js";
import { Newest, ask } from "./api.js";
import { button, empty, fill, h } from "./dom.js";

export const title = "Caliper";
const LOOK_MS = 700;
const COVERAGE = 2;
const SAME_LENGTH = 0.02; // difference of the first lengths, as a share
const CALIPER = "#d1495b";
const PHASES = ["loading", "unloading"];

export async function show(place, app) {
  if (!app.file) {
    fill(place, empty(title, "There is no pipeline file yet. Begin with the folder: it proposes one.", button("Go to the folder", () => app.go("folder"), { className: "main" })));
    return null;
  }
  const screen = new CaliperScreen(place, app);
  await screen.open();
  return screen;
}

class CaliperScreen {
  constructor(place, app) {
    Object.assign(this, { place, app, along: "load", comparisons: new Newest() });
  }

  async open() {
    const found = await this.comparisons.of(ask("caliper", { file: this.app.file }));
    if (!found) return;
    this.found = found;
    this.draw();
  }

  leave() {
    this.comparisons.drop();
    clearTimeout(this.later);
    this.isLeft = true;
  }

  draw() {
    const { found } = this;
    fill(this.place, h("div", { className: "page" }, h("h1", {}, "Comparison with the caliper"), this.answer(), this.result(), this.compared(), this.lengths()));
    if (found.rows) this.curve();
  }

  get measured() {
    return this.found.rows.map((row, k) => ({ ...row, step: this.found.steps[k] ?? `step ${k + 1}` })).filter((row) => row.dic_strain !== null);
  }

  /** The largest difference in one sentence. */
  answer() {
    const { rows, stage, lengths } = this.found;
    if (!rows) return h("p", {}, stage ? "Not computed yet for what the file gives now." : lengths ? "" : "Type below what the caliper showed at each step.");
    const later = this.measured.slice(1).filter((row) => row.strain_error !== null);
    if (!later.length) return h("p", { className: "problem" }, "No later step has a strain; look at the fields for the reason.");
    const worst = later.reduce((most, row) => (Math.abs(row.strain_error) > Math.abs(most.strain_error) ? row : most));
    const known = later.filter((row) => row.u_difference !== null);
    const within = known.filter((row) => Math.abs(row.strain_error) <= COVERAGE * row.u_difference).length;
    const share = worst.strain_error_pct === null ? "" : `, ${Math.abs(worst.strain_error_pct).toFixed(1)} % of the caliper's strain`;
    return h("p", { className: "verdict" }, `The largest difference of the strain is ${withError(worst.strain_error, worst.u_difference, "1")} at ${worst.step}${share}.`,
      known.length ? ` ${within} of ${known.length} differences are smaller than twice their standard uncertainty.` : "");
  }

  result() {
    const { found } = this;
    if (!found.rows) {
      if (!found.stage) return null;
      return h("div", { className: "card" }, h("div", { className: "row" }, this.start = button("Compute the comparison", () => this.compute(), { className: "main" }), h("span", { className: "faint" }, "computes what is missing for it")));
    }
    this.charts = h("div", { className: "explorer" });
    const axis = h("label", {}, "over ", h("select", { onchange: (event) => { this.along = event.target.value; this.curve(); } }, ["load", "step"].map((value) => h("option", { value, selected: value === this.along }, value))));
    return h("div", { className: "card" }, h("div", { className: "row" }, h("h2", {}, "Strain"), axis), this.charts,
      h("p", { className: "faint" }, "Solid: dicflow. Dashed: the caliper. Difference: dicflow − caliper. Bars and bands are ± the standard uncertainty."),
      h("div", { className: "scroll" }, this.table()));
  }

  /** Strains, and their differences, over the load or the step. */
  curve() {
    const rows = this.measured;
    const byLoad = this.along === "load";
    const x = rows.map((row) => (byLoad ? row.load_g : this.found.steps.indexOf(row.step)));
    const known = (key) => rows.map((row) => row[key] ?? NaN);
    const dicflow = { name: "dicflow", colour: "var(--x-accent)", x, y: known("dic_strain"), error: known("u_strain") };
    const caliper = { name: "caliper", colour: CALIPER, x, y: known("caliper_strain"), error: null, dashed: true };
    const difference = { name: "dicflow − caliper", colour: "var(--x-accent)", x, y: known("strain_error"), error: known("u_difference") };
    const shared = {
      mark: null, xAxis: byLoad ? { text: axisText("load", "g") } : { text: "step, 0 without load", whole: true },
      text: (one, k) => `${one.name}, ${rows[k].step}: ${withError(one.y[k], one.error?.[k] ?? NaN, "1")}`,
    };
    fill(this.charts, [[[dicflow, caliper], "strain"], [[difference], "difference of the strains"]].map(([series, words]) => {
      const place = h("div", {});
      new Chart(place).show({ ...shared, series, label: `${words} over ${this.along}`, yAxis: { text: axisText(words, "1") } });
      return place;
    }));
  }

  table() {
    const unit = "dic_length_px" in this.found.rows[0] ? "px" : "mm";
    const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
    const head = ["step", "phase", "load [g]", "caliper [mm]", `dicflow [${unit}]`, "strain, caliper [–]", "strain, dicflow [–]", "difference [–]", "difference [%]"];
    return h("table", {}, h("thead", {}, h("tr", {}, head.map((word, k) => h("th", { className: k > 1 ? "number" : "" }, word)))),
      h("tbody", {}, this.found.rows.map((row, k) => h("tr", {}, h("td", {}, this.found.steps[k] ?? ""), h("td", {}, row.phase),
        [number(row.load_g, 2), number(row.caliper_length_mm, 2), number(row[`dic_length_${unit}`], 3), number(row.caliper_strain, 5),
          pair(row.dic_strain, row.u_strain), pair(row.strain_error, row.u_difference), number(row.strain_error_pct, 1)].map((words) => h("td", { className: "number" }, words))))));
  }

  /** Which extensometer, and which table. */
  compared() {
    const { found } = this;
    if (!found.stage) return null;
    const choose = (key, value, words) => this.edit([{ place: ["stages", found.stage, key], ...(value ? { value } : {}) }], words);
    const names = found.extensometers.includes(found.extensometer) || !found.extensometer ? found.extensometers : [found.extensometer, ...found.extensometers];
    return h("div", { className: "card" }, h("h2", {}, "What is compared"),
      h("div", { className: "row" },
        h("label", {}, "extensometer ", h("select", { onchange: (event) => choose("extensometer", event.target.value, "extensometer of the comparison") },
          h("option", { value: "", selected: !found.extensometer }, "none: the whole region"),
          names.map((name) => h("option", { value: name, selected: name === found.extensometer }, name)))),
        found.files.length > 1 ? h("label", {}, "table ", h("select", { onchange: (event) => choose("caliper", event.target.value, "table of the caliper") }, found.files.map((name) => h("option", { value: name, selected: name === found.file }, name)))) : h("span", { className: "faint" }, `table ${found.file}`)),
      h("p", { className: "faint" }, "Place the extensometer where the caliper touched the specimen: its first length should be the caliper's. ", h("a", { href: "#region" }, "Place or move it")),
      this.otherLength(),
      found.read_mm ? h("p", { className: "faint" }, `The ± of a difference has dicflow's uncertainty, and that of lengths read in steps of ${found.read_mm} mm. How the caliper was placed is not in it.`) : null);
  }

  /** An extensometer that is not as long as what the caliper measured. */
  otherLength() {
    const [first] = (this.found.extensometer && this.found.rows) || [];
    const [own, caliper] = [first?.dic_length_mm, first?.caliper_length_mm];
    if (!own || Math.abs(own / caliper - 1) <= SAME_LENGTH) return null;
    return h("p", {}, `Without load the extensometer is ${own.toFixed(1)} mm long, and the caliper showed ${caliper.toFixed(1)} mm: strains that differ along the specimen need not agree.`);
  }

  /** The lengths, to be typed. */
  lengths() {
    const { found } = this;
    const typed = found.steps.map((_, k) => found.lengths?.[k] ?? { phase: PHASES[0], load_g: "", length_mm: "" });
    const field = (row, key, words, step) => h("input", { value: String(row[key]), size: 8, inputMode: "decimal", "aria-label": `${words} at ${step}`, onchange: (event) => { row[key] = event.target.value; } });
    const own = h("table", { className: "narrow" }, h("thead", {}, h("tr", {}, ["step", "phase", "load [g]", "length [mm]"].map((word) => h("th", {}, word)))),
      h("tbody", {}, found.steps.map((step, k) => h("tr", {}, h("td", {}, step),
        h("td", {}, h("select", { "aria-label": `phase at ${step}`, onchange: (event) => { typed[k].phase = event.target.value; } }, PHASES.map((phase) => h("option", { value: phase, selected: typed[k].phase === phase }, phase)))),
        h("td", {}, field(typed[k], "load_g", "load", step)), h("td", {}, field(typed[k], "length_mm", "length", step))))));
    const words = found.lengths ? "Lengths of the caliper" : "Type the lengths of the caliper";
    const fits = found.lengths?.length === found.steps.length;
    return h("details", { className: "card", open: !fits }, h("summary", {}, words),
      h("p", { className: "faint" }, `They stand in ${found.file} beside the photographs, one row per photograph; the first is without load.`),
      found.lengths && !fits ? h("p", { className: "problem" }, `${found.file} has ${found.lengths.length} ${found.lengths.length === 1 ? "row" : "rows"}, but there are ${found.steps.length} photographs.`) : null,
      own, h("div", { className: "row" }, button("Save the lengths", () => this.save(typed), { className: found.lengths ? "" : "main" })));
  }

  async save(typed) {
    try {
      await this.app.write("lengths", { lengths: typed }, { [this.found.file]: this.found.digest });
      await this.open();
      this.app.say("saved: lengths of the caliper");
    } catch (error) {
      await this.app.fail(error);
    }
  }

  async edit(edits, words) {
    try {
      await this.app.write("edit", { edits, words });
      this.app.say(`saved: ${words}`);
    } catch (error) {
      await this.app.fail(error);
    }
    await this.open();
  }

  /** Run the pipeline, and show what it came to. */
  async compute() {
    this.start.disabled = true;
    try {
      await ask("start", { file: this.app.file });
      this.app.say("started; the screen Run shows how it goes on");
      await this.wait();
    } catch (error) {
      await this.app.fail(error);
      this.start.disabled = false;
    }
  }

  async wait() {
    const { state, failures } = await ask("watch", { file: this.app.file });
    if (this.isLeft) return;
    if (["starting", "running"].includes(state)) {
      this.later = setTimeout(() => this.wait().catch((error) => this.app.fail(error)), LOOK_MS);
      return;
    }
    if (failures?.length) await this.app.fail(new Error(failures[0].text));
    this.app.plan();
    await this.open();
  }
}

/** A strain with its uncertainty, no digits beyond it. */
function pair(value, error) {
  return value === null || value === undefined ? "–" : withError(value, error ?? NaN, "1");
}
