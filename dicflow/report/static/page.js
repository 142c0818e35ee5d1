// Printed is what a reader needs first; with "?appendix" behind the address all of it, also what is folded away.
(() => {
  if (!new URLSearchParams(location.search).has("appendix")) return;
  document.documentElement.dataset.appendix = "";
  const folded = () => document.querySelectorAll("details:not([open])");
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = [...folded()];
    opened.forEach((part) => { part.open = true; });
  });
  addEventListener("afterprint", () => {
    opened.forEach((part) => { part.open = false; });
    opened = [];
  });
})();

// A link to a section that is folded away unfolds it.
(() => {
  const unfold = () => document.getElementById(location.hash.slice(1))?.querySelector(":scope > details.folded")?.setAttribute("open", "");
  addEventListener("hashchange", unfold);
  unfold();
})();

// A button that copies a part of the page as text, its lists with their numbers; without a clipboard it selects the part.
(() => {
  const copiedByCommand = (text) => {
    const area = document.body.appendChild(document.createElement("textarea"));
    area.value = text;
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    return done;
  };
  const copied = (text) => (navigator.clipboard ? navigator.clipboard.writeText(text).then(() => true) : Promise.reject())
    .catch(() => copiedByCommand(text));
  const line = (part) => (part.tagName === "LI" ? `[${part.value}] ` : "") + part.textContent.trim();
  for (const button of document.querySelectorAll("button[data-copies]")) {
    const part = document.getElementById(button.dataset.copies);
    const status = button.nextElementSibling;
    button.hidden = false;
    button.addEventListener("click", async () => {
      const text = [...part.querySelectorAll("p, li")].map(line).join("\n");
      const done = await copied(text);
      if (!done) getSelection().selectAllChildren(part);
      status.textContent = done ? "copied" : "selected: copy it with Ctrl+C";
    });
  }
})();

// Tables whose rows are sorted by a press on the title of a column; unknown cells come last in either direction.
(() => {
  const key = (row, column) => row.cells[column].dataset.key;
  const order = (a, b) => (isNaN(a) || isNaN(b) ? a.localeCompare(b, undefined, { numeric: true }) : a - b);
  const sort = (table, column, sign) => {
    const rows = [...table.tBodies[0].rows];
    rows.sort((one, other) => {
      const [a, b] = [key(one, column), key(other, column)];
      return (a === "") - (b === "") || sign * order(a, b);
    });
    table.tBodies[0].append(...rows);
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const titles = [...table.tHead.rows[0].cells];
    titles.forEach((title, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = title.textContent;
      title.replaceChildren(button);
      button.addEventListener("click", () => {
        const rises = title.getAttribute("aria-sort") !== "ascending";
        titles.forEach((other) => other.removeAttribute("aria-sort"));
        title.setAttribute("aria-sort", rises ? "ascending" : "descending");
        sort(table, column, rises ? 1 : -1);
      });
    });
  }
})();

// A switch between the colours for day and night; without it they are those that the reader's system prefers.
(() => {
  const root = document.documentElement;
  const dark = () => (root.style.colorScheme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const button = document.createElement("button");
  const show = () => { button.textContent = dark() ? "Light" : "Dark"; };
  button.type = "button";
  button.title = "Change between light and dark";
  button.addEventListener("click", () => { root.style.colorScheme = dark() ? "light" : "dark"; show(); });
  show();
  document.querySelector("nav").append(button);
})();
