// What stands around the picture: quantity, cameras, tools, the bar of colours, and the steps.

import { directionKeys } from "./directions.js";
import { axisText, brief, roundTicks, short, typed } from "./numbers.js";
import { choice, html, icon } from "./page.js";

const [MOST_TICKS, TICK_WIDTH, USUAL_WIDTH] = [6, 48, 300]; // numbers at the bar of colours, and px of each and of the bar

const TOGGLES = [
  {
    text: "Undeformed",
    title: "Draw the field over the first photograph",
    cameras: ["left"],
    exists: ({ first }) => Boolean(first),
    pressed: ({ over }) => over === "first",
    change: ({ over }) => ({ over: over === "first" ? "step" : "first" }),
  },
  {
    text: "Line",
    title: "Draw a line with the pointer, for a profile",
    cameras: ["left", "right"],
    exists: () => true,
    pressed: ({ tool }) => tool === "line",
    change: ({ tool }) => ({ tool: tool === "line" ? "point" : "line" }),
  },
  {
    text: "Gaps",
    title: "Show why points have no value",
    cameras: ["left"],
    exists: () => true,
    pressed: ({ reasons }) => reasons,
    change: ({ reasons }) => ({ reasons: !reasons }),
  },
  {
    text: "Directions",
    title: "Show the directions of the larger principal strain",
    cameras: ["left"],
    exists: ({ directions, quantities }) => Boolean(directions) && directionKeys(quantities).length > 0,
    pressed: ({ directions }) => directions,
    change: ({ directions }) => ({ directions: !directions }),
  },
  {
    text: "Cameras",
    title: "Show both cameras",
    cameras: ["space"],
    exists: ({ cameras }) => cameras.length > 0,
    pressed: ({ rig }) => rig,
    change: ({ rig }) => ({ rig: !rig }),
  },
];

/** The line above the picture. */
export class Toolbar {
  constructor(host) {
    const { manifest } = host;
    this.quantity = html(
      "select",
      {
        class: "x-quantity",
        "aria-label": "quantity",
        onchange: () => host.change({ quantity: Number(this.quantity.value) }),
      },
      ...manifest.quantities.map(({ symbol, title }, k) => new Option(`${symbol} · ${shortTitle(title, symbol)}`, k)),
    );
    const cameras = host.cameras;
    this.camera = choice("where", cameras, host.scene.camera, (camera) => host.change({ camera }));
    this.toggles = TOGGLES.filter((one) => one.exists(manifest)).map((one) => ({
      ...one,
      button: html(
        "button",
        { type: "button", class: "x-toggle", title: one.title, onclick: () => host.change(one.change(host.scene)) },
        one.text,
      ),
    }));
    const signed = (name, title, act) =>
      html("button", { type: "button", class: "x-icon", title, "aria-label": title, onclick: act }, icon(name));
    this.element = html(
      "div",
      { class: "x-toolbar" },
      this.quantity,
      html(
        "div",
        { class: "x-tools" },
        ...(Object.keys(cameras).length > 1 ? [this.camera.element] : []),
        ...this.toggles.map((one) => one.button),
        signed("whole", "Show the whole field (0)", () => host.stage.reset()),
        signed("save", "Save this picture", () => host.savePicture()),
        signed("screen", "Full screen", () => host.fullScreen()),
      ),
    );
  }

  show(scene) {
    this.quantity.value = scene.quantity;
    this.camera.show(scene.camera);
    for (const { button, cameras, pressed } of this.toggles) {
      button.setAttribute("aria-pressed", String(pressed(scene)));
      button.hidden = !cameras.includes(scene.camera);
    }
  }
}

/** A title without its symbol and without what the caption below repeats. */
export function shortTitle(title, symbol) {
  return title
    .split(", VSG")[0]
    .split(" = ")[0]
    .replace(/\s*\([^)]*\)/g, "")
    .replace(symbol, "")
    .replace(/^[\s,]+/, "")
    .replace(/\s+/g, " ")
    .trim();
}

