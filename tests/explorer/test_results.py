"""Results of real pipelines in the explorer: its numbers are those of the products."""

from __future__ import annotations

import re
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dicflow.core.cameras.camera import project
from dicflow.core.status import Status
from dicflow.explorer.fields import ERROR_PARTS, field_source
from dicflow.explorer.pack import packed_result
from dicflow.explorer.packing import LinearScale, LogScale, unpacked
from dicflow.explorer.page import NOTEBOOK_PAGE, fragment
from dicflow.kinds.quantities import ERRORS
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Pipeline
from dicflow.report.answer import Seen, verdict
from dicflow.report.build import write_report
from tests.explorer.chromium import Tabs
from tests.made_once import copy_of_store

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "data_samples"
PAIR = """
dicflow: 1
title: One pair
stages:
  photos: {stage: images, left: "photos/left/step_00.png", right: "photos/right/step_00.png"}
  boards: {stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig: {stage: calibrate, square: 14.5 mm, tangential: true}
"""
POINTS = """
  region: {stage: region, images: photos, file: region.geojson}
  correlation: {stage: correlate, images: photos, subset_size: 21, step_size: 5}
  stereo: {stage: stereo, images: photos}
  points: {stage: triangulate}
"""
CLOUD = """
  pair: {stage: rectify, images: photos}
  disparity: {stage: disparity}
  cloud: {stage: reconstruct}
"""


def made(sources, make):
    return make()


@pytest.fixture(scope="module")
def store(quickstart_store, tmp_path_factory):
    return copy_of_store(quickstart_store, tmp_path_factory.mktemp("explored") / "store")


@pytest.fixture(scope="module")
def quickstart(store):
    result = Pipeline.load(ROOT / "pipelines" / "quickstart.yaml", data=SAMPLES, store=store).run(scheduler="sync")
    assert result.outcome.ok
    return result


@pytest.fixture(scope="module")
def packed(quickstart):
    return packed_result(quickstart, "quickstart", made)


@pytest.fixture(scope="module")
def tabs():
    with Tabs() as tabs:
        yield tabs


def array(found, step, key, parts=1):
    shape = (*step["shape"], parts) if parts > 1 else tuple(step["shape"])
    return unpacked(found.blobs[step["blobs"][key]], shape)


def test_every_value_sigma_and_reason_of_the_quick_start(quickstart, packed):
    assert packed.manifest["left_out"] == []
    for step in packed.manifest["steps"]:
        product = quickstart.product("total", step["name"])
        for quantity in packed.manifest["quantities"]:
            name, scale = quantity["name"], LinearScale(*quantity["scale"])
            back, truth = scale.values(array(packed, step, f"value/{name}")), product[name]
            assert (np.isnan(back) == np.isnan(truth)).all()
            assert np.nanmax(np.abs(back - truth)) <= scale.quantum / 2 * (1 + 1e-6)
            for part, scale in quantity["errors"].items():
                error = LogScale(*scale)
                if f"{part}/{name}" in step["blobs"]:
                    back, truth = error.values(array(packed, step, f"{part}/{name}")), product[ERROR_PARTS[part] + name]
                    assert (np.isnan(back) == ~(truth > 0)).all()
                    assert np.nanmax(np.abs(back / truth - 1)) <= error.error * (1 + 1e-4)
        assert (array(packed, step, "status") == product["status"]).all()


def test_errors_are_parts_of_quantities_and_not_quantities(quickstart, packed):
    quantities = {one["name"]: one for one in packed.manifest["quantities"]}
    assert not [name for name in quantities if name.startswith(tuple(ERRORS))]
    for name in ("U", "V", "W", "exx", "eyy"):
        assert quantities[name]["errors"].keys() >= {"u", "sigma", "bias"}
    fields, total = field_source(quickstart), quickstart.product("total", "step_03")
    k = np.flatnonzero(np.isfinite(total["eyy"]))[100]
    for name in ("U", "eyy"):
        assert fields.at_point("step_03", name, k) == (total[name].flat[k], total[f"u_{name}"].flat[k])
        assert (total[f"u_{name}"] > total[f"sigma_{name}"]).any()


def test_fields_that_were_read_last_are_kept_within_a_limit(quickstart, monkeypatch):
    one, another = field_source(quickstart), field_source(quickstart)
    first, *others = [step for step in one.steps if one.has(step)]
    found = one.read(first)
    assert another.read(first) is found
    arrays = [found.status, *found.values.values(), *found.places.values()]
    arrays += [array for part in found.errors.values() for array in part.values()]
    monkeypatch.setattr("dicflow.explorer.fields._KEPT_BYTES", 2 * sum(array.nbytes for array in arrays))
    one.read(others[0])
    assert another.read(first) is found
    one.read(others[1])
    one.read(others[0])
    assert another.read(first) is not found


