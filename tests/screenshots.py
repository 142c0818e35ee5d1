"""Make the pictures of docs/engineer.md and docs/programmer.md again: ``python -m tests.screenshots [FOLDER]``.

A strip that is rendered, at rest three times and then stretched, with a cable before one corner at the end; measured, swept,
and looked at in headless Chromium. The pictures go to FOLDER, default ``docs/pictures``.
"""

from __future__ import annotations

import base64
import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from PIL import Image

from dicflow.io.calibrations.opencv import opencv_text
from dicflow.pipeline import Pipeline
from dicflow.report.build import write_report
from dicflow.synth.experiment import Experiment, sample_experiment
from dicflow.synth.folder import Photograph, photographs, take
from dicflow.synth.truth import region_outline
from dicflow.io.region import write_geojson
from dicflow.core.photographs.polygon import Polygon
from tests.browser import Page, opened

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
WIDTH, HEIGHT = 1100, 720
PAPER = (794, 1123)
"""A4 at 96 px per inch."""
STEPS = (0, 0, 0, 1, 2)
"""Steps of the sample that are photographed: at rest three times, then stretched."""
COLOURS = 96
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
    """Box of an element in the page, grown by a margin."""
    found = page.evaluate(
        f"(({{ x, y, width, height }}) => ({{ x: x + scrollX, y: y + scrollY, width, height }}))"
        f"(({script}).getBoundingClientRect())"
    )
    return {key: float(value) for key, value in found.items()}


def shot(page: Page, path: Path, box: dict[str, float] | None = None) -> None:
    """Write the window, or a part of the page, as a small PNG."""
    clip: dict[str, Any] = {} if box is None else {"clip": {**box, "scale": 1}, "captureBeyondViewport": True}
    content = base64.b64decode(page.send("Page.captureScreenshot", **clip)["data"])
    picture = Image.open(io.BytesIO(content)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def gap(page: Page, report: Path, folder: Path) -> None:
    """The reason of a gap under the pointer."""
    page.open(report)
    page.window(WIDTH, HEIGHT)
    page.explorer()
    press(page, "Gaps")
    lost = page.evaluate(
        "(() => { const { explorer } = document.querySelector('.explorer'); const { frame } = explorer;"
        "const k = [...frame.status].findIndex((code, k) => code > 2 && frame.place(k)[0] > 0);"
        "return k; })()"
    )
    print("lost point", lost)
    shot(page, folder / "engineer_gap.png")


@contextmanager
def on_paper(page: Page) -> Iterator[None]:
    """The page as it is printed on A4."""
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.window(*PAPER)
    page.send("Emulation.setEmulatedMedia", media="print")
    yield
    page.send("Emulation.setEmulatedMedia", media="")
    page.evaluate("dispatchEvent(new Event('afterprint'))")


def main(arguments: list[str]) -> int:
    """Make all pictures."""
    folder = Path(arguments[0]) if arguments else PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as made, TemporaryDirectory() as profile, opened(Path(profile)) as page:
        file = write_test(Path(made))
        report, swept = measured(file), measured(file, SWEEP)
        gap(page, report, folder)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
