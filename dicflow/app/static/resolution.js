// Noise against resolution of the variants of a sweep, as the report draws it.

import { ask } from "./api.js";
import { fill, h, picture } from "./dom.js";

/** A card with the chart and its numbers, which comes once it is known; nothing for a pipeline without a sweep. */
export function resolutionCard(app) {
  const place = h("div", {});
  ask("resolution", { file: app.file }).then((found) => found && draw(place, found), (error) => fill(place, h("p", { className: "problem" }, error.message)));
  return place;
}

function draw(place, { chart, unit, measured, variants }) {
  const symbols = [...new Set(variants.flatMap((one) => Object.keys(one.sigma)))];
  fill(place, h("div", { className: "card" }, h("h2", {}, "Noise against resolution"),
    h("p", { className: "faint" }, symbols.length
      ? `A variant lower on the left sees finer detail with less noise. σ is ${measured ? "measured where nothing deforms" : "predicted from the noise of the photographs"}.`
      : "Known once the variants are measured."),
    chart ? h("div", { className: "chart-place" }, picture(chart)) : null,
    symbols.length ? h("div", { className: "scroll" }, table(unit, symbols, variants)) : null));
}

function table(unit, symbols, variants) {
  const number = (words) => h("td", { className: "number" }, words);
  const side = (value) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(3))));
  const head = ["variant", `virtual strain gauge [${unit}]`, ...symbols.map((one) => `σ of ${one} [–]`)];
  return h("table", { className: "variants" },
    h("thead", {}, h("tr", {}, head.map((words, k) => h("th", { className: k ? "number" : "" }, words)))),
    h("tbody", {}, variants.map((one, k) => h("tr", {}, h("td", {}, h("a", { href: `#explore/${k}`, title: "see its fields" }, one.name)), number(side(one.side)), symbols.map((symbol) => number(one.sigma[symbol]?.toPrecision(3) ?? "–"))))));
}
