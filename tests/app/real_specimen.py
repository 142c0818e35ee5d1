"""The whole way with the mouse on real photographs: ``python -m tests.app.real_specimen [FOLDER]``.

A steel part with an opening and boards of the same rig, from ``d_specimen`` of the real photographs, lie unsorted in a
folder. A person in headless Chromium goes from there to the report. What the screens show is compared with the
products; a line is printed for each thing that was found equal. Pictures of the screens go to FOLDER, default
``build/app``.
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from app_browser import PICTURES, Person, close_browser, opened_page
from app_serving import FILE, Served, served

from dicflow.io.configuration import read
from dicflow.io.region import read_geojson
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline, Result
from tests.data_folder import SHARED

STEPS, BOARDS = ("0000", "0005", "0273"), ("00", "02", "05", "07", "09", "12", "14", "16", "18")
OUTLINE = [(110, 150), (1770, 150), (1770, 640), (1400, 800), (920, 900), (440, 800), (110, 640)]
OPENING = [(470, 185), (1370, 185), (1300, 300), (1150, 390), (920, 450), (690, 390), (540, 300)]
MOVED = (1740, 170)
"""Where the second corner of the outline is dragged."""
GAUGE = [(920, 520), (920, 840)]
LEFT_OUT = "09"
EXPLORER = "document.querySelector('.fields').explorer"
ONE, OTHER = (f"document.querySelector('.pair .fields.side{side}').explorer" for side in (0, 1))
_PATIENCE_MS = 600_000


def unsorted(folder: Path) -> Path:
    """Photographs of both cameras in one folder and boards in another, with a copy and a note."""
    source = SHARED / "d_specimen"
    for part, names in (("photos", [f"GT4-{step}" for step in STEPS]), ("boards", BOARDS)):
        (folder / part).mkdir(parents=True)
        for side, camera in (("left", 0), ("right", 1)):
            for name in names:
                taken = f"{name}_{camera}.{'tif' if part == 'photos' else 'jpeg'}"
                shutil.copyfile(source / ("boards" if part == "boards" else ".") / side / taken, folder / part / taken)
    shutil.copyfile(folder / "photos/GT4-0005_0.tif", folder / "photos/GT4-0005_0 (1).tif")
    (folder / "notes.txt").write_text("Load cell: 10 kN\n")
    return folder


def way(folder: Path, pictures: Path) -> None:
    """From the unsorted folder to the report; AssertionError where a screen shows something else than the products."""
    with served(folder) as app, opened_page(app) as someone:
        someone.page.set_default_timeout(_PATIENCE_MS)
        _sort(someone, pictures)
        _draw(someone, folder, pictures)
        _set(someone, folder)
        _run(someone, app, pictures)
        result = Pipeline.load(folder / FILE).result()
        _explore(someone, result, pictures)
        _calibrate(someone, app, pictures)
        _compare(someone, folder, pictures)
        _hand_over(someone, folder, pictures)


def _sort(someone: Person, pictures: Path) -> None:
    page = someone.page
    page.wait_for_selector(".series select")
    page.wait_for_selector(".narrow")
    assert "Copies of others, left out: photos/GT4-0005_0 (1).tif" in page.inner_text("section.folder")
    page.fill("#square", "5 mm")
    _looked_at(someone, pictures, "folder")
    page.get_by_role("button", name="Make the pipeline file").click()
    page.wait_for_selector("section.region .viewer")
    print("the folder is sorted, its copy is left out")


def _draw(someone: Person, folder: Path, pictures: Path) -> None:
    someone.until("[...document.querySelector('.viewer').viewer.tiles.values()].some((one) => one.naturalWidth)")
    _polygon(someone, "o", OUTLINE)
    someone.said("saved: outline")
    _polygon(someone, "h", OPENING)
    someone.said("saved: hole")
    _polygon(someone, "e", GAUGE, closed=False)
    someone.said("saved: extensometer_1")
    pixel = 1.0 / someone.page.evaluate("document.querySelector('.viewer').viewer.scale")
    (polygon,) = read_geojson(folder / "region.geojson").polygons
    drawn = [np.abs(polygon.exterior - OUTLINE).max(), np.abs(polygon.holes[0] - OPENING).max()]
    assert max(drawn) <= pixel, drawn
    someone.page.click(".path-name >> nth=0")
    someone.drag(polygon.exterior[1], MOVED)
    someone.said("saved: corner")
    (edited,) = read_geojson(folder / "region.geojson").polygons
    assert np.abs(edited.exterior[1] - MOVED).max() <= pixel
    _looked_at(someone, pictures, "region")
    print(
        f"outline and hole lie within {max(drawn):.2f} px of what was drawn, at {pixel:.2f} px per pixel of the screen"
    )


def _set(someone: Person, folder: Path) -> None:
    would = _changed(someone, "correlation", "step_size", "25")
    plan = Pipeline.load(folder / FILE).plan().by_stage()
    counts = {stage: sum(found.values()) - found["hit"] for stage, found in plan.items()}
    assert would == ", ".join(f"{stage} {count}" for stage, count in counts.items() if count)
    print(f"what would be computed is that of the plan: {would}")


def _run(someone: Person, app: Served, pictures: Path) -> None:
    page = someone.page
    someone.go("run")
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_selector("h1.state.running")
    while not any(row["computed"] for row in app.found("watch", file=FILE).get("stages", {}).values()):
        page.wait_for_timeout(200)
    _looked_at(someone, pictures, "run")
    page.get_by_role("button", name="Stop").click()
    page.wait_for_selector("h1.state.stopped")
    done = sum(row["computed"] for row in app.found("watch", file=FILE)["stages"].values())
    page.get_by_role("button", name="Go on").click()
    page.wait_for_selector("h1.state.done")
    hit = sum(row["hit"] for row in app.found("watch", file=FILE)["stages"].values())
    assert hit >= done > 0
    print(f"a run was stopped after {done} tasks and gone on with, {hit} were there")


def _explore(someone: Person, result: Result, pictures: Path) -> None:
    page = someone.page
    someone.go("explore")
    someone.until("document.querySelector('.fields')?.explorer.manifest.steps.length === 2")
    page.evaluate(f"{EXPLORER}.ready.then(() => null)")
    rows = [row for row in ProbeTable.read(result.product("probes")).rows if row["probe"] == "extensometer_1"]
    curves = page.evaluate(f"{EXPLORER}.side.curve.content.series.map(({{ name, y }}) => [name, y])")
    shown = next(y for name, y in curves if "extensometer_1" in name)
    assert np.allclose(shown[-2:], [row["strain"] for row in rows][-2:], rtol=1e-6)
    print(f"the extensometer's curve is that of the probes: {shown[-1]:.6f} at the last step")
    quantity, step = page.evaluate(f"[{EXPLORER}.quantity, {EXPLORER}.scene.step]")
    totals = [result.product("total", name)[quantity["name"]].ravel() for name in result.steps("total")]
    known = np.flatnonzero(np.isfinite(totals).all(axis=0))
    k = int(known[known.size // 2])
    x, y = _pointed_at(someone, EXPLORER, ".x-stage", k)
    assert page.evaluate(f"{EXPLORER}.stage.hovered") == k
    read_value = page.evaluate(f"{EXPLORER}.frame.point({k}).value")
    assert abs(read_value - totals[step][k]) <= 0.5001 * quantity["scale"][1]
    page.mouse.click(x, y)
    someone.until(f"{EXPLORER}.points.length === 1")
    curve = page.evaluate(f"{EXPLORER}.fields.curve({EXPLORER}.quantity, {k})")
    assert curve["values"] == [float(one[k]) for one in totals]
    _looked_at(someone, pictures, "explore")
    print(
        f"{quantity['symbol']} under the pointer is that of the product: {read_value:.6f}; so is the curve of a click"
    )
    _turn(someone, pictures)


def _turn(someone: Person, pictures: Path) -> None:
    page = someone.page
    page.locator(".x-choice").get_by_role("button", name="Surface").first.click()
    someone.until(f"{EXPLORER}.frame.places.some(Number.isFinite) && !{EXPLORER}.frame.isFlat")
    turned = f"[{EXPLORER}.stage.turntable.yaw, {EXPLORER}.stage.turntable.pitch]"
    before = page.evaluate(turned)
    box = page.locator(".x-stage").bounding_box()
    page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.6 * box["height"], steps=8)
    page.mouse.up()
    assert np.abs(np.subtract(page.evaluate(turned), before)).min() > 0.1
    _looked_at(someone, pictures, "surface")
    print("the surface was turned")


def _calibrate(someone: Person, app: Served, pictures: Path) -> None:
    page = someone.page
    someone.go("calibration")
    page.wait_for_selector(".pairs-table")
    assert f"of {len(BOARDS)} pairs" in page.inner_text(".verdict")
    before = app.found("calibration", file=FILE)
    name = next(pair["name"] for pair in before["pairs"] if LEFT_OUT in pair["name"])
    page.get_by_label(f"leave out {name}").check()
    page.click("text=Solve again")
    page.wait_for_selector("text=Leave them out of the file")
    assert f"of {len(BOARDS) - 1} pairs" in page.inner_text(".verdict")
    boards = {"boards": "boards", "rig": "rig", "without": [name]}
    baseline = app.found("calibration", file=FILE, **boards)["summary"]["baseline_mm"]
    assert f"→ {baseline:.2f} mm" in page.inner_text(".stage.wide aside table")
    _looked_at(someone, pictures, "calibration")
    print(f"without {name} the baseline is {baseline:.2f} mm, with it {before['summary']['baseline_mm']:.2f} mm")


def _compare(someone: Person, folder: Path, pictures: Path) -> None:
    page = someone.page
    _changed(someone, "total", "window", "110")
    someone.go("run")
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_selector("h1.state.running")
    page.wait_for_selector("h1.state.done")
    someone.go("compare")
    someone.until(r"/(\d+) of \1 steps/.test(document.querySelector('.tools .shown')?.textContent)")
    someone.until("document.querySelector('.pair[aria-busy=false]')")
    step, name = page.evaluate(f"[{ONE}.frame.step.name, {ONE}.quantity.name]")
    pipeline = Pipeline.load(folder / FILE)
    run = next(option for option in page.locator(".tools select").nth(1).locator("option:checked").all())
    past = pipeline.past_result(run.get_attribute("value").split()[1])
    one, other = (found.product("total", step)[name].ravel() for found in (pipeline.result(), past))
    known = np.flatnonzero(np.isfinite(one) & np.isfinite(other))
    k = int(known[known.size // 2])
    _pointed_at(someone, ONE, ".pair .side0 .x-main > .x-stage", k)
    found = re.search(r"A - B (-?[\d.]+)", page.inner_text(".pair .figures").replace("−", "-"))
    assert found is not None
    places = len(found[1].partition(".")[2])
    rounding = 0.51 * 10.0**-places + sum(page.evaluate(f"[{ONE}.quantity.scale[1], {OTHER}.quantity.scale[1]]"))
    assert abs(float(found[1]) - (one - other)[k]) <= rounding
    _looked_at(someone, pictures, "compare")
    print(f"two runs side by side differ by {found[1]} in {name}; their products by {(one - other)[k]:.6f}")


def _hand_over(someone: Person, folder: Path, pictures: Path) -> None:
    page = someone.page
    someone.go("hand_over")
    page.locator(".fact:has(.key:text-is('specimen')) textarea").fill("steel part <D>, 2 mm")
    page.keyboard.press("Tab")
    someone.said("saved: report.specimen")
    assert read(folder / FILE).data["report"] == {"specimen": "steel part <D>, 2 mm"}
    page.click("text=Write the report")
    page.wait_for_selector("text=written: results/pipeline/report.html")
    report = folder / "results/pipeline/report.html"
    assert "steel part &lt;D&gt;, 2 mm" in report.read_text()
    page.click("text=Write the files")
    page.wait_for_selector(".files li")
    assert all((folder / name).is_file() for name in page.locator(".files li").all_inner_texts())
    _looked_at(someone, pictures, "hand_over")
    print(f"the report has {report.stat().st_size / 1e6:.1f} MB; the files are written")


def _polygon(someone: Person, key: str, places: Sequence[tuple[int, int]], closed: bool = True) -> None:
    """Draw with the mouse, and end a polygon by a click on its first corner."""
    someone.page.focus(".viewer")
    someone.page.keyboard.press(key)
    for place in (*places, places[0]) if closed else places:
        someone.click(place)


def _changed(someone: Person, stage: str, name: str, text: str) -> str:
    """Change a setting; what would be computed then, as the page says it."""
    page = someone.page
    page.click(f'#sidebar a[href="#settings/{stage}"]')
    page.locator("label.parameter", has_text=name).first.locator("input").fill(text)
    page.keyboard.press("Tab")
    would: str = page.locator(".would").inner_text()
    page.click("text=Save to the file")
    someone.said(f"saved: {stage}.{name}")
    return would


def _pointed_at(someone: Person, explorer: str, stage: str, k: int) -> tuple[float, float]:
    """Move the mouse to a point of a field; where it is."""
    x, y = someone.page.evaluate(f"{explorer}.stage.shownAt({k})")
    box: dict[str, Any] = someone.page.locator(stage).bounding_box()
    someone.page.mouse.move(box["x"] + x - 40, box["y"] + y - 30)
    someone.page.mouse.move(box["x"] + x, box["y"] + y, steps=8)
    return box["x"] + x, box["y"] + y


def _looked_at(someone: Person, pictures: Path, screen: str) -> None:
    """Keep a picture; nothing overlaps and each axis has a unit."""
    pictures.mkdir(parents=True, exist_ok=True)
    someone.page.wait_for_timeout(500)
    someone.page.screenshot(path=str(pictures / f"real_{screen}.png"))
    assert someone.overlaps() == [], screen
    assert someone.axes_without_unit() == [], screen


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        way(unsorted(Path(place) / "Prüfung 3"), Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURES)
    close_browser()
