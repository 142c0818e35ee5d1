// Drawing over a photograph with mouse, finger or keyboard: changes the paths, and tells when a change is complete.

import { SORTS, freeName, nearestCorner, nearestEdge, rounded } from "./shapes.js";

const NEAR = 10; // of the pointer [px of the screen]
const STILL = 4; // a press that moves less is a click

export class Pen {
  /** viewer : a Viewer; oncommit(words) : after a complete change; onselect() : after another choice */
  constructor(viewer, oncommit, onselect) {
    Object.assign(this, { viewer, oncommit, onselect });
    this.paths = [];
    this.tool = "select";
    this.draft = null; // places of the path that is being drawn
    this.chosen = { path: -1, corner: -1 };
    this.cursor = null; // place of the keyboard's cross
    this.pointer = null;
    this.press = null;
    const element = viewer.element;
    for (const [name, act] of Object.entries({ pointerdown: this.down, pointermove: this.move, pointerup: this.up, pointercancel: this.up, dblclick: this.double, keydown: this.key })) {
      element.addEventListener(name, (event) => act.call(this, event));
    }
  }

  /** Other paths from the files. */
  load(paths) {
    this.paths = paths;
    if (!this.paths[this.chosen.path]?.places[Math.max(0, this.chosen.corner)]) this.chosen = { path: -1, corner: -1 };
    this.viewer.draw();
  }

  choose(path, corner = -1) {
    this.chosen = { path, corner };
    this.onselect();
    this.viewer.draw();
  }

  take(tool) {
    this.tool = tool;
    this.draft = null;
    if (tool !== "select") this.choose(-1);
    this.onselect();
    this.viewer.draw();
  }

  get reach() {
    return NEAR / this.viewer.scale;
  }

  down(event) {
    if (this.viewer.pinch(event, true)) {
      this.press = null;
      return;
    }
    if (event.button > 1) return;
    this.viewer.element.focus({ preventScroll: true });
    this.viewer.element.setPointerCapture(event.pointerId);
    this.cursor = null;
    const at = this.viewer.at(event);
    const place = this.viewer.toPhotograph(at);
    this.press = { at, moved: false, grabbed: null, button: event.button };
    if (this.tool !== "select" || event.button === 1) return;
    const corner = nearestCorner(this.paths, place, this.reach);
    if (corner.corner >= 0) {
      this.press.grabbed = corner;
      const old = this.paths[corner.path].places[corner.corner];
      this.press.offset = [old[0] - place[0], old[1] - place[1]];
      this.choose(corner.path, corner.corner);
    } else {
      this.choose(nearestEdge(this.paths, place, this.reach).path);
    }
  }

  move(event) {
    if (this.viewer.pinch(event)) return;
    const at = this.viewer.at(event);
    this.pointer = this.viewer.toPhotograph(at);
    if (this.press) this.drag(at);
    this.onpoint?.(this.pointer);
    if (this.draft || this.press) this.viewer.draw();
  }

