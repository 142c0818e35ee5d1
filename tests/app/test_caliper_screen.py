"""The comparison with the caliper is seen with its uncertainty, its extensometer is chosen, and lengths are typed."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, measure, served, small_test

from dicflow.app.caliper import comparison_of
from dicflow.app.drawing import write_probes
from dicflow.app.project import open_project
from dicflow.app.versions import digest_of
from dicflow.comparison.caliper import caliper_uncertainty
from dicflow.errors import ConfigurationError
from dicflow.io.caliper import read_caliper
from dicflow.io.configuration import read
from dicflow.kinds.comparison import Comparison
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow
SECOND = [(340, 160), (340, 430)]


@pytest.fixture
def copied(sample_result, tmp_path):
    return shutil.copytree(sample_result.parent, tmp_path / "test") / FILE


def stages(path):
    return read(path).data["stages"]


def test_the_numbers_are_those_of_the_products(sample_result):
    result = Pipeline.load(sample_result).result()
    table, probes = Comparison.read(result.product("comparison")), ProbeTable.read(result.product("probes"))
    u = np.hypot(probes.of_extensometer("length", "u_strain"), probes.of_extensometer("length", "calibration_strain"))
    by_caliper = caliper_uncertainty(read_caliper(sample_result.parent / "caliper.csv").length_mm)
    found = comparison_of(open_project(sample_result), FILE)
    assert (found["stage"], found["extensometer"], found["read_mm"]) == ("comparison", "length", 0.05)
    assert len(found["rows"]) == len(table.rows) == 8
    for k, (row, expected) in enumerate(zip(found["rows"], table.rows, strict=True)):
        assert {name: row[name] for name in expected} == dict(expected)
        if k:
            assert row["u_strain"] == pytest.approx(u[k])
            assert row["u_difference"] == pytest.approx(math.hypot(u[k], by_caliper[k]))


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080), (390, 844)])
def test_curve_table_and_difference_are_seen(sample_result, size):
    with served(sample_result) as app, opened_page(app, *size) as someone:
        someone.go("caliper")
        page = someone.page
        page.wait_for_selector(".x-chart polyline")
        first, *later = app.found("caliper", file=FILE)["rows"]
        assert f"is {first['dic_length_mm']:.1f} mm long, and the caliper showed 60.0 mm" in page.inner_text(".caliper")
        worst = max(later, key=lambda row: abs(row["strain_error"]))
        assert f"{abs(worst['strain_error']):.5f} ± {worst['u_difference']:.5f}" in page.inner_text(".verdict")
        assert page.locator(".x-chart").count() == 2
        assert page.locator(".caliper tbody tr").count() == 16
        names = page.locator(".x-name").all_text_contents()
        assert names == ["load [g]", "strain [–]", "load [g]", "difference of the strains [–]"]
        assert someone.axes_without_unit() == []
        for scheme in someone.schemes():
            someone.picture(f"caliper_{size[0]}_{scheme}")
            assert someone.overlaps() == [], scheme
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_another_extensometer_is_drawn_chosen_and_renamed(copied):
    """The comparison follows the name, and an extensometer that is compared cannot be removed unseen."""
    with served(copied) as app, opened_page(app) as someone:
        someone.go("region")
        page = someone.page
        page.wait_for_selector(".viewer")
        someone.draw_extensometer(SECOND)
        someone.compare_lengths_of("extensometer_1")
        assert stages(copied)["comparison"]["extensometer"] == "extensometer_1"
        page.get_by_role("button", name="Compute the comparison").click()
        page.wait_for_selector(".x-chart polyline")
        someone.go("region")
        page.locator(".path-name", has_text="extensometer_1").click()
        page.get_by_label("name").fill("along the load")
        page.keyboard.press("Tab")
        someone.said("saved: name along the load")
        assert stages(copied)["comparison"]["extensometer"] == "along the load"
        assert "along the load" in stages(copied)["probes"]["extensometers"]
        page.get_by_role("button", name="Delete").click()
        someone.said("comparison compares the extensometer 'along the load'; choose another one at the caliper first")
        assert "along the load" in stages(copied)["probes"]["extensometers"]
        page.keyboard.press("Control+z")
        someone.said("taken back")
        assert stages(copied)["comparison"]["extensometer"] == "extensometer_1"
    product = Pipeline.load(copied).result().product("comparison")
    assert np.abs(np.array([row["strain_error"] for row in Comparison.read(product).rows])).max() < 2e-3


def test_only_the_renamed_probe_carries_the_comparison_along(copied):
    project = open_project(copied)
    moved = {"extensometers": {"other": [[362, 134], [362, 455]]}}
    with pytest.raises(ConfigurationError, match="comparison compares the extensometer 'length'"):
        write_probes(project, FILE, "probes", moved, digest_of(project, FILE), {})
    write_probes(project, FILE, "probes", moved, digest_of(project, FILE), {"length": "other"})
    assert stages(copied)["comparison"]["extensometer"] == "other"


def test_the_settings_offer_the_names_of_the_extensometers(sample_result):
    with served(sample_result) as app:
        found = app.found("parameters", file=FILE, stage="comparison")["parameters"]
    assert next(one["choices"] for one in found if one["name"] == "extensometer") == ["null", "length"]


def test_lengths_are_typed_and_compared(small_result, tmp_path):
    """With decimal commas; what is no number is refused in words."""
    path = shutil.copytree(small_result.parent, tmp_path / "test") / FILE
    with served(path) as app, opened_page(app) as someone:
        someone.go("caliper")
        page = someone.page
        page.wait_for_selector("details[open]")
        for k, (load, length) in enumerate((("0", "60,00"), ("100", "60,05"), ("250", "sixty"))):
            page.get_by_label(f"load at step_{k:04}").fill(load)
            page.get_by_label(f"length at step_{k:04}").fill(length)
        page.get_by_role("button", name="Save the lengths").click()
        someone.said("step_0002: the length 'sixty' is no number; type it as 12.5")
        assert not (path.parent / "caliper.csv").exists()
        page.get_by_label("length at step_0002").fill("60.0")
        page.get_by_role("button", name="Save the lengths").click()
        someone.said("saved: lengths of the caliper")
        assert stages(path)["compare"] == {"stage": "compare", "caliper": "caliper.csv"}
        assert read_caliper(path.parent / "caliper.csv").length_mm.tolist() == [60.0, 60.05, 60.0]
        page.get_by_role("button", name="Compute the comparison").click()
        page.wait_for_selector(".x-chart polyline")
        rows = app.found("caliper", file=FILE)["rows"]
        assert [row["caliper_strain"] for row in rows] == pytest.approx([0.0, 0.05 / 60.0, 0.0])
        assert someone.overlaps() == []
        page.keyboard.press("Control+z")
        someone.said("taken back: lengths of the caliper")
        assert "compare" not in stages(path)
        assert not (path.parent / "caliper.csv").exists()


def test_a_table_with_too_few_rows_is_said(tmp_path):
    path = small_test(tmp_path / "test", steps=3)
    (path.parent / "caliper.csv").write_text("phase,load_g,length_mm\nloading,0,60\n")
    with served(path) as app, opened_page(app) as someone:
        someone.go("caliper")
        someone.page.wait_for_selector("section.caliper details .problem")
        assert "caliper.csv has 1 row, but there are 3 photographs" in someone.page.inner_text("section.caliper")
    measure(path)
