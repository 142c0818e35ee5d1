// Elements of the page.

/** An HTML element. facts : properties; "class", "data-…", "aria-…", "role" and "for" are attributes, on… are listeners */
export function html(tag, facts = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(facts)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (/^(class|for|role|data-|aria-)/.test(name)) made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children);
  return made;
}

/** An SVG element with attributes. */
export function svg(tag, facts = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(facts)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

const ICONS = {
  whole: "M2 6V2h4M10 2h4v4M14 10v4h-4M6 14H2v-4",
  save: "M8 2v8M4.5 7L8 10.5 11.5 7M2.5 13.5h11",
  screen: "M9.5 2H14v4.5M14 2L9.5 6.5M6.5 14H2V9.5M2 14l4.5-4.5",
  play: "M4.5 2.5v11l9-5.5z",
  pause: "M5 2.5v11M11 2.5v11",
};

/** A sign of a button. */
export function icon(name) {
  return svg(
    "svg",
    { viewBox: "0 0 16 16", class: `x-sign x-sign-${name}`, "aria-hidden": "true" },
    svg("path", { d: ICONS[name] }),
  );
}

/** A group of buttons of which one is pressed. choices : { value: label }; change : called with the value */
export function choice(label, choices, value, change) {
  const group = html("div", { class: "x-choice", role: "group", "aria-label": label });
  const show = (chosen) => {
    for (const button of group.children) button.setAttribute("aria-pressed", String(button.dataset.value === chosen));
  };
  for (const [name, text] of Object.entries(choices)) {
    group.append(html("button", { type: "button", "data-value": name, onclick: () => change(name) }, text));
  }
  show(value);
  return { element: group, show };
}

/** Copies text, also where the browser has no clipboard for pages from a disk. */
export async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = html("textarea", { value: text, class: "x-unseen" });
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}

/** Offers a file to be saved. */
export function saveFile(name, blob) {
  const link = html("a", { href: URL.createObjectURL(blob), download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
