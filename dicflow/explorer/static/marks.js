// Drawings above the field: a line, a bar of known length, axes in space, and both cameras.

import { projected } from "./camera.js";
import { brief } from "./numbers.js";
import { svg } from "./page.js";

/** A line with round ends. */
export function lineMarks([[x0, y0], [x1, y1]]) {
  const line = (name) => svg("line", { x1: x0, y1: y0, x2: x1, y2: y1, class: name });
  const end = (x, y) => svg("circle", { cx: x, cy: y, r: 4.5, class: "x-end" });
  return [line("x-line x-line-below"), line("x-line"), end(x0, y0), end(x1, y1)];
}

/** Probes of the pipeline where their material lies now, with their names; one on lost points is left out. */
export function probeMarks(probes, frame, view) {
  return probes.flatMap(({ name, sort, places }) => {
    const found = places.map(([x, y]) => frame.nowAt(x, y));
    if (!found.length || found.some((one) => !one)) return [];
    const ends = found.map((one) => view.toPicture(...one));
    const path = `M${ends.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}${sort === "area" ? "Z" : ""}`;
    const [x, y] = ends[0];
    return [
      ...(ends.length > 1 ? ["x-probe x-probe-below", `x-probe x-probe-${sort}`].map((look) => svg("path", { d: path, class: look })) : []),
      ...(sort === "area" ? [] : ends.map(([cx, cy]) => svg("circle", { cx, cy, r: 3.5, class: "x-probe-end" }))),
      svg("text", { x: x + 7, y: y - 7, class: "x-probe-name" }, name),
    ];
  });
}

/** A bar of round length: in mm where the points' places in space are known, else in px. */
export function scaleBar(frame, view, [, height], unit) {
  const perPixel = unit === "mm" ? lengthPerPixel(frame) : 1;
  if (!perPixel) return [];
  const rough = (90 / view.scale) * perPixel;
  const power = 10 ** Math.floor(Math.log10(rough));
  const length = [5, 2, 1].map((one) => one * power).find((one) => one <= rough) || power;
  const wide = (length / perPixel) * view.scale;
  const [x, y] = [16, height - 16];
  const path = `M${x} ${y - 5}V${y}H${x + wide}V${y - 5}`;
  return [
    svg("rect", { x: x - 7, y: y - 22, width: wide + 14, height: 29, rx: 5, class: "x-plate" }),
    svg("path", { d: path, class: "x-bar" }),
    svg(
      "text",
      { x: x + wide / 2, y: y - 7, "text-anchor": "middle", class: "x-bar-text" },
      `${brief(length)} ${unit}`,
    ),
  ];
}

function lengthPerPixel(frame) {
  if (!frame.space) return 0;
  const found = [];
  for (let k = 0; k + 1 < frame.rows * frame.cols; k += Math.max(1, (frame.rows * frame.cols) >> 9)) {
    const [i, j] = [3 * k, 3 * k + 3];
    const long = Math.hypot(
      frame.space[j] - frame.space[i],
      frame.space[j + 1] - frame.space[i + 1],
      frame.space[j + 2] - frame.space[i + 2],
    );
    const short = Math.hypot(frame.places[j] - frame.places[i], frame.places[j + 1] - frame.places[i + 1]);
    if (long > 0 && short > 0 && (k + 1) % frame.cols) found.push(long / short);
  }
  return found.sort((one, other) => one - other)[found.length >> 1] || 0;
}

/** The axes X, Y and Z as they lie in a turned view. */
export function triad({ yaw, pitch }, [width, height]) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  const ends = { X: [cy, -sp * sy], Y: [0, cp], Z: [sy, sp * cy] };
  const [x, y] = [width - 56, height - 56];
  return Object.entries(ends).flatMap(([name, [dx, dy]]) => [
    svg("line", { x1: x, y1: y, x2: x + 30 * dx, y2: y + 30 * dy, class: "x-triad" }),
    svg("text", { x: x + 41 * dx, y: y + 41 * dy + 4, "text-anchor": "middle", class: "x-bar-text" }, name),
  ]);
}

/** Both cameras as pyramids. */
export function frustums(cameras, box, matrix, size) {
  if (!box) return [];
  const middle = box.low.map((one, k) => (one + box.high[k]) / 2);
  return cameras.flatMap(({ name, centre, corners }) => {
    const far = 0.16 * Math.hypot(...middle.map((one, k) => one - centre[k]));
    const at = (place) => projected(matrix, ...place, ...size);
    const tip = at(centre);
    const base = corners.map((corner) => at(centre.map((one, k) => one + far * corner[k])));
    if (!tip || base.some((one) => !one)) return [];
    const ring = base.map((one) => one.join(",")).join(" ");
    return [
      svg("polygon", { points: ring, class: "x-frustum" }),
      ...base.map((one) => svg("line", { x1: tip[0], y1: tip[1], x2: one[0], y2: one[1], class: "x-frustum" })),
      svg("text", { x: tip[0], y: tip[1] - 8, "text-anchor": "middle", class: "x-bar-text" }, name),
    ];
  });
}
