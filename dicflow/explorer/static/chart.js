// Line charts: axes with units, bands of uncertainty, the step that is shown, and the value under the pointer.

import { roundTicks } from "./numbers.js";
import { html, svg } from "./page.js";

const LEAST_LEFT = 62,
  NAME = 36,
  LETTER = 7,
  RIGHT = 14,
  TOP = 12,
  BOTTOM = 40;

/** A chart that fills an element. pick : called with the series and number of the point that was clicked, if given */
export class Chart {
  constructor(element, pick) {
    Object.assign(this, { element, pick, content: null });
    element.classList.add("x-chart");
    this.drawing = svg("svg", { role: "img" });
    this.tip = html("div", { class: "x-tip", role: "status", hidden: true });
    element.append(this.drawing, this.tip);
    this.drawing.addEventListener("pointermove", (event) => this.point(event));
    this.drawing.addEventListener("pointerleave", () => this.point(null));
    this.drawing.addEventListener("click", (event) => this.click(event));
    new ResizeObserver(() => this.draw()).observe(element);
  }

  /** Shows series: { name, colour, x, y, error (half the band, or null), dashed }, NaN is a gap. */
  show(content) {
    this.content = content;
    this.draw();
  }

  draw() {
    const [width, height] = [this.element.clientWidth, this.element.clientHeight];
    if (!this.content || width < 40 || height < 40) return;
    const { series, xAxis, yAxis, mark, label } = this.content;
    this.drawing.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.drawing.setAttribute("aria-label", label);
    const x = span(
      series.flatMap((one) => [...one.x]),
      0,
    );
    const y = span(
      series.flatMap((one) => [...one.y].flatMap((value, k) => band(one, value, k))),
      0.06,
    );
    const ticks = twoTicks(y[0], y[1], (height - TOP - BOTTOM) / 44);
    const left = Math.max(LEAST_LEFT, NAME + LETTER * Math.max(...ticks.map(({ text }) => text.length)));
    const toX = (value) => left + ((value - x[0]) / (x[1] - x[0])) * (width - left - RIGHT);
    const toY = (value) => height - BOTTOM - ((value - y[0]) / (y[1] - y[0])) * (height - TOP - BOTTOM);
    this.scale = { toX, toY, left, width, height };
    const parts = [...axes(x, ticks, this.scale, xAxis, yAxis)];
    if (mark !== null && mark >= x[0] && mark <= x[1]) {
      parts.push(svg("line", { class: "x-mark", x1: toX(mark), x2: toX(mark), y1: TOP, y2: height - BOTTOM }));
    }
    for (const one of series) parts.push(...curve(one, toX, toY));
    if (!series.some((one) => [...one.y].some(Number.isFinite))) {
      parts.push(svg("text", { x: width / 2, y: height / 2, "text-anchor": "middle" }, "no value here"));
    }
    this.focus = svg("g", {});
    this.drawing.replaceChildren(...parts, this.focus);
  }

  /** The series and number of the drawn point nearest to the pointer. */
  nearest(event) {
    if (!this.content || !this.scale) return null;
    const box = this.drawing.getBoundingClientRect();
    const [px, py] = [event.clientX - box.left, event.clientY - box.top];
    let [best, least] = [null, 40 * 40];
    for (const series of this.content.series) {
      for (let k = 0; k < series.x.length; k++) {
        const [dx, dy] = [this.scale.toX(series.x[k]) - px, (this.scale.toY(series.y[k]) - py) * 0.5];
        if (dx * dx + dy * dy < least) [best, least] = [{ series, k }, dx * dx + dy * dy];
      }
    }
    return best;
  }

  point(event) {
    const found = event && this.nearest(event);
    this.tip.hidden = !found;
    this.focus?.replaceChildren();
    if (!found) return;
    const { series, k } = found;
    const [x, y] = [this.scale.toX(series.x[k]), this.scale.toY(series.y[k])];
    this.focus.append(svg("circle", { cx: x, cy: y, r: 5, fill: "none", stroke: series.colour, "stroke-width": 2 }));
    this.tip.textContent = this.content.text(series, k);
    this.tip.style.left = `${Math.min(Math.max(x, this.tip.offsetWidth / 2 + 4), this.scale.width - this.tip.offsetWidth / 2 - 4)}px`;
    this.tip.style.top = `${y < 60 ? y + 14 : y - this.tip.offsetHeight - 10}px`;
  }

