// What is folded away on the screen is open on paper.
(() => {
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
