// A second, small picture: the surface in space beside its depth in the photograph.

import { Frame } from "./frame.js";
import { html } from "./page.js";
import { Stage } from "./stage.js";

/** The surface of an explorer, which follows its quantity, step, colours and chosen points. */
export class SurfaceView {
  constructor(explorer) {
    this.explorer = explorer;
    this.frame = null;
    this.manifest = explorer.manifest;
    this.stage = new Stage(this);
    this.stage.element.setAttribute("aria-label", "surface in space");
    this.element = html(
      "section",
      { class: "x-block" },
      html("div", { class: "x-block-head" }, html("h3", {}, "Surface")),
      this.stage.element,
    );
  }

  get scene() {
    return { ...this.explorer.scene, camera: "space", reasons: false };
  }

  get range() {
    return this.explorer.range;
  }

  get palette() {
    return this.explorer.palette;
  }

  get marks() {
    return this.explorer.marks;
  }

  get photograph() {
    return "";
  }

  reading(k) {
    return this.explorer.readingOf(this.frame, k);
  }

  hovered(k) {
    this.explorer.legend.point(k < 0 ? NaN : this.frame.point(k).value);
  }

  pick(k) {
    return this.explorer.pick(k);
  }

  line() {}

  moved() {}

  /** Shows the step of the explorer; hidden while its large picture is the surface. */
  async show() {
    this.element.hidden = this.explorer.scene.camera === "space";
    this.frame = await Frame.load(this.explorer.fields, this.scene);
    this.stage.draw();
  }
}