  click(event) {
    const found = this.nearest(event);
    if (found && this.pick) this.pick(found.series, found.k);
  }
}

// At least two, since one number gives no scale.
function twoTicks(low, high, about) {
  const found = roundTicks(low, high, about);
  return found.length > 1 ? found : roundTicks(low, high, 2 * about);
}

function band(series, value, k) {
  const half = series.error && Number.isFinite(series.error[k]) ? series.error[k] : 0;
  return [value - half, value + half];
}

function span(values, margin) {
  const known = values.filter(Number.isFinite);
  if (!known.length) return [0, 1];
  let [low, high] = [Math.min(...known), Math.max(...known)];
  if (high - low < 1e-12 * Math.max(1, Math.abs(high)))
    [low, high] = [low - 0.5 * (Math.abs(low) || 1), high + 0.5 * (Math.abs(high) || 1)];
  return [low - margin * (high - low), high + margin * (high - low)];
}

function* axes(x, ticks, { toX, toY, left, width, height }, xAxis, yAxis) {
  for (const { value, text } of ticks) {
    yield svg("line", { class: "x-rule", x1: left, x2: width - RIGHT, y1: toY(value), y2: toY(value) });
    yield svg("text", { x: left - 8, y: toY(value) + 4, "text-anchor": "end" }, text);
  }
  const about = (width - left - RIGHT) / 70;
  for (const { value, text } of roundTicks(x[0], x[1], xAxis.whole ? Math.min(about, x[1] - x[0]) : about)) {
    if (xAxis.whole && value !== Math.round(value)) continue;
    yield svg("line", {
      class: "x-tick",
      x1: toX(value),
      x2: toX(value),
      y1: height - BOTTOM,
      y2: height - BOTTOM + 4,
    });
    yield svg("text", { x: toX(value), y: height - BOTTOM + 17, "text-anchor": "middle" }, text);
  }
  yield svg("line", { class: "x-axis", x1: left, x2: width - RIGHT, y1: height - BOTTOM, y2: height - BOTTOM });
  yield svg(
    "text",
    { class: "x-name", x: (left + width - RIGHT) / 2, y: height - 5, "text-anchor": "middle" },
    xAxis.text,
  );
  const middle = (TOP + height - BOTTOM) / 2;
  yield svg(
    "text",
    { class: "x-name", x: 13, y: middle, "text-anchor": "middle", transform: `rotate(-90 13 ${middle})` },
    yAxis.text,
  );
}

// A band would cross itself where the curve comes back.
function* bars(series, points, toX, toY) {
  for (const k of points) {
    const [low, high] = band(series, series.y[k], k);
    if (high > low) yield svg("line", { x1: toX(series.x[k]), x2: toX(series.x[k]), y1: toY(low), y2: toY(high), stroke: series.colour, class: "x-error" });
  }
}

function* curve(series, toX, toY) {
  const runs = [];
  for (let k = 0; k < series.x.length; k++) {
    if (!Number.isFinite(series.y[k]) || !Number.isFinite(series.x[k])) continue;
    if (k && runs.length && runs.at(-1).at(-1) === k - 1) runs.at(-1).push(k);
    else runs.push([k]);
  }
  const isRising = runs.flat().every((k, place, all) => !place || series.x[k] >= series.x[all[place - 1]]);
  if (series.error && !isRising) yield* bars(series, runs.flat(), toX, toY);
  for (const run of runs) {
    if (series.error && isRising && run.length > 1) {
      const upper = run.map((k) => `${toX(series.x[k])},${toY(band(series, series.y[k], k)[1])}`);
      const lower = run.map((k) => `${toX(series.x[k])},${toY(band(series, series.y[k], k)[0])}`).reverse();
      yield svg("polygon", { points: [...upper, ...lower].join(" "), fill: series.colour, class: "x-band" });
    }
    const line = run.map((k) => `${toX(series.x[k]).toFixed(1)},${toY(series.y[k]).toFixed(1)}`).join(" ");
    yield svg("polyline", {
      points: line,
      fill: "none",
      stroke: series.colour,
      "stroke-width": 2,
      "stroke-linejoin": "round",
      ...(series.dashed ? { "stroke-dasharray": "5 4" } : {}),
    });
  }
  if (series.x.length <= 60) {
    for (const k of runs.flat())
      yield svg("circle", { cx: toX(series.x[k]), cy: toY(series.y[k]), r: 3, fill: series.colour });
  }
}
