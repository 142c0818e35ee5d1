// What stands around the picture: quantity, cameras, tools, the bar of colours, and the steps.

import { axisText, brief, typed } from "./numbers.js";
import { choice, html } from "./page.js";

/** The line above the picture. */
export class Toolbar {
  constructor(host) {
    const { manifest } = host;
    this.quantity = html("select", { class: "x-quantity", "aria-label": "quantity", onchange: () => host.change({ quantity: Number(this.quantity.value) }) },
      ...manifest.quantities.map(({ symbol, title }, k) => new Option(`${symbol} · ${shortTitle(title, symbol)}`, k)));
    const cameras = host.cameras;
    this.camera = choice("where", cameras, host.scene.camera, (camera) => host.change({ camera }));
    this.over = choice("shown over", { step: "This step", first: "First step" }, "step", (over) => host.change({ over }));
    this.over.element.hidden = !(manifest.first && manifest.first.place);
    this.tool = choice("pointer", { point: "Point", line: "Line" }, "point", (tool) => host.change({ tool }));
    this.reasons = html("button", { type: "button", class: "x-toggle", "aria-pressed": "false", onclick: () => host.change({ reasons: !host.scene.reasons }) }, "Gaps");
    this.whole = html("button", { type: "button", class: "x-icon", title: "Show the whole field (0)", onclick: () => host.stage.reset() }, "⤢");
    this.save = html("button", { type: "button", class: "x-icon", title: "Save this picture", "aria-label": "Save this picture", onclick: () => host.savePicture() }, "⤓");
    this.whole.setAttribute("aria-label", "Show the whole field");
    this.element = html("div", { class: "x-toolbar" }, this.quantity,
      html("div", { class: "x-tools" }, ...(Object.keys(cameras).length > 1 ? [this.camera.element] : []), this.over.element, this.tool.element, this.reasons, this.whole, this.save));
    this.canOver = !this.over.element.hidden;
  }

  show(scene) {
    this.quantity.value = scene.quantity;
    this.camera.show(scene.camera);
    this.over.show(scene.over);
    this.over.element.hidden = !this.canOver || scene.camera !== "left";
    this.tool.show(scene.tool);
    this.tool.element.hidden = scene.camera === "space";
    this.reasons.setAttribute("aria-pressed", String(scene.reasons));
    this.reasons.hidden = scene.camera === "space";
  }
}

/** A title without its symbol and without what the caption below repeats. */
export function shortTitle(title, symbol) {
  return title.split(", VSG")[0].replace(/\s*\([^)]*\)/g, "").replace(symbol, "").replace(/\s+/g, " ").trim();
}

/** The colours with their numbers, which can be typed. */
export class Legend {
  constructor(host) {
    this.host = host;
    this.title = html("div", { class: "x-legend-title" });
    this.bar = html("canvas", { width: 256, height: 1, class: "x-legend-bar" });
    this.pointer = html("span", { class: "x-legend-pointer", hidden: true });
    this.numbers = html("div", { class: "x-legend-numbers", "aria-hidden": "true" });
    const field = (label, end) => html("input", { type: "text", inputMode: "decimal", "aria-label": label, onchange: (event) => this.typed(end, event.target) });
    this.ends = [field("lower end of the colours", 0), field("upper end of the colours", 1)];
    this.map = html("select", { "aria-label": "colour map", onchange: () => host.change({ colours: this.map.value }) },
      ...Object.keys(host.manifest.palettes).map((name) => new Option(name, name)));
    const range = (text, title, change) => html("button", { type: "button", class: "x-quiet", title, onclick: change }, text);
    this.opacity = html("input", { type: "range", min: 0, max: 1, step: 0.05, value: host.scene.opacity, "aria-label": "opacity of the field", oninput: () => host.change({ opacity: Number(this.opacity.value) }) });
    this.opacityLabel = html("label", { class: "x-opacity" }, "Opacity", this.opacity);
    this.element = html("div", { class: "x-legend" },
      this.title,
      html("div", { class: "x-legend-line" }, this.ends[0],
        html("div", { class: "x-legend-middle" }, html("div", { class: "x-legend-box" }, this.bar, this.pointer), this.numbers), this.ends[1]),
      html("div", { class: "x-legend-choices" },
        range("All steps", "Colours for the values of all steps", () => host.setRange(null)),
        range("This step", "Colours for the values of this step", () => host.setRange(host.frame && host.frame.range)),
        this.map, this.opacityLabel));
  }

  typed(end, input) {
    const value = typed(input.value);
    const range = [...this.host.range];
    range[end] = value;
    if (Number.isFinite(value) && range[0] < range[1]) this.host.setRange(range);
    input.classList.toggle("x-wrong", !(Number.isFinite(value) && range[0] < range[1]));
    if (!Number.isFinite(value)) this.show();
  }

  show() {
    const { host } = this;
    const { quantity, range, palette, scene } = host;
    this.title.textContent = axisText(quantity.title.includes(quantity.symbol) ? quantity.title : `${quantity.title} ${quantity.symbol}`, quantity.unit);
    const picture = new ImageData(256, 1);
    for (let k = 0; k < 256; k++) picture.data.set([palette[3 * k], palette[3 * k + 1], palette[3 * k + 2], 255], 4 * k);
    this.bar.getContext("2d").putImageData(picture, 0, 0);
    this.ends.forEach((input, end) => { if (document.activeElement !== input || !input.classList.contains("x-wrong")) input.value = brief(range[end]); input.classList.remove("x-wrong"); });
    this.numbers.replaceChildren(...roundTicks(...range, 4).filter(({ value }) => inner(value, range)).map(({ value, text }) => {
      const mark = html("span", {}, text);
      mark.style.left = `${(100 * (value - range[0])) / (range[1] - range[0])}%`;
      return mark;
    }));
    this.map.value = scene.colours || quantity.colours;
    this.opacityLabel.hidden = scene.camera === "space" || !host.photograph;
  }

  /** Shows where a value lies in the colours; NaN for none. */
  point(value) {
    const [low, high] = this.host.range;
    this.pointer.hidden = !Number.isFinite(value);
    this.pointer.style.left = `${Math.max(0, Math.min(100, (100 * (value - low)) / (high - low)))}%`;
  }
}

function inner(value, [low, high]) {
  const share = (value - low) / (high - low);
  return share > 0.06 && share < 0.94;
}

/** The steps: play, a slider, and the name of the one that is shown. */
export class Transport {
  constructor(host) {
    this.host = host;
    const { steps } = host.manifest;
    this.play = html("button", { type: "button", class: "x-play", onclick: () => host.play(!host.playing) });
    this.slider = html("input", { type: "range", min: 0, max: Math.max(0, steps.length - 1), step: 1, "aria-label": "step", oninput: () => host.change({ step: Number(this.slider.value) }) });
    this.name = html("output", { class: "x-step-name" });
    this.element = html("div", { class: "x-transport" }, this.play, this.slider, this.name);
    this.element.hidden = steps.length < 2;
  }

  show(scene) {
    const { manifest, playing } = this.host;
    const step = manifest.steps[scene.step];
    this.slider.value = scene.step;
    this.slider.setAttribute("aria-valuetext", step.name);
    const load = manifest.load && manifest.load[1][scene.step];
    this.name.textContent = [step.name, ...(load === null || load === undefined ? [] : [`${brief(load)} ${manifest.load[0]}`])].join(" · ");
    this.play.textContent = playing ? "❚❚" : "▶";
    this.play.setAttribute("aria-label", playing ? "Pause" : "Play");
    this.play.title = playing ? "Pause (space)" : "Play (space)";
  }
}
