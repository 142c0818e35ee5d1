// The explorer: a scene, what it shows, and how a person changes it.

import { Legend, Toolbar, Transport } from "./controls.js";
import { Frame } from "./frame.js";
import { brief, fixed, unitText, withError } from "./numbers.js";
import { html, saveFile } from "./page.js";
import { pictureOf } from "./picture.js";
import { Side } from "./side.js";
import { Fields } from "./source.js";
import { Stage } from "./stage.js";

const FRAMES_KEPT = 24;
const PLAY_MS = 140;
const CAMERAS = { left: "Left", right: "Right", space: "Surface" };

/** Puts an explorer into an element and returns it. source : of source.js */
export function mountExplorer(element, source) {
  return new Explorer(element, source);
}

class Explorer {
  constructor(element, source) {
    Object.assign(this, { element, manifest: source.manifest, fields: new Fields(source) });
    const { manifest } = this;
    this.cameras = this._cameras();
    this.scene = {
      quantity: Math.max(
        0,
        manifest.quantities.findIndex((one) => one.name === manifest.main[0]),
      ),
      step: manifest.main[1],
      camera: Object.keys(this.cameras)[0],
      over: "step",
      colours: "",
      opacity: 0.85,
      tool: "point",
      line: null,
      reasons: false,
      directions: false,
      rig: false,
    };
    this.points = [];
    this.ranges = new Map();
    this.frames = new Map();
    this.colourTables = new Map();
    this.frame = null;
    this.companion = null;
    this.playing = 0;
    this.stage = new Stage(this);
    this.toolbar = new Toolbar(this);
    this.legend = new Legend(this);
    this.transport = new Transport(this);
    this.side = new Side(this);
    element.classList.add("explorer");
    const [wide, high] = extentOf(manifest);
    element.classList.toggle("x-tall", high > TALL * wide);
    element.style.setProperty("--x-aspect", wide / high || 1);
    element.explorer = this;
    element.replaceChildren(
      html(
        "div",
        { class: "x-main" },
        this.toolbar.element,
        this.stage.element,
        this.transport.element,
        this.legend.element,
      ),
      this.side.element,
    );
    element.addEventListener("keydown", (event) => this._key(event));
    this.ready = this._refresh();
  }

  /** The ways to see the points that this result has. */
  _cameras() {
    const has = (camera) => this.manifest.steps.some((step) => step.blobs[`place/${camera}`]);
    const found = Object.fromEntries(Object.entries(CAMERAS).filter(([camera]) => has(camera)));
    return Object.keys(found).length ? found : { left: CAMERAS.left };
  }

  get quantity() {
    return this.manifest.quantities[this.scene.quantity];
  }

  /** Values at both ends of the colours. */
  get range() {
    return this.ranges.get(this.quantity.name) || this.quantity.range;
  }

  /** 256 colours as bytes. */
  get palette() {
    return this._colours(this.scene.colours || this.quantity.colours);
  }

  _colours(name) {
    if (!this.colourTables.has(name)) {
      this.colourTables.set(
        name,
        Uint8Array.from(this.manifest.palettes[name].match(/../g), (pair) => parseInt(pair, 16)),
      );
    }
    return this.colourTables.get(name);
  }

  /** Colours of the status codes. */
  get reasonPalette() {
    if (!this.colourTables.has("")) {
      const colours = new Uint8Array(768);
      for (const { code, colour } of this.manifest.reasons) {
        (colour || "#000000")
          .slice(1)
          .match(/../g)
          .forEach((pair, part) => {
            colours[3 * code + part] = parseInt(pair, 16);
          });
      }
      this.colourTables.set("", colours);
    }
    return this.colourTables.get("");
  }

  /** Address of the photograph below the field; empty without one. */
  get photograph() {
    const { scene, manifest } = this;
    const first = scene.over === "first" && scene.camera === "left";
    const name = (first ? manifest.first.photos : manifest.steps[scene.step].photos)[scene.camera];
    return name ? this.fields.source.picture(name) : "";
  }

  /** Chosen points, as the picture marks them. */
  get marks() {
    return this.points;
  }

  /** Changes the scene; resolves when it is drawn. */
  change(changes) {
    if ("quantity" in changes && changes.quantity !== this.scene.quantity) this.scene.colours = "";
    if ("camera" in changes && changes.camera !== this.scene.camera) this.scene.line = null;
    if (changes.tool === "line" && !this.scene.line) this.scene.line = this._middleLine();
    Object.assign(this.scene, changes);
    this.ready = this._refresh();
    this._say("explorer-scene");
    return this.ready;
  }

