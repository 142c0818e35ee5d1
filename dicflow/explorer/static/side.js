// Beside the picture: the curve over the test, the profile along a line, and how many points have a value.

import { Chart } from "./chart.js";
import { curveOf, profileOf } from "./frame.js";
import { axisText, brief, decimalsFor, fixed, typed, unitText } from "./numbers.js";
import { choice, html } from "./page.js";
import { SurfaceView } from "./surface.js";
import { tableButtons } from "./table.js";

const COLOURS = ["#d1495b", "#2a7f9e", "#e09f3e", "#5a8f3c", "#7d5ba6", "#3d405b"];

/** The panel beside the picture. */
export class Side {
  constructor(host) {
    this.host = host;
    this.axis = choice("axis of the curve", { step: "Step", load: "Load" }, "step", (axis) => { this.along = axis; this.axis.show(axis); this.showCurve(); });
    this.along = "step";
    this.axis.element.hidden = !host.manifest.load;
    this.title = html("h3", {});
    this.curve = new Chart(html("div", {}), (_, k) => host.change({ step: this.stepAt[k] ?? host.scene.step }));
    this.chips = html("div", { class: "x-chips" });
    this.profileTitle = html("h3", {});
    this.profile = new Chart(html("div", {}));
    this.ends = ["x of the start", "y of the start", "x of the end", "y of the end"].map((label, k) =>
      html("input", { type: "text", inputMode: "decimal", "aria-label": label, title: `${label} [px]`, onchange: (event) => this.moveEnd(k, event.target) }));
    this.profileBox = html("section", { class: "x-block", hidden: true },
      html("div", { class: "x-block-head" }, this.profileTitle, tableButtons(() => this.profileTable, () => `profile_${host.quantity.name}`)),
      this.profile.element,
      html("div", { class: "x-ends" }, html("span", {}, "from"), this.ends[0], this.ends[1], html("span", {}, "to"), this.ends[2], this.ends[3], html("span", {}, "px")));
    this.surface = host.manifest.form === "shape" && host.cameras.space ? new SurfaceView(host) : null;
    this.facts = html("section", { class: "x-block x-facts" });
    this.element = html("div", { class: "x-side" },
      html("section", { class: "x-block", hidden: host.manifest.steps.length < 2 },
        html("div", { class: "x-block-head" }, this.title, this.axis.element, tableButtons(() => this.curveTable, () => `curve_${host.quantity.name}`)),
        this.curve.element, this.chips),
      this.profileBox, ...(this.surface ? [this.surface.element] : []), this.facts, keysHelp());
  }

  /** Shows all of it for the frame of the host. */
  async show() {
    this.showFacts();
    this.showProfile();
    await this.surface?.show();
    await this.showCurve();
  }

  /** Series of the chosen points, else of the probes, else the mean of the field. */
  async series() {
    const { host } = this;
    const { manifest, quantity, scene } = host;
    if (host.points.length) {
      const curves = await Promise.all(host.points.map((one) => curveOf(host.fields, scene, one)));
      return curves.map(({ values, sigmas }, k) => ({ name: pointName(host.points[k]), colour: host.points[k].colour, numbers: manifest.steps.map((step) => step.number), y: values, error: sigmas }));
    }
    const probes = manifest.curves.filter((one) => one.quantity === quantity.name || (one.quantity === "strain" && quantity.name === manifest.main[0]));
    if (probes.length) {
      const number = (value) => (value === null ? NaN : value);
      return probes.map((one, k) => ({ name: one.title, colour: k ? COLOURS[(k - 1) % COLOURS.length] : "var(--x-accent)", numbers: one.numbers, y: one.values.map(number), error: one.sigmas.map(number), unit: one.unit }));
    }
    const part = (k) => quantity.means.map((pair) => (pair ? pair[k] : NaN));
    return [{ name: "mean of the field ± spread", colour: "var(--x-accent)", numbers: manifest.steps.map((step) => step.number), y: part(0), error: part(1) }];
  }

  async showCurve() {
    const { host } = this;
    const { manifest, quantity, scene } = host;
    const asked = (this.asked = (this.asked || 0) + 1);
    const series = await this.series();
    if (asked !== this.asked) return;
    const byLoad = this.along === "load" && manifest.load;
    const loads = new Map(manifest.steps.map((step, k) => [step.number, byLoad && manifest.load[1][k] !== null ? manifest.load[1][k] : NaN]));
    for (const one of series) one.x = one.numbers.map((number) => (byLoad ? loads.get(number) ?? NaN : number));
    const places = new Map(manifest.steps.map((step, k) => [step.number, k]));
    this.stepAt = series.length ? series[0].numbers.map((number) => places.get(number)) : [];
    const now = manifest.steps[scene.step].number;
    const names = new Map(manifest.steps.map((step) => [step.number, step.name]));
    this.title.textContent = host.points.length ? `${quantity.symbol} at ${host.points.length === 1 ? "the point" : "points"}` : series.length === 1 ? capital(series[0].name) : "Probes";
    const own = series.every((one) => one.unit === undefined);
    this.curve.show({
      series,
      label: `${quantity.symbol} over ${byLoad ? "load" : "step"}`,
      xAxis: byLoad ? { text: axisText("load", manifest.load[0]) } : { text: "step", whole: true },
      yAxis: { text: own ? axisText(quantity.symbol, quantity.unit) : axisText(series[0].name.startsWith("strain") ? "strain" : quantity.symbol, series[0].unit) },
      mark: byLoad ? loads.get(now) : now,
      text: (one, k) => `${names.get(one.numbers[k]) ?? "first step"}: ${withError(one.y[k], one.error[k], one.unit ?? quantity.unit)}`,
    });
    this.curveTable = {
      columns: ["step", ...(byLoad || manifest.load ? [axisText("load", manifest.load[0])] : []), ...series.flatMap((one) => [`${one.name} ${axisText(quantity.symbol, one.unit ?? quantity.unit)}`, `± ${one.name}`])],
      rows: (series[0]?.numbers ?? []).map((number, k) => [
        names.get(number) ?? "first step",
        ...(manifest.load ? [manifest.load[1][places.get(number)] ?? NaN] : []),
        ...series.flatMap((one) => [one.y[k], one.error[k]]),
      ]),
    };
    this.showChips();
  }

