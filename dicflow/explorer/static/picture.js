// The picture of an explorer as one canvas: photograph, field, bar of colours with numbers and units.

import { shortTitle } from "./controls.js";
import { axisText, roundTicks } from "./numbers.js";
import { html } from "./page.js";

const MARGIN = 24,
  BAR = 14,
  FOOT = 92;

/** A canvas with what the stage shows, on white. */
export function pictureOf({ stage, quantity, range, palette, manifest, scene }) {
  const [width, height] = stage.size;
  const ratio = stage.canvas.width / width;
  const canvas = html("canvas", { width: Math.round(width * ratio), height: Math.round((height + FOOT) * ratio) });
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.fillStyle = "#ffffff";
  context.fillRect(0, 0, width, height + FOOT);
  context.save();
  context.beginPath();
  context.rect(0, 0, width, height);
  context.clip();
  const crop = manifest.crops[scene.camera];
  if (!stage.photo.hidden && crop) {
    const [x, y] = stage.window.toPicture(crop.origin[0] - 0.5, crop.origin[1] - 0.5);
    context.drawImage(stage.photo, x, y, crop.size[0] * stage.window.scale, crop.size[1] * stage.window.scale);
  }
  context.drawImage(stage.canvas, 0, 0, width, height);
  context.restore();
  const long = Math.min(520, width - 2 * MARGIN);
  const left = (width - long) / 2;
  const top = height + 40;
  for (let k = 0; k < 256; k++) {
    context.fillStyle = `rgb(${palette[3 * k]}, ${palette[3 * k + 1]}, ${palette[3 * k + 2]})`;
    context.fillRect(left + (k * long) / 256, top, long / 256 + 0.6, BAR);
  }
  context.fillStyle = "#1b1f24";
  context.textAlign = "center";
  context.font = "600 13px system-ui, sans-serif";
  context.fillText(
    `${axisText(`${shortTitle(quantity.title, quantity.symbol)} ${quantity.symbol}`, quantity.unit)} · ${manifest.steps[scene.step].name}`,
    width / 2,
    height + 26,
    width - 2 * MARGIN,
  );
  context.font = "12px system-ui, sans-serif";
  for (const { value, text } of roundTicks(...range, 5)) {
    context.fillText(text, left + ((value - range[0]) / (range[1] - range[0])) * long, top + BAR + 18);
  }
  return canvas;
}
