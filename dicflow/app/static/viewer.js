// A photograph that pans and zooms: tiles of the level that suits the zoom, and marks in SVG above them.
// Places are in px of the photograph, the middle of its first pixel at (0, 0).

import { h, s } from "./dom.js";

const MOST_TILES = 400;
const LARGEST_SCALE = 40;

export class Viewer {
  /** onchange : called after each change of the view, and draws the marks into `marks` */
  constructor(onchange) {
    this.canvas = h("canvas", { "aria-hidden": "true" });
    this.marks = s("svg", { class: "marks", "aria-hidden": "true" });
    this.element = h("div", {
      className: "viewer", tabIndex: 0, role: "application",
      "aria-label": "Photograph. Plus and minus zoom, 0 shows all of it, arrows move.",
    }, this.canvas, this.marks);
    this.element.viewer = this;
    this.onchange = onchange;
    this.photograph = null;
    [this.scale, this.x, this.y] = [1, 0, 0];
    this.tiles = new Map();
    this.frame = 0;
    this.observer = new ResizeObserver(() => this.resized());
    this.observer.observe(this.element);
    this.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.pinched = new Map();
  }

  leave() {
    this.observer.disconnect();
    cancelAnimationFrame(this.frame);
  }

  /** Show a photograph: key, width, height, levels, tile. */
  open(photograph) {
    const isFirst = !this.photograph || this.photograph.width !== photograph.width || this.photograph.height !== photograph.height;
    this.photograph = photograph;
    this.tiles.clear();
    if (isFirst) this.fit();
    this.draw();
  }

  get size() {
    return [this.element.clientWidth, this.element.clientHeight];
  }

  resized() {
    const ratio = devicePixelRatio || 1;
    const [width, height] = this.size;
    const before = this.canvas.width;
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    if (before <= 300 || this.isWhole) this.fit();
    this.draw();
  }

  /** The whole photograph. */
  fit() {
    if (!this.photograph) return;
    const [width, height] = this.size;
    this.scale = Math.max(1e-3, Math.min((width - 24) / this.photograph.width, (height - 24) / this.photograph.height));
    this.x = (width / this.scale - this.photograph.width) / -2 - 0.5;
    this.y = (height / this.scale - this.photograph.height) / -2 - 0.5;
    this.isWhole = true;
    this.draw();
  }

  toScreen([x, y]) {
    return [(x - this.x) * this.scale, (y - this.y) * this.scale];
  }

  toPhotograph([x, y]) {
    return [x / this.scale + this.x, y / this.scale + this.y];
  }

  /** The place in the viewer of a pointer's event. */
  at(event) {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  panBy(dx, dy) {
    this.x -= dx / this.scale;
    this.y -= dy / this.scale;
    this.isWhole = false;
    this.draw();
  }

  zoomAt(place, factor) {
    const [width, height] = this.size;
    const at = place ?? [width / 2, height / 2];
    const fixed = this.toPhotograph(at);
    this.scale = Math.min(LARGEST_SCALE, Math.max(0.01, this.scale * factor));
    this.x = fixed[0] - at[0] / this.scale;
    this.y = fixed[1] - at[1] / this.scale;
    this.isWhole = false;
    this.draw();
  }

  /** Bring a place into view. */
  reveal(place) {
    const [width, height] = this.size;
    const [x, y] = this.toScreen(place);
    if (x < 20 || y < 20 || x > width - 20 || y > height - 20) this.panBy(width / 2 - x, height / 2 - y);
  }

  wheel(event) {
    event.preventDefault();
    this.zoomAt(this.at(event), Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
  }

  /** Two fingers: move and zoom. Returns whether there are two. */
  pinch(event, isDown) {
    if (event.pointerType !== "touch") return false;
    const before = [...this.pinched.values()];
    if (isDown === false) this.pinched.delete(event.pointerId);
    else if (isDown || this.pinched.has(event.pointerId)) this.pinched.set(event.pointerId, this.at(event));
    const after = [...this.pinched.values()];
    if (before.length === 2 && after.length === 2) {
      const gap = (pair) => Math.hypot(pair[0][0] - pair[1][0], pair[0][1] - pair[1][1]);
      const middle = (pair) => [(pair[0][0] + pair[1][0]) / 2, (pair[0][1] + pair[1][1]) / 2];
      const [from, to] = [middle(before), middle(after)];
      this.panBy(to[0] - from[0], to[1] - from[1]);
      this.zoomAt(to, gap(after) / Math.max(gap(before), 1));
    }
    return after.length >= 2;
  }

  /** Keys of every viewer. Returns whether the key was one. */
  key(event) {
    const step = 60;
    const acts = {
      "+": () => this.zoomAt(null, 1.4), "=": () => this.zoomAt(null, 1.4), "-": () => this.zoomAt(null, 1 / 1.4), "0": () => this.fit(),
      ArrowLeft: () => this.panBy(step, 0), ArrowRight: () => this.panBy(-step, 0), ArrowUp: () => this.panBy(0, step), ArrowDown: () => this.panBy(0, -step),
    };
    if (event.ctrlKey || event.metaKey || !acts[event.key]) return false;
    event.preventDefault();
    acts[event.key]();
    return true;
  }

  /** Draw in the next frame. */
  draw() {
    if (!this.frame) this.frame = requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    this.frame = 0;
    const context = this.canvas.getContext("2d");
    const ratio = devicePixelRatio || 1;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (this.photograph) {
      const { levels } = this.photograph;
      const wanted = Math.min(levels - 1, Math.max(0, Math.floor(Math.log2(1 / (this.scale * ratio)) + 0.3)));
      context.setTransform(ratio * this.scale, 0, 0, ratio * this.scale, -ratio * this.scale * (this.x + 0.5), -ratio * this.scale * (this.y + 0.5));
      context.imageSmoothingEnabled = this.scale < 3;
      this.drawLevel(context, levels - 1);
      if (wanted < levels - 1) this.drawLevel(context, wanted);
    }
    this.onchange?.();
  }

  drawLevel(context, level) {
    const { key, width, height, tile } = this.photograph;
    const side = tile * 2 ** level;
    const [w, hgt] = this.size;
    const [x0, y0] = this.toPhotograph([0, 0]);
    const [x1, y1] = this.toPhotograph([w, hgt]);
    const last = [Math.ceil(width / side) - 1, Math.ceil(height / side) - 1];
    for (let row = Math.max(0, Math.floor(y0 / side)); row <= Math.min(last[1], Math.floor(y1 / side)); row++) {
      for (let column = Math.max(0, Math.floor(x0 / side)); column <= Math.min(last[0], Math.floor(x1 / side)); column++) {
        const image = this.tile(`/picture/${key}/${level}/${column}_${row}.jpg`);
        if (!image.complete || !image.naturalWidth) continue;
        const [left, top] = [column * side, row * side];
        context.drawImage(image, left, top, Math.min(side, width - left), Math.min(side, height - top));
      }
    }
  }

  tile(address) {
    let image = this.tiles.get(address);
    if (!image) {
      image = new Image();
      image.onload = () => this.draw();
      image.src = address;
      this.tiles.set(address, image);
      if (this.tiles.size > MOST_TILES) this.tiles.delete(this.tiles.keys().next().value);
    }
    return image;
  }
}