  drag(at) {
    const press = this.press;
    if (!press.moved && Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) < STILL) return;
    if (press.grabbed) {
      const { path, corner } = press.grabbed;
      this.paths[path].places[corner] = this.inFrame([this.pointer[0] + press.offset[0], this.pointer[1] + press.offset[1]]);
      this.onselect();
    } else {
      const from = press.moved ? press.last : press.at;
      this.viewer.panBy(at[0] - from[0], at[1] - from[1]);
    }
    press.moved = true;
    press.last = at;
  }

  up(event) {
    this.viewer.pinch(event, false);
    const press = this.press;
    this.press = null;
    if (!press || event.type === "pointercancel") return;
    if (press.grabbed) {
      if (press.moved) this.oncommit(`corner of ${this.title(press.grabbed.path)}`);
    } else if (!press.moved && this.tool !== "select" && press.button === 0) {
      this.put(this.viewer.toPhotograph(press.at));
    }
  }

  double(event) {
    const place = this.viewer.toPhotograph(this.viewer.at(event));
    if (this.tool !== "select") this.finish();
    else if (nearestCorner(this.paths, place, this.reach).corner < 0) this.insert(nearestEdge(this.paths, place, this.reach), place);
  }

  /** Add a place to the path that is being drawn. */
  put(place) {
    const { closed, least, most } = SORTS[this.tool];
    this.draft ??= [];
    const first = this.draft[0];
    const near = (one) => one && Math.hypot(one[0] - place[0], one[1] - place[1]) < this.reach;
    if (closed && this.draft.length >= least && near(first)) {
      this.finish();
      return;
    }
    if (!near(this.draft[this.draft.length - 1])) this.draft.push(this.inFrame(place));
    if (this.draft.length === most) this.finish();
    this.onselect();
    this.viewer.draw();
  }

  /** End the path that is being drawn, if it has places enough. */
  finish() {
    const sort = this.tool;
    if (!this.draft || this.draft.length < SORTS[sort].least) return;
    const name = SORTS[sort].probe ? freeName(this.paths, sort) : "";
    this.paths.push({ sort, name, places: this.draft });
    this.draft = null;
    this.tool = "select";
    this.choose(this.paths.length - 1);
    this.oncommit(this.title(this.paths.length - 1));
  }

  insert({ path, corner }, place) {
    const chosen = this.paths[path];
    if (!chosen || SORTS[chosen.sort].most) return;
    chosen.places.splice(corner + 1, 0, this.inFrame(place));
    this.choose(path, corner + 1);
    this.oncommit(`corner of ${this.title(path)}`);
  }

  /** Delete the chosen corner, or the whole path where it would keep too few. */
  remove() {
    const { path, corner } = this.chosen;
    const chosen = this.paths[path];
    if (!chosen) return;
    const title = this.title(path);
    if (corner >= 0 && chosen.places.length > SORTS[chosen.sort].least) {
      chosen.places.splice(corner, 1);
      this.choose(path, Math.min(corner, chosen.places.length - 1));
      this.oncommit(`corner of ${title} deleted`);
    } else {
      this.paths.splice(path, 1);
      this.choose(-1);
      this.oncommit(`${title} deleted`);
    }
  }

  title(number) {
    const path = this.paths[number];
    return path.name || SORTS[path.sort].title.toLowerCase();
  }

  inFrame([x, y]) {
    const { width, height } = this.viewer.photograph;
    return [rounded(Math.min(width - 1, Math.max(0, x))), rounded(Math.min(height - 1, Math.max(0, y)))];
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== this.viewer.element) return;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const handled = arrows[event.key] ? this.arrow(arrows[event.key], event.shiftKey) : this.act(event.key);
    if (handled) {
      event.preventDefault();
      this.viewer.draw();
    } else {
      this.viewer.key(event);
    }
  }

  /** Move the chosen corner by 1 px, or while drawing the cross by 10 px; with Shift the other way round. */
  arrow([dx, dy], shift) {
    const { path, corner } = this.chosen;
    if (this.tool !== "select") {
      const step = shift ? 1 : 10;
      this.cursor = this.inFrame(this.moved(this.cursor ?? this.middle(), dx * step, dy * step));
      this.pointer = this.cursor;
      this.viewer.reveal(this.cursor);
      this.onpoint?.(this.cursor);
      return true;
    }
    if (corner < 0) return false;
    const step = shift ? 10 : 1;
    const places = this.paths[path].places;
    places[corner] = this.inFrame(this.moved(places[corner], dx * step, dy * step));
    this.viewer.reveal(places[corner]);
    this.onselect();
    clearTimeout(this.later);
    this.pending = `corner of ${this.title(path)}`;
    this.later = setTimeout(() => this.settle(), 400);
    return true;
  }

  /** Say that corners were moved by keys, if that is not said yet. */
  settle() {
    clearTimeout(this.later);
    if (this.pending) this.oncommit(this.pending);
    this.pending = "";
  }

  moved([x, y], dx, dy) {
    return [x + dx, y + dy];
  }

  middle() {
    const [width, height] = this.viewer.size;
    return this.viewer.toPhotograph([width / 2, height / 2]);
  }

  act(key) {
    if (key === "Escape") return this.escape();
    if (key === "Enter" || key === " ") {
      if (this.tool === "select") return false;
      this.put(this.cursor ?? this.middle());
      return true;
    }
    if (key === "f" && this.draft) this.finish();
    else if (key === "Backspace" || key === "Delete") {
      if (this.draft) this.draft.pop();
      else this.remove();
    } else if (key === "v") this.take("select");
    else if (key === "." || key === ",") this.next(key === "." ? 1 : -1);
    else if (key === "m") this.choose((this.chosen.path + 1) % Math.max(1, this.paths.length), 0);
    else if (key === "i") this.between();
    else {
      const sort = Object.keys(SORTS).find((one) => SORTS[one].key === key);
      if (!sort || this.isBarred?.(sort)) return false;
      this.take(sort);
    }
    return true;
  }

  escape() {
    if (this.draft) this.draft = null;
    else if (this.tool !== "select") this.take("select");
    else this.choose(-1);
    this.onselect();
    return true;
  }

  /** Choose the next corner of the chosen path. */
  next(way) {
    const count = this.paths[this.chosen.path]?.places.length;
    if (!count) return;
    this.choose(this.chosen.path, (this.chosen.corner + way + count) % count);
    this.viewer.reveal(this.paths[this.chosen.path].places[this.chosen.corner]);
  }

  /** A new corner in the middle of the edge behind the chosen one. */
  between() {
    const { path, corner } = this.chosen;
    if (corner < 0) return;
    const places = this.paths[path].places;
    const [a, b] = [places[corner], places[(corner + 1) % places.length]];
    this.insert(this.chosen, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
  }
}
