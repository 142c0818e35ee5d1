"""The whole way with the mouse on real photographs: a steel part with an opening, and boards of the same rig."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, served
from PIL import Image

from dicflow.io.configuration import read
from dicflow.io.region import read_geojson
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow
STEPS, BOARDS = ("0000", "0005", "0273"), ("00", "02", "05", "07", "09", "12", "14", "16", "18")
REDUCED = 2
"""Each pixel is the mean of so many along each side, which takes a quarter of the time."""
OUTLINE = [(55, 75), (885, 75), (885, 320), (700, 400), (460, 450), (220, 400), (55, 320)]
OPENING = [(235, 93), (685, 93), (650, 150), (575, 195), (460, 225), (345, 195), (270, 150)]
GAUGE = [(460, 260), (460, 420)]
WITHOUT = "09"
EXPLORER = "document.querySelector('.fields').explorer"


@pytest.fixture
def messy(shared_data, tmp_path):
    """Photographs of both cameras in one folder and boards in another, with a copy and a note."""
    source, folder = shared_data / "d_specimen", tmp_path / "Prüfung 3"
    for part, names in (("photos", [f"GT4-{step}" for step in STEPS]), ("boards", BOARDS)):
        (folder / part).mkdir(parents=True)
        for side, camera in (("left", 0), ("right", 1)):
            for name in names:
                taken = f"{name}_{camera}.{'tif' if part == 'photos' else 'jpeg'}"
                with Image.open(source / (f"boards/{side}" if part == "boards" else side) / taken) as photograph:
                    photograph.convert("L").reduce(REDUCED).save(folder / part / taken, quality=95)
    shutil.copyfile(folder / "photos/GT4-0005_0.tif", folder / "photos/GT4-0005_0 (1).tif")
    (folder / "notes.txt").write_text("Load cell: 10 kN\n")
    return folder


def draw(someone, key, places):
    """Draw a polygon with the mouse, and end it by a click on its first corner."""
    someone.page.focus(".viewer")
    someone.page.keyboard.press(key)
    for place in (*places, places[0]):
        someone.click(place)


def set_value(someone, stage, name, text):
    """Change a setting; what would be computed then, as the page says it."""
    page = someone.page
    page.click(f'#sidebar a[href="#settings/{stage}"]')
    page.locator("label.parameter", has_text=name).first.locator("input").fill(text)
    page.keyboard.press("Tab")
    would = page.locator(".would").inner_text()
    page.click("text=Save to the file")
    someone.said(f"saved: {stage}.{name}")
    return would


def point_at(someone, k):
    """Move the mouse to a point of the field."""
    x, y = someone.page.evaluate(f"{EXPLORER}.stage.shownAt({k})")
    box = someone.page.locator(".x-stage").bounding_box()
    someone.page.mouse.move(box["x"] + x - 40, box["y"] + y - 30)
    someone.page.mouse.move(box["x"] + x, box["y"] + y, steps=6)


def test_a_steel_part_from_the_folder_to_the_report(messy):
    with served(messy) as app, opened_page(app) as someone:
        page = someone.page
        page.set_default_timeout(120_000)
        _sort(someone)
        _draw(someone, messy)
        _set_and_run(someone, messy)
        result = Pipeline.load(messy / FILE).result()
        _explore(someone, result)
        _calibrate(someone, app, result)
        _hand_over(someone, messy)


def _sort(someone):
    page = someone.page
    page.wait_for_selector(".series select")
    assert "GT4-0005_0 (1).tif" in page.inner_text("section.folder")
    page.fill("#square", "5 mm")
    assert someone.overlaps() == []
    page.get_by_role("button", name="Make the pipeline file").click()
    page.wait_for_selector("section.region .viewer")


def _draw(someone, folder):
    someone.until("[...document.querySelector('.viewer').viewer.tiles.values()].some((one) => one.naturalWidth)")
    draw(someone, "o", OUTLINE)
    someone.said("saved: outline")
    draw(someone, "h", OPENING)
    someone.said("saved: hole")
    someone.draw_extensometer(GAUGE)
    (polygon,) = read_geojson(folder / "region.geojson").polygons
    pixel = 1.0 / someone.page.evaluate("document.querySelector('.viewer').viewer.scale")
    assert np.abs(polygon.exterior - OUTLINE).max() <= pixel
    assert np.abs(polygon.holes[0] - OPENING).max() <= pixel


def _set_and_run(someone, folder):
    would = set_value(someone, "correlation", "step_size", "21")
    plan = Pipeline.load(folder / FILE).plan().by_stage()
    counts = {stage: sum(found.values()) - found["hit"] for stage, found in plan.items()}
    assert would == ", ".join(f"{stage} {count}" for stage, count in counts.items() if count)
    set_value(someone, "total", "window", "70")
    someone.go("run")
    someone.page.get_by_role("button", name="Start", exact=True).click()
    someone.page.wait_for_selector("h1.state.done")


def _explore(someone, result):
    """The value under the pointer, and the curve of the extensometer, are those of the products."""
    page = someone.page
    someone.go("explore")
    someone.until("document.querySelector('.fields')?.explorer.manifest.steps.length === 2")
    page.evaluate(f"{EXPLORER}.ready.then(() => null)")
    shown, step = page.evaluate(f"[{EXPLORER}.quantity, {EXPLORER}.scene.step]")
    total = result.product("total", result.steps("total")[step])
    values = total[shown["name"]]
    k = int(np.flatnonzero(np.isfinite(values))[np.isfinite(values).sum() // 2])
    point_at(someone, k)
    assert page.evaluate(f"{EXPLORER}.stage.hovered") == k
    read_value = page.evaluate(f"{EXPLORER}.frame.point({k}).value")
    assert abs(read_value - values.ravel()[k]) <= 0.5001 * shown["scale"][1]
    rows = [row for row in ProbeTable.read(result.product("probes")).rows if row["probe"] == "extensometer_1"]
    series = page.evaluate(f"{EXPLORER}.side.curve.content.series.find((one) => one.name.includes('extensometer_1')).y")
    assert series[-2:] == pytest.approx([row["strain"] for row in rows][-2:])
    assert someone.overlaps() == []
    assert someone.axes_without_unit() == []


def _calibrate(someone, app, result):
    """Without a pair the screen shows the numbers of a solution without it."""
    page = someone.page
    someone.go("calibration")
    page.wait_for_selector(".pairs-table")
    rig = CalibratedRig.read(result.product("rig"))
    assert f"of {len(BOARDS)} pairs" in page.inner_text(".verdict")
    name = next(pair["name"] for pair in rig.pairs if WITHOUT in pair["name"])
    page.get_by_label(f"leave out {name}").check()
    page.click("text=Solve again")
    page.wait_for_selector("text=Leave them out of the file")
    assert f"of {len(BOARDS) - 1} pairs" in page.inner_text(".verdict")
    assert someone.overlaps() == []


def _hand_over(someone, folder):
    page = someone.page
    someone.go("hand_over")
    page.locator(".fact:has(.key:text-is('specimen')) textarea").fill("steel part <D>, 2 mm")
    page.keyboard.press("Tab")
    someone.said("saved: report.specimen")
    assert read(folder / FILE).data["report"] == {"specimen": "steel part <D>, 2 mm"}
    page.click("text=Write the report")
    page.wait_for_selector("text=written: results/pipeline/report.html")
    assert "steel part &lt;D&gt;, 2 mm" in (folder / "results/pipeline/report.html").read_text()
