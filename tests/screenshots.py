"""Make the pictures of docs/engineer.md and docs/programmer.md again: ``python -m tests.screenshots [FOLDER]``.

A strip is rendered, at rest three times and then stretched, with a cable before one corner at the end. It is measured,
swept, and looked at in headless Chromium. The pictures go to FOLDER, default ``docs/pictures``.
"""

from __future__ import annotations

import base64
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from dicflow.core.photographs.polygon import Polygon
from dicflow.io.calibrations.opencv import opencv_text
from dicflow.io.region import write_geojson
from dicflow.pipeline import Pipeline
from dicflow.report.build import write_report
from dicflow.synth.experiment import Experiment, sample_experiment
from dicflow.synth.folder import Photograph, photographs, take
from dicflow.synth.truth import region_outline
from tests.browser import Page, opened
from tests.small_pictures import keep

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
WIDTH, HEIGHT = 1100, 900
PAPER = (794, 1123)
"""A4 at 96 px per inch."""
STEPS = (0, 0, 0, 1, 2)
"""Steps of the sample that are photographed: at rest three times, then stretched."""
LOST = """
(async () => {
  const { explorer } = document.querySelector(".explorer");
  await explorer.ready;
  const { frame, stage, manifest } = explorer;
  const unknown = manifest.reasons.filter(({ code, label }) => code > 1 && label !== "outside").map(({ code }) => code);
  const lost = [...frame.status.keys()].filter((k) => unknown.includes(frame.status[k]));
  const [x, y] = stage.window.toPicture(...frame.firstOf(lost[lost.length >> 1]));
  const box = stage.element.getBoundingClientRect();
  return [box.x + x, box.y + y];
})()
"""
"""Place of a lost point in the window."""
AT_REST = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 300))))"
"""Until the page is laid out for another window."""
PIPELINE = """\
dicflow: 1
title: Latex strip, tension
stages:
  photos: {stage: images, left: "photos/left/*.png", right: "photos/right/*.png"}
  rig: {stage: rig_file, file: rig.yaml}
  region: {stage: region, images: photos, file: region.geojson}
  correlation: {stage: correlate, images: photos, subset_size: 21, step_size: 5}
  stereo: {stage: stereo, images: photos}
  points: {stage: triangulate}
  total: {stage: deformation, points: points, window: 40 px}
  probes: {stage: probes, extensometers: {length: [[362, 150], [362, 440]]}}
  maps: {stage: maps}
report: {specimen: "latex strip, 20 × 60 mm", operator: A. Engineer, lens: 25 mm, light: two LED panels}
"""
SWEEP = "sweep:\n  grid: {total.window: [25 px, 40 px, 60 px, 90 px], correlation.subset_size: [15, 21, 31]}\n"


def experiment() -> Experiment:
    """The sample with its first step three times."""
    sample = sample_experiment(boards=1)
    return sample._replace(deformations=tuple(sample.deformations[step] for step in STEPS))


def write_test(folder: Path) -> Path:
    """Photographs, rig, region and pipeline file; returns that file."""
    made = experiment()
    for picture in photographs(made):
        if picture.subject == "strip":
            path = folder / picture.name
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), _with_cable(take(made, picture), picture, made))
    (folder / "rig.yaml").write_text(opencv_text(made.stand.rig), encoding="utf-8")
    write_geojson(folder / "region.geojson", [Polygon(region_outline(made))])
    file = folder / "pipeline.yaml"
    file.write_text(PIPELINE, encoding="utf-8")
    return file


def _with_cable(image: np.ndarray, picture: Photograph, made: Experiment) -> np.ndarray:
    """At the last step a cable hangs before the lower right corner."""
    if picture.number < len(made.deformations) - 1:
        return image
    height, width = image.shape
    ends = [(round(width * x), round(height * y)) for x, y in ((0.52, 0.62), (0.63, 0.48))]
    return cv2.line(image.copy(), *ends, 70, round(0.02 * width), cv2.LINE_AA)