  _say(event, detail = {}) {
    this.element.dispatchEvent(new CustomEvent(event, { bubbles: true, detail }));
  }

  // Across the middle of the points, so that a line can be had without a pointer.
  _middleLine() {
    const box = this.frame?.box;
    if (!box || !this.frame.isFlat) return null;
    const [x0, x1] = [0.2, 0.8].map((share) => box.low[0] + share * (box.high[0] - box.low[0]));
    const y = (box.low[1] + box.high[1]) / 2;
    return [
      [x0, y],
      [x1, y],
    ];
  }

  /** Sets the values at both ends of the colours; null for those of all steps. */
  setRange(range) {
    if (range) this.ranges.set(this.quantity.name, range);
    else this.ranges.delete(this.quantity.name);
    this.redraw();
    this.legend.show();
    this._say("explorer-range");
  }

  /** Draws all pictures again. */
  redraw() {
    this.stage.draw();
    this.side.surface?.stage.draw();
  }

  async _frame(scene) {
    const key = [scene.quantity, scene.step, scene.camera, scene.over, scene.directions].join();
    const found = this.frames.get(key) || Frame.load(this.fields, scene);
    this.frames.delete(key);
    this.frames.set(key, found);
    if (this.frames.size > FRAMES_KEPT) this.frames.delete(this.frames.keys().next().value);
    return found;
  }

  async _refresh() {
    const asked = (this.asked = (this.asked || 0) + 1);
    const frame = await this._frame(this.scene);
    if (asked !== this.asked) return;
    this.frame = frame;
    this.stage.hover(-1);
    this.stage.draw();
    this.stage.element.setAttribute(
      "aria-label",
      `${this.quantity.title} at ${this.manifest.steps[this.scene.step].name}`,
    );
    this.toolbar.show(this.scene);
    this.transport.show(this.scene);
    this.legend.show();
    this.firstDrawn ??= performance.now();
    await this.side.show();
    this._say("explorer-change", { ...this.scene });
  }

  /** Chooses a point of the frame, so that its curve is shown; a chosen one is dropped. */
  pick(k) {
    const chosen = this.points.find((one) => one.index === k);
    if (chosen) return this.drop(chosen);
    this.points = [...this.points.slice(-5), { ...this.frame.point(k), colour: this.side.nextColour() }];
    return this._chosen();
  }

  /** Drops a chosen point. */
  drop(point) {
    this.points = this.points.filter((one) => one !== point);
    return this._chosen();
  }

  /** Chooses other points. points : { index, colour } of each */
  choose(points) {
    this.points = this.frame ? points.map(({ index, colour }) => ({ ...this.frame.point(index), colour })) : [];
    return this._chosen();
  }

  // Other points are chosen.
  _chosen() {
    this.redraw();
    this._say("explorer-chosen");
    return this.side.showCurve();
  }

  /** Draws a line, and its profile. ends : two places of the photograph [px] */
  line(ends) {
    this.scene.line = ends;
    this.stage.mark();
    this.side.showProfile();
    this._say("explorer-chosen");
  }

  /** The elements that say what is known of a point. */
  reading(k) {
    return [...this.readingOf(this.frame, k), ...this.further(k).map((text) => html("span", {}, text))];
  }

  /** Sentences that stand below what is known of a point; a link to another explorer gives them. */
  further() {
    return [];
  }

