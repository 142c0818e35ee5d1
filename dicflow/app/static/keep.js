// Points and lines of the explorer become probes of the pipeline, at their places in the first left photograph.

import { ask } from "./api.js";
import { freeName, pathsOf, probesOf, rounded } from "./shapes.js";

/** What can be kept of an explorer's scene: [{ words, sort, shapes }], each shape a list of places [px]. */
export function keepable(explorer) {
  const { frame, points, scene } = explorer;
  if (!frame?.first) return [];
  const places = points.map(({ index }) => frame.firstOf(index)).filter(isKnown);
  const ends = scene.line && scene.camera === "left" ? scene.line.map(([x, y]) => frame.firstAt(x, y)) : [];
  const found = [];
  if (places.length) found.push({ words: places.length > 1 ? "Keep the points" : "Keep the point", sort: "point", shapes: places.map((one) => [one]) });
  if (ends.length === 2 && ends.every(isKnown)) {
    found.push({ words: "Keep the line", sort: "line", shapes: [ends] });
    found.push({ words: "Keep as extensometer", sort: "extensometer", shapes: [ends] });
  }
  return found;
}

const isKnown = (place) => place?.every(Number.isFinite) ?? false;

/** Write shapes into the stage "probes" of a file; the names that they got. Throws where its places are in mm. */
export function keep(app, { sort, shapes }) {
  return app.inTurn(() => put(app, sort, shapes));
}

async function put(app, sort, shapes) {
  const { probes } = await ask("drawing", { file: app.file });
  if (probes?.unit === "mm") throw new Error("the probes of this file are given in mm; type them in the settings");
  const paths = pathsOf(null, probes);
  const names = [];
  for (const places of shapes) {
    const name = freeName(paths, sort);
    paths.push({ sort, name, places: places.map((place) => place.map(rounded)) });
    names.push(name);
  }
  await app.put("probe", { stage: probes?.stage ?? "probes", probes: probesOf(paths) });
  return names;
}
