// Numbers as a person writes them.

const MINUS = "−";

/** How many decimals show an error with two digits. */
export function decimalsFor(error) {
  return error > 0 && Number.isFinite(error) ? Math.min(12, Math.max(0, 1 - Math.floor(Math.log10(error)))) : 4;
}

/** A number with so many decimals, with a true minus sign. */
export function fixed(value, decimals) {
  if (!Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", MINUS);
}

/** A number with so many digits. */
export function brief(value, digits = 4) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e6 || size < 1e-4 ? value.toExponential(digits - 1) : String(Number(value.toPrecision(digits)));
  return text.replace(/-/g, MINUS);
}

/** A number with as many digits as a narrow field shows. */
export function short(value) {
  const text = brief(value);
  return text.length > 8 ? brief(value, 2) : text;
}

/** A unit as it stands behind a number; empty for a pure number. */
export function unitText(unit) {
  return unit === "1" ? "" : ` ${unit}`;
}

/** A quantity as an axis names it. */
export function axisText(symbol, unit) {
  return `${symbol} [${unit === "1" ? "–" : unit}]`;
}

/** A number that a person typed, with a comma or a point; NaN for anything else. */
export function typed(text) {
  const plain = text.trim().replaceAll(MINUS, "-").replace(",", ".");
  return plain === "" ? NaN : Number(plain);
}

/** Round numbers between two values, about so many, and their texts. */
export function roundTicks(low, high, about) {
  const rough = (high - low) / Math.max(1, about);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough * 0.999) || power;
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) {
    found.push({ value: k * step, text: decimals > 6 ? brief(k * step, 3) : fixed(k * step, decimals) });
  }
  return found;
}

/** A value with its error and unit; digits follow the error, or what the value is rounded to. */
export function withError(value, error, unit, quantum = NaN) {
  if (!Number.isFinite(value)) return "no value";
  const known = Number.isFinite(error) && error > 0;
  const decimals = decimalsFor(known ? error : quantum);
  const number = known || Number.isFinite(quantum) ? fixed(value, decimals) : brief(value, 5);
  return `${number}${known ? ` ± ${fixed(error, decimals)}` : ""}${unitText(unit)}`;
}

/** A text that begins a sentence. */
export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
