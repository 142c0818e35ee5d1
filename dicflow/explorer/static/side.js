// Beside the picture: the curve over the test, the profile along a line, and how many points have a value.

import { Chart } from "./chart.js";
import { COLOURS, loadsOf, nameOf, placesOf, seriesOf, tableOf, titleOf } from "./curves.js";
import { profileOf } from "./frame.js";
import { axisText, brief, capital, fixed, typed, unitText, withError } from "./numbers.js";
import { choice, html } from "./page.js";
import { SurfaceView } from "./surface.js";
import { tableButtons } from "./table.js";

/** The panel beside the picture. */
export class Side {
  constructor(host) {
    this.host = host;
    this.axis = choice("axis of the curve", { step: "Step", load: "Load" }, "step", (axis) => {
      this.along = axis;
      this.axis.show(axis);
      this.showCurve();
    });
    this.along = "step";
    this.axis.element.hidden = !host.manifest.load;
    this.title = html("h3", {});
    this.curve = new Chart(html("div", {}), ({ numbers }, k) =>
      host.change({ step: placesOf(host.manifest, [numbers[k]])[0] ?? host.scene.step }),
    );
    this.chips = html("div", { class: "x-chips" });
    this.profileTitle = html("h3", {});
    this.profile = new Chart(html("div", {}));
    this.ends = ["x of the start", "y of the start", "x of the end", "y of the end"].map((label, k) =>
      html("input", {
        type: "text",
        inputMode: "decimal",
        "aria-label": label,
        title: `${label} [px]`,
        onchange: (event) => this.moveEnd(k, event.target),
      }),
    );
    this.profileBox = html(
      "section",
      { class: "x-block x-profile", hidden: true },
      html(
        "div",
        { class: "x-block-head" },
        this.profileTitle,
        tableButtons(
          () => this.profileTable,
          () => `profile_${host.quantity.name}`,
        ),
      ),
      this.profile.element,
      html(
        "div",
        { class: "x-ends" },
        html("span", {}, "from"),
        this.ends[0],
        this.ends[1],
        html("span", {}, "to"),
        this.ends[2],
        this.ends[3],
        html("span", {}, "px"),
      ),
    );
    this.surface = host.manifest.form === "shape" && host.cameras.space ? new SurfaceView(host) : null;
    this.facts = html("section", { class: "x-block x-facts" });
    this.element = html(
      "div",
      { class: "x-side" },
      html(
        "section",
        { class: "x-block x-curve", hidden: host.manifest.steps.length < 2 },
        html(
          "div",
          { class: "x-block-head" },
          this.title,
          this.axis.element,
          tableButtons(
            () => this.curveTable,
            () => `curve_${host.quantity.name}`,
          ),
        ),
        this.curve.element,
        this.chips,
      ),
      this.profileBox,
      ...(this.surface ? [this.surface.element] : []),
      this.facts,
      keysHelp(),
    );
  }

  /** Shows all of it for the frame of the host. */
  async show() {
    this.showFacts();
    this.showProfile();
    await this.surface?.show();
    await this.showCurve();
  }

  /** Shows the charts again, as of a companion that shows something else now. */
  showCharts() {
    this.showProfile();
    return this.showCurve();
  }

  async showCurve() {
    const { host } = this;
    const { manifest, quantity, scene } = host;
    const asked = (this.asked = (this.asked || 0) + 1);
    const series = await seriesOf(host);
    if (asked !== this.asked) return;
    const byLoad = this.along === "load" && Boolean(manifest.load);
    for (const one of series) one.x = byLoad ? loadsOf(manifest, one.numbers) : one.numbers;
    this.title.textContent = titleOf(host, series);
    const now = [manifest.steps[scene.step].number];
    this.curve.show({
      series,
      label: `${quantity.symbol} over ${byLoad ? "load" : "step"}`,
      xAxis: byLoad ? { text: axisText("load", manifest.load.unit) } : { text: "step", whole: true },
      yAxis: { text: axisText(series[0].symbol, series[0].unit) },
      mark: (byLoad ? loadsOf(manifest, now) : now)[0],
      text: (one, k) => `${nameOf(manifest, one.numbers[k])}: ${withError(one.y[k], one.error[k], one.unit)}${
        series.length > 1 ? `, ${one.name}` : ""
      }`,
    });
    this.curveTable = tableOf(manifest, series);
    this.showChips(series);
  }