  showChips() {
    const { host } = this;
    const chip = (one) => html("span", { class: "x-chip" }, dot(one.colour), `point ${one.row}, ${one.col}`,
      html("button", { type: "button", "aria-label": `remove point ${one.row}, ${one.col}`, onclick: () => host.drop(one) }, "×"));
    const hint = html("span", { class: "x-hint" }, "Click points of the field for their curves.");
    this.chips.replaceChildren(...(host.points.length ? host.points.map(chip) : [hint]));
  }

  /** The colour of the next chosen point. */
  nextColour() {
    const used = this.host.points.map((one) => one.colour);
    return COLOURS.find((colour) => !used.includes(colour)) || COLOURS[used.length % COLOURS.length];
  }

  showProfile() {
    const { host } = this;
    const { frame, quantity, scene } = host;
    this.profileBox.hidden = !scene.line || scene.camera === "space";
    if (this.profileBox.hidden || !frame) return;
    const { at, values } = profileOf(frame, scene.line);
    this.profileTitle.textContent = `${quantity.symbol} along the line`;
    scene.line.flat().forEach((value, k) => { if (document.activeElement !== this.ends[k]) this.ends[k].value = fixed(value, 1); });
    this.profile.show({
      series: [{ name: "profile", colour: "var(--x-accent)", x: at, y: values, error: null }],
      label: `${quantity.symbol} along the line`,
      xAxis: { text: "distance [px]" },
      yAxis: { text: axisText(quantity.symbol, quantity.unit) },
      mark: null,
      text: (one, k) => `${fixed(one.x[k], 1)} px: ${withError(one.y[k], NaN, quantity.unit, quantity.scale[1])}`,
    });
    this.profileTable = { columns: ["distance [px]", axisText(quantity.symbol, quantity.unit)], rows: at.map((one, k) => [one, values[k]]) };
  }

  moveEnd(k, input) {
    const value = typed(input.value);
    if (!Number.isFinite(value)) return this.showProfile();
    const ends = this.host.scene.line.flat();
    ends[k] = value;
    return this.host.line([ends.slice(0, 2), ends.slice(2)], true);
  }

  showFacts() {
    const { host } = this;
    const { manifest, quantity, scene } = host;
    const step = manifest.steps[scene.step];
    const whole = Object.values(step.counts).reduce((sum, one) => sum + one, 0);
    const share = (count) => `${fixed((100 * count) / whole, count === whole ? 0 : 1)} %`;
    const rows = manifest.reasons.filter(({ code }) => code > 0 && step.counts[code]).map(({ code, label, sentence, colour }) =>
      html("li", { title: sentence }, dot(colour), html("span", {}, label), html("span", { class: "x-number" }, `${step.counts[code]}`), html("span", { class: "x-number" }, share(step.counts[code]))));
    const notes = [`Values are rounded by at most ${brief(quantity.scale[1] / 2, 2)}${unitText(quantity.unit)}` + (quantity.sigma ? `, σ by ${brief(100 * (Math.sqrt(quantity.sigma[1]) - 1), 2)} %.` : "."), ...manifest.left_out.map((one) => `${capital(one)}.`)];
    this.facts.replaceChildren(
      html("p", { class: "x-valid" }, step.valid === null ? "This step was not measured." : html("strong", {}, share((step.counts[0] || 0) + (step.counts[1] || 0))), step.valid === null ? "" : ` of ${whole.toLocaleString("en")} points have a value at ${step.name}`),
      html("ul", { class: "x-reasons" }, ...rows),
      ...notes.map((one) => html("p", { class: "x-hint" }, one)));
  }
}

const KEYS = {
  "← →": "step", "Home End": "first and last step", "Space": "play, pause", "+ − 0": "zoom, whole field",
  "Shift and arrows": "read the neighbouring point", "Enter": "choose that point", "Esc": "drop points and line",
  "Wheel": "zoom, once the picture was clicked or with Ctrl", "Drag": "move the picture or turn the surface",
};

function keysHelp() {
  const rows = Object.entries(KEYS).flatMap(([key, does]) => [html("dt", {}, key), html("dd", {}, does)]);
  return html("details", { class: "x-keys" }, html("summary", {}, "Keys"), html("dl", {}, ...rows));
}

/** A coloured dot. */
export function dot(colour) {
  const made = html("span", { class: "x-dot" });
  made.style.background = colour;
  return made;
}

/** A value with its error and unit; digits follow the error, or what the value is rounded to. */
export function withError(value, error, unit, quantum = NaN) {
  if (!Number.isFinite(value)) return "no value";
  const known = Number.isFinite(error) && error > 0;
  const decimals = decimalsFor(known ? error : quantum);
  const number = known || Number.isFinite(quantum) ? fixed(value, decimals) : brief(value, 5);
  return `${number}${known ? ` ± ${fixed(error, decimals)}` : ""}${unitText(unit)}`;
}

function pointName({ row, col }) {
  return `point ${row}, ${col}`;
}

function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
