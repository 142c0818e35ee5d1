// The large picture: photograph, field, marks above them, and what pointer and fingers do there.

import { Turntable, Window2D, projected, projectedAll } from "./camera.js";
import { directionMarks } from "./directions.js";
import { painterFor } from "./mesh.js";
import { html, svg } from "./page.js";
import { Buckets } from "./pick.js";
import { frustums, lineMarks, probeMarks, scaleBar, triad } from "./marks.js";

const CLICK_PX = 4;
const MOST_PIXELS = 2;
/** Width and height that the picture may have on paper [px of 1/96 inch]: 17.5 × 12 cm. */
const PAPER = [660, 454];

/** The picture of an explorer. host : gives scene, frame, palette, marks; and is called hover, pick, draw a line */
export class Stage {
  constructor(host) {
    this.host = host;
    this.window = new Window2D();
    this.turntable = new Turntable();
    this.photo = html("img", { class: "x-photo", alt: "", draggable: false });
    this.canvas = html("canvas", { class: "x-canvas" });
    this.overlay = svg("svg", { class: "x-overlay", "aria-hidden": "true" });
    this.tip = html("div", { class: "x-tip", role: "status", hidden: true });
    this.notice = html("p", { class: "x-notice", hidden: true });
    this.element = html(
      "div",
      { class: "x-stage", tabIndex: 0, role: "application", "aria-label": "field" },
      this.photo,
      this.canvas,
      this.overlay,
      this.notice,
      this.tip,
    );
    this.painter = painterFor(this.canvas);
    this.pointers = new Map();
    this.fitted = "";
    this._listen();
    new ResizeObserver(() => this.reset()).observe(this.element);
    addEventListener("beforeprint", () => this._fitPaper());
  }

  get size() {
    return [this.element.clientWidth, this.element.clientHeight];
  }

  get isFlat() {
    return this.host.scene.camera !== "space";
  }

