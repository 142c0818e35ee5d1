// Elements from JavaScript. Text is only ever set as text, so that no name from a file becomes markup.

const SVG = "http://www.w3.org/2000/svg";

/** An element: properties and attributes, "on…" as listeners, children as elements or text; null children are left out. */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && name !== "list" && name !== "form") element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** An SVG element with attributes. */
export function s(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

const DRAWN = ["svg", "g", "path", "circle", "rect", "text", "title"];

/** A chart of the server as elements: shapes and texts alone, without anything that acts or loads. */
export function picture(text) {
  const copied = (node) => {
    if (node.nodeType === Node.TEXT_NODE) return node.data;
    if (!DRAWN.includes(node.localName)) return "";
    const facts = [...node.attributes].filter(({ name }) => !/^(on|style|href|xlink)/.test(name));
    return s(node.localName, Object.fromEntries(facts.map(({ name, value }) => [name, value])), ...[...node.childNodes].map(copied));
  };
  return copied(new DOMParser().parseFromString(text.replace("<svg ", `<svg xmlns="${SVG}" `), "image/svg+xml").documentElement);
}

/** Put other children into an element. */
export function fill(element, ...children) {
  element.replaceChildren(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** The same, and the focus stays on what has the name of the one that had it. */
export function refill(element, ...children) {
  const name = (one) => one.getAttribute("aria-label") ?? one.textContent;
  const focused = element.contains(document.activeElement) ? name(document.activeElement) : null;
  fill(element, ...children);
  if (focused !== null) [...element.querySelectorAll("button, select, input, a")].find((one) => name(one) === focused)?.focus();
}

/** A button with words, and perhaps a key that is shown beside them. */
export function button(words, onclick, properties = {}) {
  return h("button", { type: "button", onclick, ...properties }, words);
}

/** What to do where there is nothing yet. */
export function empty(title, words, ...actions) {
  return h("div", { className: "empty" }, h("h2", {}, title), h("p", {}, words), ...actions);
}

/** A time as people say it. */
export function about(seconds) {
  if (seconds < 1) return "less than 1 s";
  if (seconds < 100) return `about ${Math.round(seconds)} s`;
  if (seconds < 5400) return `about ${Math.round(seconds / 60)} min`;
  return `about ${(seconds / 3600).toFixed(1)} h`;
}

/** A size of files. */
export function megabytes(bytes) {
  return bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}
