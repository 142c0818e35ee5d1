(() => {
  const data = document.getElementById("fields-data");
  if (!data) return;
  const { steps, start, quantities, size, reference, colours } = JSON.parse(data.textContent);
  const viewer = document.querySelector(".viewer");
  const at = (name) => viewer.querySelector(name);
  const [photo, overlay, directions] = [at(".photo"), at(".overlay"), at(".directions")];
  const [select, slider, opacity, lines] = [at(".quantity"), at(".step"), at(".opacity"), at(".lines")];

  const source = (kind, text) => `data:image/${kind};base64,${text}`;
  const show = (element, visible) => element.toggleAttribute("hidden", !visible);

  function put(image, kind, text) {
    show(image, Boolean(text));
    if (text) image.src = source(kind, text);
  }

  function row(label, count, whole) {
    const cells = [document.createElement("th"), document.createElement("td"), document.createElement("td")];
    const mark = document.createElement("span");
    mark.className = "mark";
    mark.style.background = colours[label] || "transparent";
    cells[0].append(mark, label);
    cells[1].textContent = count;
    cells[2].textContent = `${((100 * count) / whole).toFixed(1)} %`;
    const line = document.createElement("tr");
    line.append(...cells);
    return line;
  }

  function count(counts) {
    const whole = Object.values(counts).reduce((sum, one) => sum + one, 0);
    at(".reasons tbody").replaceChildren(...Object.entries(counts).map(([label, one]) => row(label, one, whole)));
  }

  function draw() {
    const step = steps[slider.value];
    const quantity = quantities[select.value];
    const shown = at("input[name=shown]:checked").value;
    const reasons = shown === "reasons";
    const maps = step.maps;
    at(".map-title").textContent = reasons ? "Reasons for missing points" : quantity.label;
    at(".map-step").textContent = step.name;
    at(".step-name").textContent = step.name;
    slider.setAttribute("aria-valuetext", step.name);
    show(at(".nothing"), !maps);
    put(photo, "jpeg", maps && (shown === "deformed" ? maps.photo : reference));
    put(overlay, "png", maps && (reasons ? maps.reasons : maps[shown][quantity.name]));
    overlay.style.opacity = reasons ? 1 : opacity.value;
    at(".stack").classList.toggle("pale", reasons);
    show(at(".colour-bar"), !reasons);
    at(".colour-bar").innerHTML = quantity.bar;
    const path = maps && maps.directions && maps.directions[shown];
    show(directions, Boolean(path && lines && lines.checked));
    if (path) directions.firstElementChild.setAttribute("d", path);
    count(maps ? maps.counts : {});
    const file = quantity.files[step.name];
    show(at(".full"), file && !reasons);
    if (file) at(".full a").href = file;
    show(at(".full-map"), quantity.full && !reasons);
    if (quantity.full) at(".full-map img").src = source("png", quantity.full);
  }

  function shape(stack) {
    stack.style.aspectRatio = `${size[0]} / ${size[1]}`;
    stack.style.setProperty("--aspect", size[0] / size[1]);
  }

  // paper has no slider: the first, the shown and the last step stand side by side
  function sheet() {
    const quantity = quantities[select.value];
    const chosen = [...new Set([0, Number(slider.value), steps.length - 1])].filter((number) => steps[number].maps);
    const figures = chosen.map((number) => {
      const figure = document.createElement("figure");
      const stack = document.createElement("div");
      const caption = document.createElement("figcaption");
      stack.className = "stack";
      shape(stack);
      for (const [kind, text] of [["jpeg", steps[number].maps.photo], ["png", steps[number].maps.deformed[quantity.name]]]) {
        if (!text) continue;
        const image = document.createElement("img");
        image.src = source(kind, text);
        stack.append(image);
      }
      caption.textContent = steps[number].name;
      figure.append(caption, stack);
      return figure;
    });
    document.querySelector(".sheet").replaceChildren(...figures);
  }

  quantities.forEach((quantity, number) => select.add(new Option(quantity.label, number)));
  slider.max = steps.length - 1;
  slider.value = start;
  shape(at(".stack"));
  directions.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
  viewer.addEventListener("input", draw);
  window.addEventListener("beforeprint", sheet);
  show(viewer, true);
  draw();
})();