def test_places_in_both_photographs_and_in_space(quickstart, packed):
    step = packed.manifest["steps"][3]
    known = quickstart.product("total", step["name"])["status"] <= Status.FILLED
    sources = {"left": ("points", "xy"), "right": ("points", "xy_right"), "space": ("total", "xyz")}
    for place, (stage, name) in sources.items():
        scales = [LinearScale(*scale) for scale in packed.manifest["places"][place]]
        codes = array(packed, step, f"place/{place}", len(scales))
        truth = quickstart.product(stage, step["name"])[name]
        for k, scale in enumerate(scales):
            assert np.abs(scale.values(codes[..., k]) - truth[..., k])[known].max() <= scale.quantum / 2 * (1 + 1e-6)
            assert scale.quantum < 0.02


def test_the_main_view_the_probe_and_the_loads(quickstart, packed):
    manifest = packed.manifest
    means = {step: np.nanmean(quickstart.product("total", step)["eyy"]) for step in quickstart.steps("total")}
    assert manifest["main"][0] == "eyy"
    assert manifest["steps"][manifest["main"][1]]["name"] == max(means, key=means.get)
    (curve,) = manifest["curves"]
    assert (curve["name"], curve["quantity"], curve["unit"]) == ("length", "strain", "1")
    np.testing.assert_allclose(curve["values"], quickstart.product("probes")["strain"][0])
    np.testing.assert_allclose(curve["errors"], quickstart.product("probes")["u_strain"][0])
    load, table = manifest["load"], quickstart.product("comparison")["load_g"]
    assert (load["unit"], load["first"]) == ("g", table[0])
    np.testing.assert_allclose(load["steps"], table[1:])
    (probe,) = manifest["probes"]
    assert (probe["name"], probe["sort"], probe["places"]) == ("length", "extensometer", [(362, 134), (362, 455)])


def test_cameras_look_at_the_points_that_they_photographed(quickstart, packed):
    """A place on the ray to the middle of the left photograph lies at its middle; the centres are a baseline apart."""
    rig = CalibratedRig.read(quickstart.product("rig")).cameras
    left, right = packed.manifest["cameras"]
    assert np.linalg.norm(np.subtract(right["centre"], left["centre"])) == pytest.approx(
        np.linalg.norm(rig.translation)
    )
    corner = np.array(left["centre"]) + 400.0 * np.array(left["corners"][2])
    seen = project(rig.left._replace(distortion=np.zeros(5)), corner)
    np.testing.assert_allclose(np.ravel(seen), np.array(rig.left.size) - 1, atol=1e-6)


def test_photographs_are_where_their_crop_says(quickstart, packed):
    step, crop = packed.manifest["steps"][0], packed.manifest["crops"]["left"]
    picture = np.asarray(Image.open(BytesIO(packed.blobs[step["photos"]["left"]])), float)
    (x, y), (width, height) = crop["origin"], crop["size"]
    part = quickstart.product("photos", step["name"])["left"][y : y + round(height), x : x + round(width)].astype(float)
    assert picture.shape == part.shape
    assert np.abs(picture - part).mean() < 6.0


def test_the_verdict_is_one_line_with_the_numbers(packed):
    seen = Seen(7, 7, 1.0)
    line = verdict(packed.manifest, seen, 1, 0)
    assert (line.tone, line.head) == ("warning", "Measured, with warnings")
    quantity = next(one for one in packed.manifest["quantities"] if one["name"] == "eyy")
    assert f"{quantity['means'][packed.manifest['main'][1]][0]:.3f}" in line.text
    assert "7 of 7 steps" in line.text
    assert verdict(packed.manifest, seen, 0, 0).tone == "good"
    assert verdict(packed.manifest, seen, 0, 2).tone == "error"
    assert (
        "6 of 7 steps measured, at least 93.2 % of the points"
        in verdict(packed.manifest, Seen(7, 6, 0.9321), 0, 0).text
    )


