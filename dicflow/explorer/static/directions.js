// Directions of the larger principal strain, as short lines over the field.

import { valueOf } from "./source.js";
import { svg } from "./page.js";

const ABOUT = 240;

/** Names of the quantities by which the direction is known; none if it is unknown. */
export function directionKeys(quantities) {
  const has = (names) => names.every((name) => quantities.some((one) => one.name === name));
  return [["angle"], ["exx", "eyy", "gxy"]].find(has) || [];
}

/** Promise of the angle [rad] from x to y of a point by its number; null where a step lacks it. */
export async function anglesOf(fields, step) {
  const { quantities } = fields.manifest;
  const facts = directionKeys(quantities).map((name) => quantities.find((one) => one.name === name));
  const codes = await Promise.all(facts.map((one) => fields.codes(step, `value/${one.name}`)));
  if (!facts.length || codes.some((one) => !one)) return null;
  const at = (part, k) => valueOf(facts[part], codes[part][k]);
  return facts.length === 1
    ? (k) => (at(0, k) * Math.PI) / 180
    : (k) => 0.5 * Math.atan2(at(2, k), at(0, k) - at(1, k));
}

/** Lines at evenly chosen points. frame : with places, first and angles; toPicture : of its window */
export function directionMarks(frame, scene, material, view) {
  const { rows, cols, angles, places, first } = frame;
  if (!angles) return [];
  const stride = Math.max(1, Math.ceil(Math.sqrt((rows * cols) / ABOUT)));
  const carried = material ? scene.over === "step" && first : scene.over === "first";
  const [before, after] = material ? [first, places] : [frame.here || places, places];
  const half = 0.4 * stride * frame.spacing * view.scale;
  let path = "";
  for (let row = stride >> 1; row < rows; row += stride) {
    for (let k = row * cols + (stride >> 1); k < (row + 1) * cols; k += stride) {
      const angle = angles(k);
      const [x, y] = [places[3 * k], places[3 * k + 1]];
      if (angle !== angle || x !== x) continue;
      let [dx, dy] = [Math.cos(angle), Math.sin(angle)];
      if (carried) [dx, dy] = carriedAlong(before, after, k, rows, cols, dx, dy);
      const long = Math.hypot(dx, dy);
      if (!(long > 0)) continue;
      const [px, py] = view.toPicture(x, y);
      const [ex, ey] = [(half * dx) / long, (half * dy) / long];
      path += `M${(px - ex).toFixed(1)} ${(py - ey).toFixed(1)}L${(px + ex).toFixed(1)} ${(py + ey).toFixed(1)}`;
    }
  }
  return [
    svg("path", { d: path, class: "x-direction x-direction-below" }),
    svg("path", { d: path, class: "x-direction" }),
  ];
}

// J d with J = ∂after/∂before by central differences along rows and columns; NaN where a neighbour is missing.
function carriedAlong(before, after, k, rows, cols, dx, dy) {
  const [row, col] = [Math.floor(k / cols), k % cols];
  if (row === 0 || row === rows - 1 || col === 0 || col === cols - 1) return [NaN, NaN];
  const slope = (places, part) => [
    places[3 * (k + 1) + part] - places[3 * (k - 1) + part],
    places[3 * (k + cols) + part] - places[3 * (k - cols) + part],
  ];
  const [[a, b], [c, d]] = [slope(before, 0), slope(before, 1)];
  const turned = a * d - b * c;
  const [u, v] = [(d * dx - b * dy) / turned, (a * dy - c * dx) / turned];
  const [[e, f], [g, h]] = [slope(after, 0), slope(after, 1)];
  return [e * u + f * v, g * u + h * v];
}
