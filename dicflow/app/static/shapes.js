// What a person draws, as paths of places [px], without a picture of it: pure functions.
// A path: sort (outline, hole, cut, point, line, extensometer, area), name (of a probe), places [[x, y], …].

export const SORTS = {
  outline: { title: "Outline", least: 3, closed: true, key: "o", words: "the part that is measured" },
  hole: { title: "Hole", least: 3, closed: true, key: "h", words: "inside an outline, not measured" },
  cut: { title: "Cut", least: 2, closed: false, key: "c", words: "a line across which nothing is compared" },
  point: { title: "Point", least: 1, most: 1, closed: false, key: "p", probe: "points", words: "values at one place" },
  line: { title: "Line", least: 2, most: 2, closed: false, key: "l", probe: "lines", words: "values along a line" },
  extensometer: { title: "Extensometer", least: 2, most: 2, closed: false, key: "e", probe: "extensometers", words: "the distance of two places" },
  area: { title: "Area", least: 3, closed: true, key: "a", probe: "areas", words: "the mean over an area" },
};

/** A number as it is written to files. */
export const rounded = (value) => Math.round(value * 100) / 100;

/** Paths of a region and of probes, as the server gives them. */
export function pathsOf(region, probes) {
  const paths = [];
  for (const polygon of region?.polygons ?? []) {
    paths.push({ sort: "outline", name: "", places: polygon.exterior });
    for (const hole of polygon.holes) paths.push({ sort: "hole", name: "", places: hole });
  }
  for (const cut of region?.cuts ?? []) paths.push({ sort: "cut", name: "", places: cut });
  if (probes?.unit === "mm") return paths;
  for (const [sort, { probe }] of Object.entries(SORTS)) {
    for (const [name, places] of Object.entries((probe && probes?.[probe]) ?? {})) {
      paths.push({ sort, name, places: sort === "point" ? [places] : places });
    }
  }
  return paths;
}

/** Polygons with their holes, and cuts. Throws where a hole lies in no outline. */
export function regionOf(paths) {
  const polygons = paths.filter((path) => path.sort === "outline").map((path) => ({ exterior: path.places, holes: [] }));
  for (const path of paths.filter((one) => one.sort === "hole")) {
    const around = polygons.find((polygon) => path.places.every((place) => contains(polygon.exterior, place)))
      ?? polygons.find((polygon) => contains(polygon.exterior, path.places[0]));
    if (!around) throw new Error("a hole lies in no outline; draw it inside one");
    around.holes.push(path.places);
  }
  return { polygons, cuts: paths.filter((path) => path.sort === "cut").map((path) => path.places) };
}

/** Probes by sort and name. */
export function probesOf(paths) {
  const probes = { points: {}, lines: {}, extensometers: {}, areas: {} };
  for (const path of paths) {
    const { probe } = SORTS[path.sort];
    if (probe) probes[probe][path.name] = path.sort === "point" ? path.places[0] : path.places;
  }
  return probes;
}

/** Whether a place is inside a ring (even number of crossings outside). */
export function contains(ring, [x, y]) {
  let inside = false;
  for (let k = 0, j = ring.length - 1; k < ring.length; j = k++) {
    const [[x0, y0], [x1, y1]] = [ring[k], ring[j]];
    if (y0 > y !== y1 > y && x < ((x1 - x0) * (y - y0)) / (y1 - y0) + x0) inside = !inside;
  }
  return inside;
}

/** The corner of a path nearest to a place, as { path, corner, distance }; corner is -1 without any. */
export function nearestCorner(paths, at, distance) {
  let best = { path: -1, corner: -1, distance };
  paths.forEach((path, number) => path.places.forEach((place, corner) => {
    const gap = Math.hypot(place[0] - at[0], place[1] - at[1]);
    if (gap < best.distance) best = { path: number, corner, distance: gap };
  }));
  return best;
}

/** The edge of a path nearest to a place: corner is the one before it. */
export function nearestEdge(paths, at, distance) {
  let best = { path: -1, corner: -1, distance };
  paths.forEach((path, number) => {
    const count = path.places.length - (SORTS[path.sort].closed ? 0 : 1);
    for (let k = 0; k < count; k++) {
      const gap = toSegment(at, path.places[k], path.places[(k + 1) % path.places.length]);
      if (gap < best.distance) best = { path: number, corner: k, distance: gap };
    }
  });
  return best;
}

function toSegment([x, y], [x0, y0], [x1, y1]) {
  const [dx, dy] = [x1 - x0, y1 - y0];
  const t = Math.min(1, Math.max(0, ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy || 1)));
  return Math.hypot(x - x0 - t * dx, y - y0 - t * dy);
}

/** Fewer corners: those that lie within a tolerance [px] of the line between others go (Douglas and Peucker). */
export function simplified(places, tolerance, closed) {
  if (closed) {
    const far = places.reduce((best, place, k) => (gap(place, places[0]) > gap(places[best], places[0]) ? k : best), 0);
    const one = simplified(places.slice(0, far + 1), tolerance, false);
    const other = simplified([...places.slice(far), places[0]], tolerance, false);
    const ring = [...one.slice(0, -1), ...other.slice(0, -1)];
    return ring.length < 3 ? places : ring;
  }
  if (places.length < 3) return places;
  let [worst, most] = [0, 0];
  for (let k = 1; k < places.length - 1; k++) {
    const distance = toSegment(places[k], places[0], places[places.length - 1]);
    if (distance > most) [worst, most] = [k, distance];
  }
  if (most <= tolerance) return [places[0], places[places.length - 1]];
  return [...simplified(places.slice(0, worst + 1), tolerance, false).slice(0, -1), ...simplified(places.slice(worst), tolerance, false)];
}

const gap = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]);

/** A name that no other probe has: point_1, point_2, … */
export function freeName(paths, sort) {
  for (let k = 1; ; k++) {
    if (!paths.some((path) => path.name === `${sort}_${k}`)) return `${sort}_${k}`;
  }
}
