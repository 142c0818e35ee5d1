// Two explorers side by side that show the same: quantity, step, camera, zoom, colours, pointer, points and line.

import { spacing } from "./grid.js";
import { decimalsFor, fixed, unitText, withError } from "./numbers.js";
import { Buckets, trianglesAt } from "./pick.js";

const SHARED = ["over", "opacity", "tool", "line", "reasons", "directions", "rig"];

/** Which points of two explorers are the same material: by their places at the first step, where both know them. */
class Matching {
  static async of(ends) {
    const first = await Promise.all(ends.map((one) => one.fields.firstPlaces()));
    return new Matching(ends, first);
  }

  constructor(ends, first) {
    Object.assign(this, { ends, first });
    this.isMaterial = first.every(Boolean) && ends.every((one) => one.manifest.follows);
    this.isSame = this.isMaterial && isSameGrid(ends, first);
    this.buckets = new Map();
  }

  _bucketsOf(end) {
    const k = this.ends.indexOf(end);
    if (!this.buckets.has(end)) {
      const [rows, cols] = end.manifest.first.shape;
      const apart = spacing(this.first[k], rows, cols);
      this.buckets.set(end, { apart, rows, cols, found: new Buckets(this.first[k], apart) });
    }
    return this.buckets.get(end);
  }

  /** Number of the point of another explorer that is nearest to a point; −1 if none is near. */
  index(from, to, k) {
    if (this.isSame) return k;
    if (!this.isMaterial) return this._isFlat(from, to) ? to.frame.nearest(...from.frame.point(k).place) : -1;
    const [x, y] = from.frame.firstOf(k);
    const { apart, found } = this._bucketsOf(to);
    return found.nearest(x, y, 1.5 * apart);
  }

  _isFlat(from, to) {
    return from.frame.isFlat && to.frame.isFlat;
  }

  /** Value and error of another explorer at a point, by the triangle there if its points are other ones. */
  reading(from, to, k) {
    if (this.isSame) return to.frame.point(k);
    const weighted = this._weighted(from, to, k);
    if (!weighted) return { value: NaN, error: NaN };
    const { points, weights } = weighted;
    const mean = (part) => points.reduce((sum, one, j) => sum + weights[j] * to.frame.point(one)[part], 0);
    return { value: mean("value"), error: mean("error") };
  }

  _weighted(from, to, k) {
    const { frame } = to;
    if (this.isMaterial) {
      const { apart, rows, cols, found } = this._bucketsOf(to);
      return trianglesAt(found, rows, cols, frame.known, ...from.frame.firstOf(k), 1.5 * apart);
    }
    if (!this._isFlat(from, to)) return null;
    const [x, y] = from.frame.point(k).place;
    return trianglesAt(frame.buckets, frame.rows, frame.cols, frame.known, x, y, 1.5 * frame.spacing);
  }

  /** How the two values belong together, in words. */
  get words() {
    if (this.isSame) return "the same point";
    return this.isMaterial ? "the same material, interpolated" : "the same place in the photograph, interpolated";
  }
}

// Places are rounded by half a quantum in each of both.
function isSameGrid(ends, [one, other]) {
  const shapes = ends.map((end) => end.manifest.first.shape.join());
  if (shapes[0] !== shapes[1]) return false;
  const quanta = [0, 1].map((part) => ends.reduce((sum, end) => sum + end.manifest.places.left[part][1], 0));
  for (let k = 0; k < one.length; k++) {
    if (k % 3 < 2 && Math.abs(one[k] - other[k]) > quanta[k % 3]) return false;
  }
  return true;
}

/** Two explorers that follow one another. shares : whether colours and their ends are those of both */
export class Link {
  /** names : of the two, in words; isChange : the second minus the first, else the first minus the second */
  constructor(one, other, { names = ["A", "B"], isChange = false, shares = true } = {}) {
    Object.assign(this, { ends: [one, other], names, isChange, shares, isFollowing: false, lacks: new Map() });
    this.ended = new AbortController();
  }

  /** Begin; resolves when the second shows what the first does. */
  async start() {
    const [one, other] = this.ends;
    this.matching = await Matching.of(this.ends);
    if (this.shares) {
      joinLegends(one.manifest, other.manifest, this.names);
      one.setRange(one.ranges.get(one.quantity.name) ?? null);
      one.companion = { explorer: other, names: this.names };
      for (const end of this.ends) end.further = (k) => this._further(end, k);
    }
    this._listen(one, other);
    this._listen(other, one);
    await one.ready;
    await this._follow(() => this._scene(one, other));
  }

  // The one under the pointer says the difference.
  _further(end, k) {
    const found = end === this.led ? null : this.difference(end, k);
    return found ? [found.text] : [];
  }

  /** Let them be. */
  end() {
    this.ended.abort();
    for (const end of this.ends) [end.companion, end.further] = [null, () => []];
  }

  _listen(from, to) {
    const { signal } = this.ended;
    const on = (event, act) =>
      from.element.addEventListener(event, (found) => this._follow(() => act.call(this, from, to, found)), { signal });
    on("explorer-scene", this._scene);
    on("explorer-range", this._range);
    on("explorer-chosen", this._chosen);
    on("explorer-moved", this._view);
    on("explorer-hover", this._hover);
  }

  // What one does in answer to the other is no reason for the other to follow.
  _follow(act) {
    if (this.isFollowing) return null;
    this.isFollowing = true;
    try {
      return act();
    } finally {
      this.isFollowing = false;
    }
  }

