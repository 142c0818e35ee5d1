// The point nearest to the pointer, by buckets in the plane in which points are shown.

/** Buckets of points. places : x, y, … with so many numbers per point; size : side of a bucket, about the points' distance */
export class Buckets {
  constructor(places, size, numbers = 3) {
    Object.assign(this, { places, numbers });
    const count = places.length / numbers;
    let [x0, y0, x1, y1] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let k = 0; k < places.length; k += numbers) {
      const [x, y] = [places[k], places[k + 1]];
      if (x !== x) continue;
      if (x < x0) x0 = x;
      if (x > x1) x1 = x;
      if (y < y0) y0 = y;
      if (y > y1) y1 = y;
    }
    this.size = Math.max(size, (x1 - x0) / 1000, (y1 - y0) / 1000) || 1;
    this.origin = [x0, y0];
    this.wide = Math.max(1, Math.floor((x1 - x0) / this.size) + 1) || 1;
    this.high = Math.max(1, Math.floor((y1 - y0) / this.size) + 1) || 1;
    this.start = new Uint32Array(this.wide * this.high + 1);
    this.list = new Uint32Array(count);
    const bucket = new Int32Array(count);
    for (let k = 0; k < count; k++) {
      const x = places[numbers * k];
      bucket[k] =
        x === x
          ? Math.floor((places[numbers * k + 1] - y0) / this.size) * this.wide + Math.floor((x - x0) / this.size)
          : -1;
      if (bucket[k] >= 0) this.start[bucket[k] + 1]++;
    }
    for (let k = 1; k < this.start.length; k++) this.start[k] += this.start[k - 1];
    const next = this.start.slice();
    for (let k = 0; k < count; k++) if (bucket[k] >= 0) this.list[next[bucket[k]]++] = k;
  }

  /** Number of the point nearest to (x, y) within a reach; −1 if none is. */
  nearest(x, y, reach) {
    const across = Math.ceil(reach / this.size);
    const [col, row] = [Math.floor((x - this.origin[0]) / this.size), Math.floor((y - this.origin[1]) / this.size)];
    let [best, least] = [-1, reach * reach];
    for (let r = Math.max(0, row - across); r <= Math.min(this.high - 1, row + across); r++) {
      for (let c = Math.max(0, col - across); c <= Math.min(this.wide - 1, col + across); c++) {
        for (let k = this.start[r * this.wide + c]; k < this.start[r * this.wide + c + 1]; k++) {
          const point = this.list[k];
          const [dx, dy] = [this.places[this.numbers * point] - x, this.places[this.numbers * point + 1] - y];
          if (dx * dx + dy * dy < least) [best, least] = [point, dx * dx + dy * dy];
        }
      }
    }
    return best;
  }
}

/** A linear combination of three points at a place: { points, weights }; null outside of all whole cells. */
export function trianglesAt(buckets, rows, cols, known, x, y, reach) {
  const near = buckets.nearest(x, y, reach);
  if (near < 0) return null;
  const [row, col] = [Math.floor(near / cols), near % cols];
  for (let r = Math.max(0, row - 1); r <= Math.min(rows - 2, row); r++) {
    for (let c = Math.max(0, col - 1); c <= Math.min(cols - 2, col); c++) {
      const k = r * cols + c;
      const corners = [k, k + 1, k + cols, k + cols + 1];
      if (!corners.every(known)) continue;
      for (const points of [
        [k, k + 1, k + cols],
        [k + 1, k + cols + 1, k + cols],
      ]) {
        const weights = barycentric(buckets.places, points, x, y);
        if (weights) return { points, weights };
      }
    }
  }
  return null;
}

const ROUNDING = 1e-4;

function barycentric(places, [a, b, c], x, y) {
  const [ax, ay] = [places[3 * a], places[3 * a + 1]];
  const [bx, by] = [places[3 * b] - ax, places[3 * b + 1] - ay];
  const [cx, cy] = [places[3 * c] - ax, places[3 * c + 1] - ay];
  const whole = bx * cy - by * cx;
  const [u, v] = [((x - ax) * cy - (y - ay) * cx) / whole, ((y - ay) * bx - (x - ax) * by) / whole];
  return u >= -ROUNDING && v >= -ROUNDING && u + v <= 1 + ROUNDING ? [1 - u - v, u, v] : null;
}