  // Gives the canvas the pixels of the screen below it, and tells whether there are any.
  _sized() {
    const [width, height] = this.size;
    if (!width || !height) return false;
    const ratio = Math.min(MOST_PIXELS, globalThis.devicePixelRatio || 1);
    const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== wide || this.canvas.height !== high)
      [this.canvas.width, this.canvas.height] = [wide, high];
    this.overlay.setAttribute("viewBox", `0 0 ${width} ${height}`);
    return true;
  }

  /** On paper the picture keeps its pixels and is scaled as a whole, since nothing is drawn once a page is laid out. */
  _fitPaper() {
    const [width, height] = this.size;
    if (!width || !height) return;
    const { style } = this.element;
    style.setProperty("--paper-width", `${width}px`);
    style.setProperty("--paper-height", `${height}px`);
    style.setProperty("--paper-zoom", Math.min(PAPER[0] / width, PAPER[1] / height));
  }

  /** Shows everything again in the middle. */
  reset() {
    this.fitted = "";
    this.draw();
    this.host.moved();
  }

  /** The part that is shown, for another picture: of a plane its middle and scale [CSS px per px], else how it is turned. */
  get view() {
    if (!this.isFlat) return { turn: { ...this.turntable } };
    const [width, height] = this.size;
    return { middle: this.window.toPlace(width / 2, height / 2), scale: this.window.scale };
  }

  set view({ turn, middle, scale }) {
    const [width, height] = this.size;
    this._fit();
    if (turn && !this.isFlat) Object.assign(this.turntable, turn);
    if (middle && this.isFlat)
      Object.assign(this.window, { scale, x: width / 2 - scale * middle[0], y: height / 2 - scale * middle[1] });
    this.draw();
  }

  _fit() {
    const { frame, scene } = this.host;
    const key = `${scene.camera} ${this.size} ${scene.rig}`;
    if (this.fitted === key || !frame) return;
    const crop = this.host.manifest.crops[scene.camera];
    const box = frame.box;
    if (!this.isFlat && box)
      this.turntable.fit(
        box.low,
        box.high,
        scene.rig ? this.host.manifest.cameras.map((one) => one.centre) : [],
        ...this.size,
      );
    else if (crop)
      this.window.fit([...crop.origin, crop.origin[0] + crop.size[0], crop.origin[1] + crop.size[1]], ...this.size);
    else if (box) this.window.fit([box.low[0], box.low[1], box.high[0], box.high[1]], ...this.size);
    this.fitted = key;
  }

  get matrix() {
    return (this.isFlat ? this.window : this.turntable).matrix(...this.size);
  }

  /** Draws the frame of the host. */
  draw() {
    const { frame, scene } = this.host;
    if (!this._sized()) return;
    this._fit();
    this._place();
    this.painter.clear();
    this.notice.hidden = Boolean(frame && frame.indices.length);
    this.notice.textContent = frame ? "No point has a value here." : "This step was not measured.";
    if (frame) {
      const matrix = this.matrix;
      const codes = this.host.range.map((value) => (value - frame.quantity.scale[0]) / frame.quantity.scale[1] + 1);
      const palette = this.host.palette;
      const showsReasons = scene.reasons && scene.camera === "left"; // lost points have no place elsewhere
      const faded = showsReasons ? 0.25 : 1;
      this.painter.draw({
        positions: frame.places,
        values: frame.codes,
        indices: frame.indices,
        matrix,
        range: codes,
        palette,
        opacity: this.isFlat ? scene.opacity * faded : 1,
        shaded: !this.isFlat,
      });
      if (showsReasons) {
        this.painter.draw({
          ...frame.lost,
          matrix,
          range: [0, 255],
          palette: this.host.reasonPalette,
          opacity: 0.9,
          shaded: false,
        });
      }
    }
    this.mark();
  }

  _place() {
    const { scene, manifest } = this.host;
    const crop = manifest.crops[scene.camera];
    const address = this.isFlat ? this.host.photograph : "";
    this.photo.hidden = !address || !crop;
    if (this.photo.hidden) return;
    if (this.photo.src !== address) this.photo.src = address;
    const [x, y] = this.window.toPicture(crop.origin[0] - 0.5, crop.origin[1] - 0.5);
    Object.assign(this.photo.style, {
      transform: `translate(${x}px, ${y}px)`,
      width: `${crop.size[0] * this.window.scale}px`,
      height: `${crop.size[1] * this.window.scale}px`,
    });
  }

  /** Where a point of the frame lies in the picture; null if unknown. */
  shownAt(k) {
    const { frame } = this.host;
    const places = this.isFlat ? frame.estimates : frame.places;
    const [x, y, z] = [places[3 * k], places[3 * k + 1], places[3 * k + 2]];
    if (x !== x) return null;
    return this.isFlat ? this.window.toPicture(x, y) : projected(this.matrix, x, y, z, ...this.size);
  }

  /** Number of the point under a place of the picture; −1 if none is. */
  pointAt(px, py) {
    const { frame } = this.host;
    if (!frame) return -1;
    if (this.isFlat) return frame.nearest(...this.window.toPlace(px, py));
    const key = [...this.matrix].join();
    if (this.shown?.key !== key || this.shown.frame !== frame) {
      const places = projectedAll(this.matrix, frame.places, ...this.size);
      this.shown = { key, frame, buckets: new Buckets(places, 6, 2) };
    }
    return this.shown.buckets.nearest(px, py, 14);
  }

  /** Draws what lies above the field: chosen points, the line, cameras and axes. */
  mark() {
    const parts = [];
    const { frame, scene } = this.host;
    if (frame) {
      if (!this.isFlat)
        parts.push(
          ...(scene.rig ? frustums(this.host.manifest.cameras, frame.box, this.matrix, this.size) : []),
          ...triad(this.turntable, this.size),
        );
      else if (scene.directions && scene.camera === "left")
        parts.push(...directionMarks(frame, scene, this.host.manifest.directions === "material", this.window));
      if (this.isFlat) parts.push(...probeMarks(this.host.manifest.probes, frame, this.window));
      if (this.isFlat) parts.push(...scaleBar(frame, this.window, this.size, this.host.manifest.unit));
      if (scene.line && this.isFlat) parts.push(...lineMarks(scene.line.map((end) => this.window.toPicture(...end))));
      for (const { index, colour } of this.host.marks) {
        const at = this.shownAt(index);
        if (at) parts.push(svg("circle", { cx: at[0], cy: at[1], r: 6, class: "x-point", fill: colour }));
      }
      if (this.hovered >= 0) {
        const at = this.shownAt(this.hovered);
        if (at) parts.push(svg("circle", { cx: at[0], cy: at[1], r: 5, class: "x-hovered" }));
      }
    }
    this.overlay.replaceChildren(...parts);
  }

  /** Shows the reading of a point beside it; −1 hides it. */
  hover(k) {
    this.hovered = k;
    this.tip.hidden = k < 0;
    const at = k < 0 ? null : this.shownAt(k);
    if (at) {
      this.tip.replaceChildren(...this.host.reading(k));
      const [width, height] = this.size;
      const [wide, high] = [this.tip.offsetWidth, this.tip.offsetHeight];
      const left = at[0] + 16 + wide > width ? at[0] - 16 - wide : at[0] + 16;
      this.tip.style.left = `${Math.max(4, Math.min(width - wide - 4, left))}px`;
      this.tip.style.top = `${Math.max(4, Math.min(height - high - 4, at[1] - high / 2))}px`;
    }
    this.mark();
    this.host.hovered(k);
  }

  _at(event) {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  _listen() {
    const { element } = this;
    element.addEventListener("pointerdown", (event) => this._down(event));
    element.addEventListener("pointermove", (event) => this._move(event));
    for (const kind of ["pointerup", "pointercancel"]) element.addEventListener(kind, (event) => this._up(event));
    element.addEventListener("pointerleave", () => this.pointers.size || this.hover(-1));
    element.addEventListener("dblclick", () => this.reset());
    element.addEventListener("contextmenu", (event) => this.isFlat || event.preventDefault());
    element.addEventListener("wheel", (event) => this._wheel(event), { passive: false });
  }

  _wheel(event) {
    if (
      !event.ctrlKey &&
      !event.metaKey &&
      document.activeElement !== this.element &&
      document.fullscreenElement === null
    )
      return;
    event.preventDefault();
    this.zoom(2 ** (-event.deltaY / (event.ctrlKey ? 100 : 400)), ...this._at(event));
  }

  /** Zooms by a factor about a place of the picture, its middle if none is given. */
  zoom(factor, px = this.size[0] / 2, py = this.size[1] / 2) {
    if (this.isFlat) this.window.zoom(factor, px, py);
    else this.turntable.zoom(factor);
    this.draw();
    this.host.moved();
  }

  _down(event) {
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    const at = this._at(event);
    this.pointers.set(event.pointerId, at);
    this.start = { at, moved: this.pointers.size > 1, other: event.button === 2 || event.shiftKey };
    if (this.host.scene.tool === "line" && this.isFlat) this.drawn = this.window.toPlace(...at);
  }

  _move(event) {
    const [x, y] = this._at(event);
    const before = this.pointers.get(event.pointerId);
    if (!before) {
      this.hover(this.pointAt(x, y));
      return;
    }
    const [dx, dy] = [x - before[0], y - before[1]];
    if (Math.hypot(x - this.start.at[0], y - this.start.at[1]) > CLICK_PX) this.start.moved = true;
    if (!this.start.moved) return;
    if (this.pointers.size === 2) this._pinch(event.pointerId, [x, y]);
    else if (this.drawn) this.host.line([this.drawn, this.window.toPlace(x, y)], false);
    else if (this.isFlat) this.window.pan(dx, dy);
    else if (this.start.other) this.turntable.pan(dx, dy, this.size[1]);
    else this.turntable.turn(dx * 0.008, -dy * 0.008);
    this.pointers.set(event.pointerId, [x, y]);
    this.hover(-1);
    this.draw();
    this.host.moved();
  }

  _pinch(id, after) {
    const [other] = [...this.pointers].filter(([one]) => one !== id).map(([, at]) => at);
    const before = this.pointers.get(id);
    const apart = (one) => Math.hypot(one[0] - other[0], one[1] - other[1]) || 1;
    this.zoom(apart(after) / apart(before), (after[0] + other[0]) / 2, (after[1] + other[1]) / 2);
  }

  _up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    const at = this._at(event);
    if (this.drawn && this.start.moved) this.host.line([this.drawn, this.window.toPlace(...at)], true);
    else if (!this.start.moved && event.type === "pointerup") {
      const k = this.pointAt(...at);
      this.hover(k);
      if (k >= 0) this.host.pick(k);
    }
    this.drawn = null;
  }
}
