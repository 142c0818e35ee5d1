// From places to the picture: a window on a photograph, or a turned surface in space. Matrices are by columns.

/** The window on a plane: a place p lies at scale · p + (x, y) [CSS px]. */
export class Window2D {
  constructor() {
    Object.assign(this, { scale: 1, x: 0, y: 0 });
  }

  /** Shows a box (x0, y0, x1, y1) as large as possible. */
  fit([x0, y0, x1, y1], width, height, margin = 12) {
    this.scale = Math.min((width - 2 * margin) / (x1 - x0 || 1), (height - 2 * margin) / (y1 - y0 || 1));
    this.x = width / 2 - (this.scale * (x0 + x1)) / 2;
    this.y = height / 2 - (this.scale * (y0 + y1)) / 2;
  }

  /** Zooms by a factor about a place of the picture. */
  zoom(factor, px, py) {
    this.x = px - factor * (px - this.x);
    this.y = py - factor * (py - this.y);
    this.scale *= factor;
  }

  pan(dx, dy) {
    this.x += dx;
    this.y += dy;
  }

  toPicture(x, y) {
    return [this.scale * x + this.x, this.scale * y + this.y];
  }

  toPlace(px, py) {
    return [(px - this.x) / this.scale, (py - this.y) / this.scale];
  }

  matrix(width, height) {
    const [a, b] = [(2 * this.scale) / width, (2 * this.scale) / height];
    return Float32Array.of(
      a,
      0,
      0,
      0,
      0,
      -b,
      0,
      0,
      0,
      0,
      0,
      0,
      (2 * this.x) / width - 1,
      1 - (2 * this.y) / height,
      0,
      1,
    );
  }
}

const FOCAL = 3.2;

/** The view of a surface: turned about its middle by yaw and pitch [rad], seen along Z, with Y downwards. */
export class Turntable {
  constructor() {
    Object.assign(this, { centre: [0, 0, 0], radius: 1, yaw: 0.5, pitch: -0.35, distance: 1, dx: 0, dy: 0 });
  }

  /** Shows a box from low to high (x, y, z), and further places, whole in a picture. */
  fit(low, high, further, width, height) {
    const corners = Array.from({ length: 8 }, (_, k) => low.map((one, part) => ((k >> part) & 1 ? high[part] : one)));
    const shown = [...corners, ...further];
    const ends = low
      .map((_, part) => shown.map((one) => one[part]))
      .map((values) => [Math.min(...values), Math.max(...values)]);
    this.centre = ends.map(([least, most]) => (least + most) / 2);
    this.radius = Math.hypot(...ends.map(([least, most]) => most - least)) / 2 || 1;
    Object.assign(this, { yaw: further.length ? 0.9 : 0.5, pitch: -0.35, distance: FOCAL * this.radius, dx: 0, dy: 0 });
    for (let round = 0; round < 4; round++) {
      const matrix = this.matrix(width, height);
      const reach = shown
        .map((one) => projected(matrix, ...one, 2, 2))
        .map((at) => (at ? Math.max(Math.abs(at[0] - 1), Math.abs(at[1] - 1)) : 2));
      this.distance *= Math.max(...reach) / 0.86;
    }
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-1.55, Math.min(1.55, this.pitch + pitch));
  }

  zoom(factor) {
    this.distance = Math.max(this.radius * 0.2, Math.min(this.radius * 60, this.distance / factor));
  }

  pan(dx, dy, height) {
    this.dx += (2 * dx) / height;
    this.dy += (2 * dy) / height;
  }

  matrix(width, height) {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const turn = [
      [cy, 0, sy],
      [-sp * sy, cp, sp * cy],
      [-cp * sy, -sp, cp * cy],
    ];
    const shift = turn.map(
      (row, k) => (k === 2 ? this.distance : 0) - row.reduce((sum, one, j) => sum + one * this.centre[j], 0),
    );
    const wide = Math.min(1, width / height);
    const [fx, fy] = [(FOCAL * height * wide) / width, FOCAL * wide];
    const [near, far] = [this.distance - 40 * this.radius, this.distance + 40 * this.radius].map((z, k) =>
      k ? z : Math.max(z, this.distance * 0.02),
    );
    const [a, b] = [(far + near) / (far - near), (-2 * far * near) / (far - near)];
    const rows = [
      [
        ...turn[0].map((one, k) => fx * one + ((this.dx * height) / width) * turn[2][k]),
        fx * shift[0] + ((this.dx * height) / width) * shift[2],
      ],
      [...turn[1].map((one, k) => -fy * one - this.dy * turn[2][k]), -fy * shift[1] - this.dy * shift[2]],
      [...turn[2].map((one) => a * one), a * shift[2] + b],
      [...turn[2], shift[2]],
    ];
    return Float32Array.from({ length: 16 }, (_, k) => rows[k % 4][k >> 2]);
  }
}

/** Where a place (x, y, z) lies in the picture: [x, y] in CSS px, null behind the viewer. */
export function projected(matrix, x, y, z, width, height) {
  const at = (row) => matrix[row] * x + matrix[row + 4] * y + matrix[row + 8] * z + matrix[row + 12];
  const w = at(3);
  return w > 1e-9 ? [((at(0) / w + 1) / 2) * width, ((1 - at(1) / w) / 2) * height] : null;
}

/** All places of a surface in the picture: x, y of one after another, NaN for unknown ones. */
export function projectedAll(matrix, places, width, height) {
  const found = new Float32Array((places.length / 3) * 2);
  for (let k = 0, j = 0; k < places.length; k += 3, j += 2) {
    const [x, y, z] = [places[k], places[k + 1], places[k + 2]];
    const w = matrix[3] * x + matrix[7] * y + matrix[11] * z + matrix[15];
    found[j] = (((matrix[0] * x + matrix[4] * y + matrix[8] * z + matrix[12]) / w + 1) / 2) * width;
    found[j + 1] = ((1 - (matrix[1] * x + matrix[5] * y + matrix[9] * z + matrix[13]) / w) / 2) * height;
  }
  return found;
}