  showChips(series) {
    const { host } = this;
    const chip = (one) =>
      html(
        "span",
        { class: "x-chip" },
        dot(one.colour),
        `point ${one.row}, ${one.col}`,
        html(
          "button",
          { type: "button", "aria-label": `remove point ${one.row}, ${one.col}`, onclick: () => host.drop(one) },
          "×",
        ),
      );
    const hint = html("span", { class: "x-hint" }, "Click points of the field for their curves.");
    this.chips.replaceChildren(...(host.points.length ? host.points.map(chip) : [hint]), ...this.key(series));
  }

  /** What the lines of a companion look like, or those of several probes. */
  key(series) {
    const { companion, points } = this.host;
    if (companion) return [html("span", { class: "x-hint" }, `Solid: ${companion.names[0]}. Dashed: ${companion.names[1]}.`)];
    if (points.length || series.length < 2) return [];
    return series.map((one) => html("span", { class: "x-chip" }, dot(one.colour), one.name));
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
    const series = this.profiles();
    const { x: at, y: values } = series[0];
    this.profileTitle.textContent = `${quantity.symbol} along the line`;
    scene.line.flat().forEach((value, k) => {
      if (document.activeElement !== this.ends[k]) this.ends[k].value = fixed(value, 1);
    });
    this.profile.show({
      series,
      label: `${quantity.symbol} along the line`,
      xAxis: { text: "distance [px]" },
      yAxis: { text: axisText(quantity.symbol, quantity.unit) },
      mark: null,
      text: (one, k) => `${fixed(one.x[k], 1)} px: ${withError(one.y[k], NaN, quantity.unit, quantity.scale[1])}`,
    });
    this.profileTable = {
      columns: ["distance [px]", ...series.map((one) => `${one.name} ${axisText(quantity.symbol, quantity.unit)}`.trim())],
      rows: at.map((one, k) => [one, ...series.map(({ y }) => y[k])]),
    };
  }

  /** Profiles along the line, also of a companion. */
  profiles() {
    const { frame, scene, companion } = this.host;
    const one = (shown, facts) => {
      const { at, values } = profileOf(shown, scene.line);
      return { x: at, y: values, error: null, ...facts };
    };
    const own = one(frame, { name: companion?.names[0] ?? "", colour: "var(--x-accent)" });
    const other = companion?.explorer.frame;
    return other ? [own, one(other, { name: companion.names[1], colour: COLOURS[0], dashed: true })] : [own];
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
    const number = (text) => html("span", { class: "x-number" }, text);
    const row = ({ code, label, sentence, colour }) =>
      html(
        "li",
        { title: sentence },
        dot(colour),
        html("span", {}, label),
        number(`${step.counts[code]}`),
        number(share(step.counts[code])),
      );
    const rows = manifest.reasons.filter(({ code }) => code > 0 && step.counts[code]).map(row);
    const rounding = `${brief(quantity.scale[1] / 2, 2)}${unitText(quantity.unit)}`;
    const ratio = Math.max(...Object.values(quantity.errors).map((scale) => scale[1]));
    const errors = ratio > 0 ? `, their uncertainties by ${brief(100 * (Math.sqrt(ratio) - 1), 2)} %` : "";
    const notes = [
      `Values are rounded by at most ${rounding}${errors}.`,
      ...manifest.left_out.map((one) => `${capital(one)}.`),
    ];
    const found = (step.counts[0] || 0) + (step.counts[1] || 0);
    const valid = html("strong", {}, found === whole ? "100 %" : `${fixed(Math.floor((1000 * found) / whole) / 10, 1)} %`);
    const measured = [valid, ` of ${whole.toLocaleString("en")} points have a value at ${step.name}`];
    this.facts.replaceChildren(
      html("p", { class: "x-valid" }, ...(step.valid === null ? ["This step was not measured."] : measured)),
      html("ul", { class: "x-reasons" }, ...rows),
      ...(manifest.rig ? [html("p", { class: "x-rig" }, html("strong", {}, "Is the rig still calibrated? "), manifest.rig)] : []),
      ...(manifest.meaning.length ? [html("p", { class: "x-hint x-meaning" }, manifest.meaning.join(" "))] : []),
      ...notes.map((one) => html("p", { class: "x-hint" }, one)),
    );
  }
}

const KEYS = {
  "← →": "step",
  "Home End": "first and last step",
  Space: "play, pause",
  "+ − 0": "zoom, whole field",
  "Shift and arrows": "read the neighbouring point",
  Enter: "choose that point",
  Esc: "drop points and line",
  Wheel: "zoom, once the picture was clicked or with Ctrl",
  Drag: "move the picture or turn the surface",
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
