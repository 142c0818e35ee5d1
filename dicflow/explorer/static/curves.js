// What the curve beside the picture shows: chosen points, else probes of the pipeline, else the mean of the field.

import { curveOf } from "./frame.js";
import { axisText, capital } from "./numbers.js";

export const COLOURS = ["#d1495b", "#2a7f9e", "#e09f3e", "#5a8f3c", "#7d5ba6", "#3d405b"];
const ACCENT = "var(--x-accent)";

/** Promise of series { name, what, colour, symbol, unit, numbers of the steps, y, error }, also of a companion. */
export async function seriesOf(host) {
  const own = await ownSeries(host);
  if (!host.companion) return own;
  const { explorer, names } = host.companion;
  const others = (await ownSeries(explorer)).map((one) => ({
    ...one,
    name: `${names[1]}: ${one.name}`,
    colour: one.colour === ACCENT ? COLOURS[0] : one.colour,
    dashed: true,
  }));
  return [...own.map((one) => ({ ...one, name: `${names[0]}: ${one.name}` })), ...others];
}

async function ownSeries(host) {
  const { manifest, quantity, points } = host;
  const { symbol, unit } = quantity;
  const numbers = manifest.steps.map((step) => step.number);
  if (points.length) {
    const curves = await Promise.all(points.map((one) => curveOf(host.fields, host.scene, one)));
    return curves.map(({ values, errors }, k) => {
      const { row, col, colour } = points[k];
      const name = `point ${row}, ${col}`;
      return fromFirst(quantity, { name, what: name, colour, symbol, unit, numbers, y: values, error: errors });
    });
  }
  const probes = manifest.curves.filter((one) => belongs(one, quantity, manifest.main[0]));
  if (probes.length) return probes.map((one, k) => ofProbe(one, k ? COLOURS[(k - 1) % COLOURS.length] : ACCENT));
  const part = (k) => quantity.means.map((pair) => (pair ? pair[k] : NaN));
  const name = "mean of the field ± spread";
  return [fromFirst(quantity, { name, what: name, colour: ACCENT, symbol, unit, numbers, y: part(0), error: part(1) })];
}

// What counts from the first step is 0 there.
function fromFirst({ starts }, series) {
  if (!starts) return series;
  return { ...series, numbers: [0, ...series.numbers], y: [0, ...series.y], error: [0, ...series.error] };
}

// An extensometer belongs to the main quantity, since it measures the same strain.
function belongs(probe, quantity, main) {
  return probe.quantity === quantity.name || (probe.quantity === "strain" && quantity.name === main);
}

function ofProbe({ title, quantity, unit, numbers, values, errors }, colour) {
  const number = (value) => (value === null ? NaN : value);
  const facts = { name: title, what: title, colour, symbol: quantity, unit, numbers };
  return { ...facts, y: values.map(number), error: errors.map(number) };
}

/** The heading of a chart of series. */
export function titleOf({ points, quantity }, series) {
  if (points.length) return `${quantity.symbol} at ${points.length === 1 ? "the point" : "points"}`;
  return series.every((one) => one.what === series[0].what) ? capital(series[0].what) : "Probes";
}

/** Places in the manifest of steps by their numbers; undefined for one that is not there. */
export function placesOf(manifest, numbers) {
  const places = new Map(manifest.steps.map((step, k) => [step.number, k]));
  return numbers.map((number) => places.get(number));
}

/** Loads of steps by their numbers; NaN for an unknown one. */
export function loadsOf(manifest, numbers) {
  const { load } = manifest;
  const places = placesOf(manifest, numbers);
  return numbers.map((number, k) => (number === 0 ? load?.first : load?.steps[places[k]]) ?? NaN);
}

/** Name of a step by its number. */
export function nameOf(manifest, number) {
  return manifest.steps.find((step) => step.number === number)?.name ?? "first step";
}

/** The series as a table: one row per step, each value with its error. */
export function tableOf(manifest, series) {
  const numbers = [...new Set(series.flatMap((one) => one.numbers))].sort((one, other) => one - other);
  const at = (one, part, number) => one[part][one.numbers.indexOf(number)] ?? NaN;
  const loads = manifest.load ? loadsOf(manifest, numbers) : null;
  return {
    columns: [
      "step",
      ...(loads ? [axisText("load", manifest.load.unit)] : []),
      ...series.flatMap((one) => [`${one.name} ${axisText(one.symbol, one.unit)}`, `± ${one.name}`]),
    ],
    rows: numbers.map((number, k) => [
      nameOf(manifest, number),
      ...(loads ? [loads[k]] : []),
      ...series.flatMap((one) => [at(one, "y", number), at(one, "error", number)]),
    ]),
  };
}