  /** The same of another frame. */
  readingOf(frame, k) {
    const { quantity, manifest } = this;
    const one = frame.point(k);
    const reason = manifest.reasons.find(({ code }) => code === one.status);
    const lines = [];
    if (Number.isFinite(one.value)) {
      lines.push(
        html("strong", {}, `${quantity.symbol} ${withError(one.value, one.error, quantity.unit, quantity.scale[1])}`),
      );
      const parts = [
        ["noise σ", quantity.errors.u ? one.sigma : NaN],
        ["bias", one.bias],
        ["calibration", one.share],
      ].filter(([, size]) => Number.isFinite(size));
      const sizes = parts.map(([name, size]) => `${name} ± ${brief(size, 2)}${unitText(quantity.unit)}`);
      if (sizes.length) lines.push(html("span", {}, sizes.join(" · ")));
      if (one.status > 0) lines.push(html("span", {}, reason.sentence));
    } else
      lines.push(
        html("strong", {}, `no value: ${reason.code ? reason.label : "not measured"}`),
        ...(reason.code ? [html("span", {}, reason.sentence)] : []),
      );
    const [x, y] = one.place;
    const where = [
      `point ${one.row}, ${one.col}`,
      ...(frame.isFlat && x === x ? [`x ${fixed(x, 1)}, y ${fixed(y, 1)} px`] : []),
    ];
    lines.push(html("span", { class: "x-where" }, where.join(" · ")));
    if (one.space && one.space.every(Number.isFinite)) {
      lines.push(
        html(
          "span",
          { class: "x-where" },
          `X ${fixed(one.space[0], 2)}, Y ${fixed(one.space[1], 2)}, Z ${fixed(one.space[2], 2)} ${manifest.unit}`,
        ),
      );
    }
    return lines;
  }

  /** What the pointer rests on; −1 for nothing. */
  hovered(k) {
    this.legend.point(k < 0 || !this.frame ? NaN : this.frame.point(k).value);
    this._say("explorer-hover", { index: k });
  }

  /** The picture was zoomed, moved or turned by a person. */
  moved() {
    this._say("explorer-moved");
  }

  /** Plays the steps, from the first again after the last, or stops. */
  play(on) {
    clearTimeout(this.playing);
    this.playing = 0;
    if (on && this.manifest.steps.length > 1) this._next();
    this.transport.show(this.scene);
  }

  _next() {
    const started = performance.now();
    this.playing = setTimeout(
      async () => {
        const drawn = this.change({ step: (this.scene.step + 1) % this.manifest.steps.length });
        await Promise.all([drawn, this.companion?.explorer.ready]);
        if (this.playing) this._next();
      },
      Math.max(0, PLAY_MS - (performance.now() - started)),
    );
  }

  _key(event) {
    if (event.target.matches("input[type=text], select, textarea") || event.ctrlKey || event.metaKey || event.altKey)
      return;
    if (event.key === " " && event.target.matches("button:not(.x-play)")) return;
    const last = this.manifest.steps.length - 1;
    const move = (steps) => this.change({ step: Math.max(0, Math.min(last, this.scene.step + steps)) });
    const actions = {
      ArrowLeft: () => move(-1),
      ArrowRight: () => move(1),
      Home: () => move(-last),
      End: () => move(last),
      " ": () => this.play(!this.playing),
      Escape: () => this._cancel(),
      "+": () => this.stage.zoom(1.25),
      "=": () => this.stage.zoom(1.25),
      "-": () => this.stage.zoom(0.8),
      0: () => this.stage.reset(),
      Enter: () => this.stage.hovered >= 0 && this.pick(this.stage.hovered),
    };
    const shifted = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    const onStage = event.target === this.stage.element;
    if (event.key === "Enter" && !onStage) return;
    if (event.target.matches("input[type=range]") && /^(Arrow|Home|End)/.test(event.key)) return;
    const action = event.shiftKey && shifted && onStage ? () => this._step(...shifted) : actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  /** Moves the reading to a neighbour of the grid. */
  _step(rows, cols) {
    const { frame, stage } = this;
    if (!frame) return;
    const now =
      stage.hovered >= 0 ? stage.hovered : Math.floor(frame.rows / 2) * frame.cols + Math.floor(frame.cols / 2);
    const [row, col] = [Math.floor(now / frame.cols) + rows, (now % frame.cols) + cols];
    if (row >= 0 && row < frame.rows && col >= 0 && col < frame.cols) stage.hover(row * frame.cols + col);
  }

  _cancel() {
    this.play(false);
    this.choose([]);
    this.change({ line: null });
  }

  /** Fills the screen, or ends it. */
  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else this.element.requestFullscreen();
  }

  /** Saves the picture with its colours and numbers. */
  savePicture() {
    const name = `${this.quantity.name}_${this.manifest.steps[this.scene.step].name}.png`;
    pictureOf(this).toBlob((blob) => saveFile(name, blob));
  }
}

const TALL = 1.5;

// Width and height of what is shown in the left photograph, to scale.
function extentOf({ crops, places }) {
  return crops.left
    ? crops.left.size
    : (
        places.left || [
          [0, 1],
          [0, 1],
        ]
      ).map(([, quantum]) => quantum);
}
