// What is shown at one step: the numbers of its points, where they lie, and which cells are whole.

import { anglesOf } from "./directions.js";
import { lostCells, spacing, wholeCells, withEstimates } from "./grid.js";
import { Buckets, trianglesAt } from "./pick.js";
import { deviationOf, valueOf } from "./source.js";

const PARTS = ["u", "sigma", "bias", "share"];

/** The part that is shown as ±: the combined standard uncertainty, or σ by noise where no bias is known beside it. */
export function errorPart({ errors }) {
  return errors.u ? "u" : "sigma";
}

function errorOf({ errors }, codes, part, k) {
  return codes[part] ? deviationOf(errors[part], codes[part][k]) : NaN;
}

/** Promise of the codes of all parts of the error, by part. */
async function errorCodes(fields, step, { name }) {
  const found = await Promise.all(PARTS.map((part) => fields.codes(step, `${part}/${name}`)));
  return Object.fromEntries(PARTS.map((part, k) => [part, found[k]]));
}

/** A step of a quantity at some places, ready to be drawn and asked. */
export class Frame {
  /** Promise of the frame of a scene; null where the step was not measured. */
  static async load(fields, scene) {
    const { manifest } = fields;
    const step = manifest.steps[scene.step];
    const quantity = manifest.quantities[scene.quantity];
    if (!step.blobs.status) return null;
    const over = scene.over === "first" && scene.camera === "left";
    const [status, codes, errors, places, first, space, here, angles] = await Promise.all([
      fields.codes(step, "status"),
      fields.codes(step, `value/${quantity.name}`),
      errorCodes(fields, step, quantity),
      over ? fields.firstPlaces() : fields.places(step, scene.camera),
      fields.firstPlaces(),
      fields.places(step, "space"),
      fields.places(step, "left"),
      scene.directions ? anglesOf(fields, step) : null,
    ]);
    return new Frame({
      step,
      quantity,
      scene: { ...scene },
      status,
      codes,
      errors,
      places,
      first,
      space,
      here,
      angles,
    });
  }

  constructor(facts) {
    Object.assign(this, facts);
    [this.rows, this.cols] = this.step.shape;
    this.codes ||= new Uint16Array(this.rows * this.cols);
    this.places ||= new Float32Array(3 * this.rows * this.cols).fill(NaN);
    this.known = (k) => this.codes[k] > 0 && this.places[3 * k] === this.places[3 * k];
    this.kept = {};
  }

  _once(name, make) {
    if (!(name in this.kept)) this.kept[name] = make();
    return this.kept[name];
  }

  get isFlat() {
    return this.scene.camera !== "space";
  }

  /** Triangles of all whole cells. */
  get indices() {
    return this._once("indices", () => wholeCells(this.rows, this.cols, this.known));
  }

  /** Places of all points, lost ones where they would lie; only in photographs. */
  get estimates() {
    return this._once("estimates", () =>
      this.scene.camera === "left" ? withEstimates(this.places, this.first, this.rows, this.cols) : this.places,
    );
  }

  get spacing() {
    return this._once("spacing", () => spacing(this.estimates, this.rows, this.cols));
  }

  get buckets() {
    return this._once("buckets", () => new Buckets(this.estimates, this.spacing));
  }

  /** Cells with lost points, for the picture of reasons. */
  get lost() {
    return this._once("lost", () => lostCells(this.estimates, this.status, this.rows, this.cols));
  }

  /** Number of the point nearest to a place of the photograph; −1 if none is near. */
  nearest(x, y) {
    return this.buckets.nearest(x, y, 1.5 * this.spacing);
  }

  /** What is known of a point: value, its error and the parts of that, its status and places. */
  point(k) {
    const { quantity } = this;
    return {
      index: k,
      row: Math.floor(k / this.cols),
      col: k % this.cols,
      value: valueOf(quantity, this.codes[k]),
      error: errorOf(quantity, this.errors, errorPart(quantity), k),
      ...Object.fromEntries(PARTS.map((part) => [part, errorOf(quantity, this.errors, part, k)])),
      status: this.status[k],
      place: [this.estimates[3 * k], this.estimates[3 * k + 1]],
      space: this.space && [this.space[3 * k], this.space[3 * k + 1], this.space[3 * k + 2]],
    };
  }