  /** Quantity, step, camera and what is drawn; what one lacks stays as it is, and is said in `lacks`. */
  async _scene(from, to) {
    const { changes, lacks } = this._wanted(from, to);
    this.lacks.set(to, lacks).set(from, "");
    const drawn = to.change(changes);
    await Promise.all([from.ready, drawn]);
    if (this.ended.signal.aborted) return;
    this._follow(() => {
      this._range(from, to);
      this._view(from, to);
      if (from.points.length !== to.points.length) this._chosen(from, to);
    });
    if (this.shares) this.ends[0].side.showCharts();
  }

  _wanted(from, to) {
    const [quantity, step] = [quantityIn(to, from), stepIn(to, from)];
    const { camera, colours } = from.scene;
    const changes = Object.fromEntries(SHARED.map((name) => [name, from.scene[name]]));
    const lacks = [];
    if (quantity >= 0) changes.quantity = quantity;
    else lacks.push(`has no ${from.quantity.symbol}`);
    if (step >= 0) changes.step = step;
    else lacks.push(`has no step ${from.manifest.steps[from.scene.step].name}`);
    if (camera in to.cameras) changes.camera = camera;
    if (this.shares && quantity >= 0) changes.colours = colours;
    if (!to.manifest.first) changes.over = "step";
    if (!to.manifest.directions) changes.directions = false;
    return { changes, lacks: lacks.join(", ") };
  }

  _range(from, to) {
    const { name } = from.quantity;
    if (this.shares && name === to.quantity.name) to.setRange(from.ranges.get(name) ?? null);
  }

  _view(from, to) {
    if (from.scene.camera === to.scene.camera) to.stage.view = from.stage.view;
  }

  /** The same points by their material, and the line. */
  _chosen(from, to) {
    if (!from.frame || !to.frame) return;
    const points = from.points
      .map(({ index, colour }) => ({ index: this.matching.index(from, to, index), colour }))
      .filter(({ index }) => index >= 0);
    if (from.scene.camera === to.scene.camera && from.scene.line) to.line(from.scene.line);
    to.choose(points);
  }

  _hover(from, to, { detail }) {
    const k = detail.index < 0 || !from.frame || !to.frame ? -1 : this.matching.index(from, to, detail.index);
    this.led = to;
    to.stage.hover(k);
    this.led = null;
  }

  // What both read at a point of one, in their order; null where one of them shows something else.
  _readings(from, k) {
    const to = this.ends.find((one) => one !== from);
    if (!this.matching || !from.frame || !to.frame || this.ends.some((one) => this.lacks.get(one))) return null;
    const readings = [from.frame.point(k), this.matching.reading(from, to, k)];
    return from === this.ends[0] ? readings : readings.reverse();
  }

  /** The difference at a point of one: { value, text }, with no more digits than are certain; null where it is unknown. */
  difference(from, k) {
    const readings = this.shares ? this._readings(from, k) : null;
    if (!readings) return null;
    const [subtrahend, minuend] = this.isChange ? [0, 1] : [1, 0];
    const value = readings[minuend].value - readings[subtrahend].value;
    if (!Number.isFinite(value)) return null;
    const rounding = this.ends.reduce((sum, { quantity }) => sum + quantity.scale[1] / 2, 0);
    const errors = readings.map(({ error }) => error).filter((error) => error > 0);
    const byError = errors.length ? decimalsFor(Math.min(...errors)) : Infinity;
    const decimals = Math.min(byError, decimalsFor(10 * rounding));
    const names = `${this.names[minuend]} − ${this.names[subtrahend]}`;
    return { value, text: `${names} ${fixed(value, decimals)}${unitText(from.quantity.unit)}` };
  }

  /** What both read at a point of one, and the difference, as a sentence; empty where one reads nothing. */
  sentence(from, k) {
    const readings = this._readings(from, k);
    if (!readings || !readings.every(({ value }) => Number.isFinite(value))) return "";
    const both = readings.map(({ value, error }, j) => {
      const { unit, scale } = this.ends[j].quantity;
      return `${this.names[j]} ${withError(value, error, unit, scale[1])}`;
    });
    const difference = this.difference(from, k);
    const rest = difference ? `; ${difference.text} (${this.matching.words})` : "";
    return `${this.ends[0].quantity.symbol}: ${both.join(", ")}${rest}`;
  }
}

// The colours of equal quantities run over the values of both, and are those of the first; their title is that of both.
function joinLegends(manifest, other, names) {
  for (const one of manifest.quantities) {
    const same = other.quantities.find(({ name, unit }) => name === one.name && unit === one.unit);
    if (!same) continue;
    one.range = [Math.min(one.range[0], same.range[0]), Math.max(one.range[1], same.range[1])];
    one.title = joinTitles([one.title, same.title], names);
    [same.range, same.colours, same.title] = [one.range, one.colours, one.title];
    other.palettes[one.colours] = manifest.palettes[one.colours];
  }
}

// What both titles say, then what each says besides, with its name.
function joinTitles(titles, names) {
  if (titles[0] === titles[1]) return titles[0];
  const parts = titles.map((title) => title.split(", "));
  const isShared = (part, k) => parts[1].slice(0, k + 1).join() === parts[0].slice(0, k + 1).join();
  const shared = parts[0].filter(isShared);
  const own = parts.map((all, k) => [all.slice(shared.length).join(", "), names[k]]);
  return [...shared, ...own.filter(([text]) => text).map(([text, name]) => `${text} (${name})`)].join(", ");
}

function quantityIn(to, from) {
  const { name, unit } = from.quantity;
  return to.manifest.quantities.findIndex((one) => one.name === name && one.unit === unit);
}

// By name; by number where no step of one has the name of a step of the other.
function stepIn(to, from) {
  const { name, number } = from.manifest.steps[from.scene.step];
  const names = new Set(from.manifest.steps.map((one) => one.name));
  const isNamed = to.manifest.steps.some((one) => names.has(one.name));
  return to.manifest.steps.findIndex((one) => (isNamed ? one.name === name : one.number === number));
}
