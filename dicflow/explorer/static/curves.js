// What the curve beside the picture shows: chosen points, else probes of the pipeline, else the mean of the field.

import { curveOf } from "./frame.js";
import { axisText, capital } from "./numbers.js";

export const COLOURS = ["#d1495b", "#2a7f9e", "#e09f3e", "#5a8f3c", "#7d5ba6", "#3d405b"];
const ACCENT = "var(--x-accent)";

/** Promise of series { name, colour, symbol, unit, numbers of the steps, y, error }. */
export async function seriesOf(host) {
  const { manifest, quantity, points } = host;
  const { symbol, unit } = quantity;
  const numbers = manifest.steps.map((step) => step.number);
  if (points.length) {
    const curves = await Promise.all(points.map((one) => curveOf(host.fields, host.scene, one)));
    return curves.map(({ values, sigmas }, k) => {
      const { row, col, colour } = points[k];
      return { name: `point ${row}, ${col}`, colour, symbol, unit, numbers, y: values, error: sigmas };
    });
  }
  const probes = manifest.curves.filter((one) => belongs(one, quantity, manifest.main[0]));
  if (probes.length) return probes.map((one, k) => ofProbe(one, k ? COLOURS[(k - 1) % COLOURS.length] : ACCENT));
  const part = (k) => quantity.means.map((pair) => (pair ? pair[k] : NaN));
  return [{ name: "mean of the field ± spread", colour: ACCENT, symbol, unit, numbers, y: part(0), error: part(1) }];
}

// An extensometer belongs to the main quantity, since it measures the same strain.
function belongs(probe, quantity, main) {
  return probe.quantity === quantity.name || (probe.quantity === "strain" && quantity.name === main);
}

function ofProbe({ title, quantity, unit, numbers, values, sigmas }, colour) {
  const number = (value) => (value === null ? NaN : value);
  return { name: title, colour, symbol: quantity, unit, numbers, y: values.map(number), error: sigmas.map(number) };
}

/** The heading of a chart of series. */
export function titleOf({ points, quantity }, series) {
  if (points.length) return `${quantity.symbol} at ${points.length === 1 ? "the point" : "points"}`;
  return series.length === 1 ? capital(series[0].name) : "Probes";
}

/** Places in the manifest of steps by their numbers; undefined for one that is not there. */
export function placesOf(manifest, numbers) {
  const places = new Map(manifest.steps.map((step, k) => [step.number, k]));
  return numbers.map((number) => places.get(number));
}

/** Loads of steps by their numbers; NaN for an unknown one. */
export function loadsOf(manifest, numbers) {
  return placesOf(manifest, numbers).map((place) => manifest.load?.[1][place] ?? NaN);
}

/** Name of a step by its number. */
export function nameOf(manifest, number) {
  return manifest.steps.find((step) => step.number === number)?.name ?? "first step";
}

/** The series as a table: one row per step, each value with its error. */
export function tableOf(manifest, series) {
  const { numbers } = series[0];
  const loads = manifest.load ? loadsOf(manifest, numbers) : null;
  return {
    columns: [
      "step",
      ...(loads ? [axisText("load", manifest.load[0])] : []),
      ...series.flatMap((one) => [`${one.name} ${axisText(one.symbol, one.unit)}`, `± ${one.name}`]),
    ],
    rows: numbers.map((number, k) => [
      nameOf(manifest, number),
      ...(loads ? [loads[k]] : []),
      ...series.flatMap((one) => [one.y[k], one.error[k]]),
    ]),
  };
}
