// Tables of what was read, to be copied into a spreadsheet or saved.

import { copyText, html, saveFile } from "./page.js";

/** A table: { columns: titles with units, rows: numbers or texts }. */
export function tabbed({ columns, rows }) {
  return [columns, ...rows].map((row) => row.map(cell).join("\t")).join("\n");
}

/** The same as a CSV file with commas. */
export function commaSeparated({ columns, rows }) {
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replace(/"/g, '""')}"` : text);
  return `${[columns, ...rows].map((row) => row.map((value) => quoted(cell(value))).join(",")).join("\r\n")}\r\n`;
}

// A name that a spreadsheet would run as a formula has an apostrophe before it.
function cell(value) {
  if (typeof value === "number") return Number.isFinite(value) ? String(Number(value.toPrecision(7))) : "";
  return /^[=+\-@]/.test(value) ? `'${value}` : value;
}

/** Buttons that copy and save a table. make : gives it; name : of the file */
export function tableButtons(make, name) {
  const copy = html("button", { type: "button", class: "x-quiet", title: "Copy the table, for a spreadsheet" }, "Copy");
  copy.addEventListener("click", async () => {
    await copyText(tabbed(make()));
    copy.textContent = "Copied";
    setTimeout(() => {
      copy.textContent = "Copy";
    }, 1500);
  });
  const save = html("button", { type: "button", class: "x-quiet", title: "Save the table as a file" }, "CSV");
  save.addEventListener("click", () =>
    saveFile(`${name()}.csv`, new Blob(["\ufeff", commaSeparated(make())], { type: "text/csv" })),
  );
  return html("span", { class: "x-buttons" }, copy, save);
}