  /** The value at a place of the photograph, by the triangle there; NaN where nothing was measured. */
  valueAt(x, y) {
    const found = trianglesAt(this.buckets, this.rows, this.cols, this.known, x, y, 1.5 * this.spacing);
    if (!found) return NaN;
    return found.points.reduce((sum, k, j) => sum + found.weights[j] * valueOf(this.quantity, this.codes[k]), 0);
  }

  /** Where the material at a place of the left photograph lay at the first step; null where that is unknown. */
  firstAt(x, y) {
    const found = trianglesAt(this.buckets, this.rows, this.cols, this.known, x, y, 1.5 * this.spacing);
    if (!found || !this.first || this.scene.camera !== "left") return null;
    return [0, 1].map((part) => found.points.reduce((sum, k, j) => sum + found.weights[j] * this.first[3 * k + part], 0));
  }

  /** Where the material that lay at a place of the first left photograph is now; null where that is unknown. */
  nowAt(x, y) {
    if (!this.first || !this.isFlat) return null;
    if (this.scene.over === "first" && this.scene.camera === "left") return [x, y];
    const apart = this._once("firstSpacing", () => spacing(this.first, this.rows, this.cols));
    const buckets = this._once("firstBuckets", () => new Buckets(this.first, apart));
    const found = trianglesAt(buckets, this.rows, this.cols, this.known, x, y, 1.5 * apart);
    return found && [0, 1].map((part) => found.points.reduce((sum, k, j) => sum + found.weights[j] * this.places[3 * k + part], 0));
  }

  /** Where a point lay at the first step [px]; null where that is unknown. */
  firstOf(k) {
    return this.first ? [this.first[3 * k], this.first[3 * k + 1]] : null;
  }

  /** Least and largest value of this step without the outermost half per cent at either end; null without values. */
  get range() {
    return this._once("range", () => {
      const known = this.codes.filter((code) => code > 0).sort();
      if (!known.length) return null;
      const at = (share) => valueOf(this.quantity, known[Math.round(share * (known.length - 1))]);
      return [at(0.005), at(0.995)];
    });
  }

  /** Box of all places: low and high (x, y, z); null without any. */
  get box() {
    return this._once("box", () => boxOf(this.places));
  }
}

/** Least and largest coordinates of known places; null without any. */
export function boxOf(places) {
  const [low, high] = [
    [Infinity, Infinity, Infinity],
    [-Infinity, -Infinity, -Infinity],
  ];
  for (let k = 0; k < places.length; k++) {
    const value = places[k];
    if (value < low[k % 3]) low[k % 3] = value;
    if (value > high[k % 3]) high[k % 3] = value;
  }
  return low[0] <= high[0] ? { low, high } : null;
}

/** Readings of a material point, or of the point nearest to a place, at all steps: { values, errors }. */
export async function curveOf(fields, scene, picked) {
  const { manifest } = fields;
  const quantity = manifest.quantities[scene.quantity];
  if (fields.source.curve && manifest.follows) return fields.curve(quantity, picked.index);
  const part = errorPart(quantity);
  const found = await Promise.all(
    manifest.steps.map(async (step) => {
      if (!step.blobs.status) return [NaN, NaN];
      const [codes, errors] = await Promise.all([
        fields.codes(step, `value/${quantity.name}`),
        fields.codes(step, `${part}/${quantity.name}`),
      ]);
      const k = manifest.follows ? picked.index : await nearestIn(fields, step, picked.place);
      if (!codes || k < 0 || k >= codes.length) return [NaN, NaN];
      return [valueOf(quantity, codes[k]), errorOf(quantity, { [part]: errors }, part, k)];
    }),
  );
  return { values: found.map(([value]) => value), errors: found.map(([, error]) => error) };
}

async function nearestIn(fields, step, [x, y]) {
  const places = await fields.places(step, "left");
  if (!places) return -1;
  const apart = spacing(places, ...step.shape);
  return new Buckets(places, apart).nearest(x, y, 1.5 * apart);
}

/** A quantity along a line of the photograph: { at: distance from its start, values }. */
export function profileOf(frame, [[x0, y0], [x1, y1]], samples = 201) {
  const length = Math.hypot(x1 - x0, y1 - y0);
  const shares = Array.from({ length: samples }, (_, k) => k / (samples - 1));
  return {
    at: shares.map((share) => share * length),
    values: shares.map((share) => frame.valueAt(x0 + share * (x1 - x0), y0 + share * (y1 - y0))),
  };
}