@pytest.mark.parametrize(("name", "stages"), [("points", POINTS), ("cloud", CLOUD)])
def test_a_pair_alone_is_a_shape(store, tmp_path, tabs, name, stages):
    path = tmp_path / f"{name}.yaml"
    path.write_text(PAIR + stages)
    result = Pipeline.load(path, data=SAMPLES, store=store).run(scheduler="sync")
    found = packed_result(result, "pair", made)
    (step,) = found.manifest["steps"]
    assert (found.manifest["form"], found.manifest["main"]) == ("shape", ("Z", 0))
    scale = LinearScale(*found.manifest["quantities"][0]["scale"])
    back = scale.values(array(found, step, "value/Z"))
    truth = result.product(name, step["name"])["xyz"][..., 2]
    stride = -(-truth.shape[0] // back.shape[0])
    np.testing.assert_allclose(back, truth[::stride, ::stride], atol=scale.quantum)
    assert "the surface measured" in verdict(found.manifest, Seen(1, 1, 1.0), 0, 0).text
    page = tmp_path / "page.html"
    page.write_text(NOTEBOOK_PAGE.replace("{body}", fragment(found)), encoding="utf-8")
    with tabs.open() as seen:
        seen.show(page.as_uri())
        assert seen.js("explorer.side.surface.stage.turntable.radius") > 5
        assert not seen.page.locator(".x-transport").is_visible()
        seen.picture(f"shape_{name}")
        assert seen.complaints == []


def test_a_test_in_the_form_of_the_thesis_has_the_numbers_of_its_total(pipeline, measured):
    result = Pipeline.load(pipeline).result()
    found = packed_result(result, "thesis", made)
    step = found.manifest["steps"][-1]
    scale = LinearScale(*next(one["scale"] for one in found.manifest["quantities"] if one["name"] == "eyy"))
    truth = result.product("total", step["name"])["eyy"]
    back = scale.values(array(found, step, "value/eyy"))
    assert (np.isnan(back) == np.isnan(truth)).all()
    assert np.nanmax(np.abs(back - truth)) <= scale.quantum / 2 * (1 + 1e-6)
    assert set(step["blobs"]) >= {"status", "place/left", "place/space"}


def test_the_pointer_reads_the_quick_start_and_its_gaps(quickstart, packed, tmp_path, tabs):
    page = tmp_path / "page.html"
    page.write_text(NOTEBOOK_PAGE.replace("{body}", fragment(packed)), encoding="utf-8")
    step = packed.manifest["steps"][packed.manifest["main"][1]]["name"]
    total, right = quickstart.product("total", step), quickstart.product("points", step)["xy_right"]
    first = quickstart.product("correlation", 0)["xy"]
    quantum = next(one["scale"][1] for one in packed.manifest["quantities"] if one["name"] == "eyy")
    row, col = 30, 11
    with tabs.open() as seen:
        seen.show(page.as_uri())
        for places in (total["xy"], right):
            text = seen.hover(*places[row, col])
            value = re.search(r"εyy ([\d.]+) ±", text).group(1)
            rounding = 0.5 * 10.0 ** -len(value.partition(".")[2]) + quantum / 2
            assert float(value) == pytest.approx(total["eyy"][row, col], abs=1.01 * rounding)
            seen.toggle("Right")
        seen.toggle("Left")
        seen.toggle("Undeformed")
        lost = np.argwhere((total["status"] > Status.FILLED) & np.isfinite(first).all(axis=-1))
        assert len(lost) > 0
        text = seen.hover(*first[tuple(lost[0])])
        assert f"no value: {Status(int(total['status'][tuple(lost[0])])).label}" in text
        assert seen.complaints == []


@pytest.fixture(scope="module")
def report(quickstart, store, tmp_path_factory):
    loaded = Pipeline.load(ROOT / "pipelines" / "quickstart.yaml", data=SAMPLES, store=store)
    return write_report(loaded, quickstart, tmp_path_factory.mktemp("report"))


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1920, 1080), (390, 844)])
def test_the_report_opens_with_it_and_no_texts_overlap(report, tabs, width, height):
    assert report.stat().st_size < 10e6
    with tabs.open(viewport={"width": width, "height": height}) as seen:
        seen.show(report.as_uri())
        assert seen.page.locator("main > section").first.get_attribute("id") == "answer"
        assert seen.page.locator(".x-stage").bounding_box()["y"] < 0.6 * height
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
        for scheme in ("light", "dark"):
            seen.page.emulate_media(color_scheme=scheme)
            assert seen.overlaps() == [], scheme
            seen.picture(f"report_{width}_{scheme}")
        assert (seen.complaints, seen.requests) == ([], [report.as_uri()])


def test_a_notebook_shows_a_page_that_stands_alone(quickstart):
    view = quickstart.view()
    assert view._repr_html_().startswith("<iframe")
    assert "sandbox=" in view._repr_html_()
    blobs = re.findall(r'"([0-9a-f]{16})":"([A-Za-z0-9+/=]+)"', view.html)
    assert len(blobs) > 50
    assert all(b64decode(text) for _, text in blobs[:5])
    assert not re.findall(r"(?:src|href)=\"(?!data:)", view.html)
