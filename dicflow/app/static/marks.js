// The paths of a pen as SVG above the photograph.

import { fill, s } from "./dom.js";
import { SORTS } from "./shapes.js";

const MOST_CORNERS = 600;

/** Draw all paths, the corners of the chosen one, and what is being drawn. */
export function drawMarks(viewer, pen) {
  const at = (place) => viewer.toScreen(place);
  const parts = [region(pen.paths, at)];
  pen.paths.forEach((path, number) => parts.push(...mark(path, at, number === pen.chosen.path)));
  const chosen = pen.paths[pen.chosen.path];
  if (chosen && chosen.places.length <= MOST_CORNERS) parts.push(...corners(chosen, at, pen.chosen.corner));
  if (pen.draft) parts.push(...draft(pen, at));
  if (pen.cursor && pen.tool !== "select") parts.push(cross(at(pen.cursor)));
  fill(viewer.marks, parts);
}

const points = (places, at) => places.map((place) => at(place).map((x) => x.toFixed(1)).join(",")).join(" ");

/** The measured area: outlines without holes. */
function region(paths, at) {
  const rings = paths.filter((path) => path.sort === "outline" || path.sort === "hole");
  return s("path", { class: "region", d: rings.map((path) => `M${points(path.places, at).replaceAll(" ", "L")}Z`).join(""), "fill-rule": "evenodd" });
}

function mark(path, at, isChosen) {
  const shape = SORTS[path.sort].closed ? "polygon" : "polyline";
  const parts = ["under", path.sort].map((look) =>
    s(shape, { class: `path ${look}${isChosen ? " chosen" : ""}`, points: points(path.places, at) }));
  if (SORTS[path.sort].most) parts.push(...path.places.map((place) => dot(at(place), `end ${path.sort}`, 4)));
  if (path.name) {
    const [x, y] = at(path.places[0]);
    parts.push(...["under", "over"].map((look) => s("text", { class: `name ${look}`, x: x + 8, y: y - 8 }, path.name)));
  }
  return parts;
}

function corners(path, at, chosen) {
  return path.places.map((place, k) => dot(at(place), k === chosen ? "corner chosen" : "corner", k === chosen ? 7 : 5));
}

function draft(pen, at) {
  const sort = SORTS[pen.tool];
  const places = pen.pointer ? [...pen.draft, pen.pointer] : pen.draft;
  const parts = ["under", pen.tool].map((look) =>
    s(sort.closed ? "polygon" : "polyline", { class: `path draft ${look}`, points: points(places, at) }));
  return [...parts, ...pen.draft.map((place, k) => dot(at(place), k ? "corner" : "corner first", 5))];
}

function dot([x, y], look, radius) {
  return s("circle", { class: look, cx: x.toFixed(1), cy: y.toFixed(1), r: radius });
}

function cross([x, y]) {
  return s("path", { class: "cross", d: `M${x - 14} ${y}H${x - 3}M${x + 3} ${y}H${x + 14}M${x} ${y - 14}V${y - 3}M${x} ${y + 3}V${y + 14}` });
}