/** The colours with their numbers, which can be typed. */
export class Legend {
  constructor(host) {
    this.host = host;
    this.title = html("div", { class: "x-legend-title" });
    this.bar = html("canvas", { width: 256, height: 1, class: "x-legend-bar" });
    this.pointer = html("span", { class: "x-legend-pointer", hidden: true });
    this.numbers = html("div", { class: "x-legend-numbers", "aria-hidden": "true" });
    const field = (label, end) =>
      html("input", {
        type: "text",
        inputMode: "decimal",
        "aria-label": label,
        onchange: (event) => this.typed(end, event.target),
      });
    this.ends = [field("lower end of the colours", 0), field("upper end of the colours", 1)];
    this.map = html(
      "select",
      { "aria-label": "colour map", onchange: () => host.change({ colours: this.map.value }) },
      ...Object.keys(host.manifest.palettes).map((name) => new Option(name, name)),
    );
    const range = (text, title, change) =>
      html("button", { type: "button", class: "x-quiet", title, onclick: change }, text);
    this.opacity = html("input", {
      type: "range",
      min: 0,
      max: 1,
      step: 0.05,
      value: host.scene.opacity,
      "aria-label": "opacity of the field",
      oninput: () => host.change({ opacity: Number(this.opacity.value) }),
    });
    this.opacityLabel = html("label", { class: "x-opacity" }, "Opacity", this.opacity);
    this.element = html(
      "div",
      { class: "x-legend" },
      this.title,
      html(
        "div",
        { class: "x-legend-line" },
        this.ends[0],
        html(
          "div",
          { class: "x-legend-middle" },
          html("div", { class: "x-legend-box" }, this.bar, this.pointer),
          this.numbers,
        ),
        this.ends[1],
      ),
      html(
        "div",
        { class: "x-legend-choices" },
        ...(host.manifest.steps.length < 2
          ? []
          : [
              range("All steps", "Colours for the values of all steps", () => host.setRange(null)),
              range("This step", "Colours for the values of this step", () =>
                host.setRange(host.frame && host.frame.range),
              ),
            ]),
        this.map,
        this.opacityLabel,
      ),
    );
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
    this.title.textContent = axisText(
      quantity.title.includes(quantity.symbol) ? quantity.title : `${quantity.title} ${quantity.symbol}`,
      quantity.unit,
    );
    const picture = new ImageData(256, 1);
    for (let k = 0; k < 256; k++)
      picture.data.set([palette[3 * k], palette[3 * k + 1], palette[3 * k + 2], 255], 4 * k);
    this.bar.getContext("2d").putImageData(picture, 0, 0);
    this.ends.forEach((input, end) => {
      if (document.activeElement !== input || !input.classList.contains("x-wrong")) input.value = short(range[end]);
      input.classList.remove("x-wrong");
    });
    this.numbers.replaceChildren(
      ...roundTicks(...range, Math.min(MOST_TICKS, (this.bar.clientWidth || USUAL_WIDTH) / TICK_WIDTH))
        .filter(({ value }) => inner(value, range))
        .map(({ value, text }) => {
          const mark = html("span", {}, text);
          mark.style.left = `${(100 * (value - range[0])) / (range[1] - range[0])}%`;
          return mark;
        }),
    );
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
  return share > 0.03 && share < 0.97;
}

/** The steps: play, a slider, and the name of the one that is shown. */
export class Transport {
  constructor(host) {
    this.host = host;
    const { steps } = host.manifest;
    this.play = html("button", { type: "button", class: "x-play", "aria-label": "Play", onclick: () => host.play(!host.playing) });
    this.slider = html("input", {
      type: "range",
      min: 0,
      max: Math.max(0, steps.length - 1),
      step: 1,
      "aria-label": "step",
      oninput: () => host.change({ step: Number(this.slider.value) }),
    });
    this.name = html("output", { class: "x-step-name" });
    this.element = html("div", { class: "x-transport" }, this.play, this.slider, this.name);
    this.element.hidden = steps.length < 2;
  }

  show(scene) {
    const { manifest, playing } = this.host;
    const step = manifest.steps[scene.step];
    this.slider.value = scene.step;
    this.slider.setAttribute("aria-valuetext", step.name);
    const load = manifest.load?.steps[scene.step];
    this.name.textContent = [
      step.name,
      ...(load === null || load === undefined ? [] : [`${brief(load)} ${manifest.load.unit}`]),
    ].join(" · ");
    this.play.replaceChildren(icon(playing ? "pause" : "play"));
    this.play.setAttribute("aria-label", playing ? "Pause" : "Play");
    this.play.title = playing ? "Pause (space)" : "Play (space)";
  }
}
