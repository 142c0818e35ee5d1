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

let labels = 0;

/** A name for an element that another one refers to. */
export function freshId(what) {
  labels += 1;
  return `explorer-${what}-${labels}`;
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