def measured(file: Path, text: str = "") -> Path:
    """Run a pipeline file, with some lines more, and return its report."""
    path = file.with_name(f"{'swept' if text else 'strip'}.yaml")
    path.write_text(file.read_text(encoding="utf-8") + text, encoding="utf-8")
    pipeline = Pipeline.load(path)
    result = pipeline.run(workers=1, scheduler="sync")
    if not text:
        (file.parent / "view.html").write_text(result.view().html, encoding="utf-8")
    return write_report(pipeline, result, file.parent / path.stem)


def point_at(page: Page, x: float, y: float) -> None:
    """Move the pointer to a place of the window."""
    page.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)


def press(page: Page, text: str) -> None:
    """Press the button with a text."""
    page.evaluate(f"[...document.querySelectorAll('button')].find((one) => one.textContent === {text!r}).click()")


def box_of(page: Page, script: str) -> dict[str, float]:
    """Box of an element in the window. script : gives the element"""
    return dict(
        page.evaluate(
            "(({ x, y, width, height }) => ({ x: x - 8, y: y - 8, width: width + 16, height: height + 12 }))"
            f"(({script}).getBoundingClientRect())"
        )
    )


def shot(page: Page, path: Path, box: dict[str, float] | None = None) -> None:
    """Write the window, or a part of it, as a small PNG."""
    clip: dict[str, Any] = {} if box is None else {"clip": {**box, "scale": 1}}
    keep(base64.b64decode(page.send("Page.captureScreenshot", **clip)["data"]), path)


def gap(page: Page, report: Path, path: Path) -> None:
    """The reasons of the gaps, and the one under the pointer: a point whose subset the cable hides."""
    page.open(report)
    page.window(WIDTH, HEIGHT)
    page.explorer()
    press(page, "Undeformed")
    press(page, "Gaps")
    page.evaluate("document.querySelector('.verdict').scrollIntoView()")
    point_at(page, *page.evaluate(LOST))
    shot(page, path)


def section(page: Page, report: Path, title: str, parts: int, path: Path) -> None:
    """A title of the report with some elements below it, in a window that holds the whole page."""
    page.open(report)
    page.window(WIDTH, HEIGHT)
    page.explorer()
    page.window(WIDTH, HEIGHT + int(page.evaluate("document.documentElement.scrollHeight")))
    page.evaluate(AT_REST)
    start = f"[...document.querySelectorAll('h3')].find((one) => one.textContent === {title!r})"
    end = f"({start}){'.nextElementSibling' * parts}"
    first, last = box_of(page, start), box_of(page, end)
    shot(page, path, {**last, "y": first["y"], "height": last["y"] + last["height"] - first["y"]})


def paper(page: Page, report: Path, path: Path) -> None:
    """The first sheet as it is printed on A4."""
    page.open(report)
    page.window(WIDTH, HEIGHT)
    page.explorer()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.send("Emulation.setScrollbarsHidden", hidden=True)
    page.send("Emulation.setEmulatedMedia", media="print")
    page.window(*PAPER)
    page.send("Emulation.setEmulatedMedia", media="print")
    shot(page, path, {"x": 0.0, "y": 0.0, "width": PAPER[0], "height": PAPER[1]})
    page.send("Emulation.setEmulatedMedia", media="")
    page.send("Emulation.setScrollbarsHidden", hidden=False)


def view(page: Page, html: Path, path: Path) -> None:
    """What a notebook shows below ``result.view()``."""
    page.open(html)
    page.window(WIDTH, HEIGHT)
    page.explorer()
    shot(page, path)


def main(arguments: list[str]) -> int:
    """Make all pictures."""
    folder = Path(arguments[0]) if arguments else PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as made, TemporaryDirectory() as profile, opened(Path(profile)) as page:
        file = write_test(Path(made))
        report, swept = measured(file), measured(file, SWEEP)
        gap(page, report, folder / "engineer_gap.png")
        section(page, report, "Scatter at rest", 2, folder / "engineer_rest.png")
        paper(page, report, folder / "engineer_page.png")
        view(page, file.with_name("view.html"), folder / "programmer_view.png")
        section(page, swept, "Noise against resolution", 1, folder / "programmer_sweep.png")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
