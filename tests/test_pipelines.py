"""Every pipeline of the repository runs, on reduced input where its own is large."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from dicflow.kinds.curve import StressCurve
from dicflow.kinds.material import Material
from dicflow.pipeline import Pipeline
from dicflow.report.build import write_report
from dicflow.synth import latex_experiment, write_experiment
from dicflow.synth.rubber import CONSTANTS
from tests.browser import chromium, opened
from tests.made_once import copy_of_store
from tests.reference_points import difference

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ROOT / "data_samples"
FIRST_STEPS = [
    f'photos.{side}=["photos/{side}/step_00.png", "photos/{side}/step_01.png", "photos/{side}/step_02.png"]'
    for side in ("left", "right")
]


@pytest.fixture(scope="module")
def store(quickstart_store, tmp_path_factory):
    """One store for all, so that what pipelines share is computed once; it begins with the quick start's products."""
    return copy_of_store(quickstart_store, tmp_path_factory.mktemp("pipelines") / "store")


def _load(name, data, store, settings=()):
    return Pipeline.load(ROOT / "pipelines" / f"{name}.yaml", data=data, store=store, settings=settings)


def _run(*given):
    result = _load(*given).run(scheduler="threads", workers=2)
    assert result.outcome.ok, result.outcome.errors
    return result


def _look_at_report(pipeline, folder):
    """Open the report in a browser, on a desk and on a phone, and move to another step where there is one."""
    path = Path(write_report(pipeline, pipeline.result(), folder / "report", 1))
    (folder / "browser").mkdir()
    with opened(folder / "browser") as page:
        for width, dark in ((1200, False), (390, True)):
            page.window(width, 900, dark)
            page.open(path)
            last = page.explorer()
            page.evaluate("document.querySelector('.x-stage').focus()")
            page.press("ArrowLeft")
            shown = page.explorer()
            assert last["photo"].startswith("data:image/jpeg")
            several = len(pipeline.result().steps("total")) > 1
            assert (shown["map"] != last["map"], shown["photo"] != last["photo"]) == (several, several)
            assert (shown["title"], shown["bar"]) == (last["title"], last["bar"])
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert (page.overlaps(), page.cut()) == ([], [])
            assert page.requests() == [path.resolve().as_uri()]
            assert page.complaints() == []


needs_browser = pytest.mark.skipif(chromium() is None, reason="needs chromium on the PATH")


def test_quickstart_measures_the_extensometer_within_a_thousandth(store):
    result = _run("quickstart", SAMPLES, store)
    summary = result.product("comparison").attrs["summary"]
    assert summary["measured_steps"] == 8
    assert summary["max_strain_error_pct"] < 0.1


@needs_browser
def test_the_quickstarts_report_in_a_browser(store, tmp_path):
    _run("quickstart", SAMPLES, store)
    _look_at_report(_load("quickstart", SAMPLES, store), tmp_path)


def test_the_right_camera_may_be_followed_in_time(store):
    """Both ways through the last step agree far below their standard deviations' sum."""
    followed = _run("quickstart", SAMPLES, store, ["stereo.match=first_step"])
    assert followed.product("comparison").attrs["summary"]["max_strain_error_pct"] < 0.1
    matched = _run("quickstart", SAMPLES, store)
    one, two = (result.dataset("total", step=-1) for result in (followed, matched))
    assert float(abs(one.V - two.V).median()) < float((one.sigma_V + two.sigma_V).median())


def test_the_thesis_method_measures_all_steps_within_half_a_per_cent(store):
    result = _run("thesis_quickstart", SAMPLES, store)
    summary = result.product("comparison").attrs["summary"]
    assert summary["measured_steps"] == 8
    assert summary["max_displacement_error_pct"] < 0.5
    assert summary["max_strain_error_pct"] < 0.5


def test_planar_strain_follows_the_caliper(store):
    result = _run("planar", SAMPLES, store)
    assert result.product("comparison").attrs["summary"]["max_strain_error_pct"] < 2.0


def test_one_camera_in_millimetres_over_the_load(store):
    """Lengths of the caliper within the scale's uncertainty, and what perspective adds: 0.5 % of the strain."""
    result = _run("one_camera", SAMPLES, store)
    rows = result.product("probes").attrs["rows"]
    imposed = np.array([60.0, 69.05, 82.05, 101.85, 122.85, 106.45, 88.0, 74.55]) / 60.0
    strain, length = (np.array([row[name] for row in rows]) for name in ("strain", "length_mm"))
    share = np.array([row["calibration_length_mm"] for row in rows])
    np.testing.assert_allclose(strain, imposed - 1.0, rtol=5e-3)
    assert np.all(np.abs(length - 60.0 * 321.0 / 348.1 * imposed) < 2.0 * share + 5e-3 * length)
    grams = np.array([0.0, 118.53, 268.53, 418.53, 568.53, 218.53, 118.53, 68.53])
    np.testing.assert_allclose([row["force_N"] for row in rows], grams * 9.80665e-3)
    phases = result.product("load").attrs["phases"]
    assert phases == ["loading"] * 5 + ["unloading"] * 3


def test_polynomial_degree_sse_never_grows(store):
    result = _run("polynomial_degree", SAMPLES, store, FIRST_STEPS)
    for step in result.steps("surface"):
        for axis in "xyz":
            sse = [result.product("surface", step, variant).attrs["fit"][axis]["sse"] for variant in range(5)]
            assert all(after <= before * (1 + 1e-9) for before, after in itertools.pairwise(sse))


def test_detectors_side_by_side(store):
    table = _run("detectors", SAMPLES, store, FIRST_STEPS).table()
    assert [row["features.detector"] for row in table] == ["KAZE", "AKAZE", "SIFT", "BRISK", "ORB"]
    assert all(row["track.subsets_filled"] == 0 and row["matches.matches"] > 100 for row in table)


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_latex_experiments(number, tmp_path):
    """The second step of each, on photographs reduced to 3/8 of the size."""
    write_experiment(tmp_path, latex_experiment(number, scale=0.375, steps=[0, 1], boards=9), workers=2)
    result = _run(f"latex_experiment_{number}", tmp_path, tmp_path / "store")
    table = result.product("comparison").attrs["rows"]
    assert table[1]["dic_strain"] == pytest.approx(table[1]["caliper_strain"], rel=0.03)


def test_rubber_curves_give_the_constants_that_made_them(store):
    found = Material.read(_run("rubber_curves", SAMPLES / "rubber", store).product("material")).models[0]
    assert found.name == "ogden_2"
    for constant, truth in zip(
        sorted(found.constants, key=lambda one: one.value), sorted(CONSTANTS.values()), strict=True
    ):
        assert abs(constant.value - truth) <= 1.5 * constant.half_width


def test_latex_tables(store):
    """Young's modulus of the narrow strips at rest is the mean of their secants there, within a tenth."""
    result = _run("latex_tables", ROOT / "dicflow" / "synth" / "latex", store)
    found = Material.read(result.product("narrow")).models[0]
    curves = [StressCurve.read(result.product(f"narrow_{number}")) for number in (1, 2, 3)]
    secants = [curve["nominal_stress"][1:5] / (curve["stretch"] - curve["stretch"] ** -2)[1:5] for curve in curves]
    assert found.shear_modulus[0] == pytest.approx(np.mean(secants), rel=0.1)
    assert all(curve.summary["loop_work_mJ_mm3"] > 0.4 for curve in curves)


@pytest.fixture(scope="module")
def d_specimen(shared_data, tmp_path_factory):
    """The whole motion in one step, with every second pair of boards."""
    settings = [
        f'photos.{side}=["{side}/GT4-0000_{n}.tif", "{side}/GT4-0273_{n}.tif"]'
        for n, side in enumerate(("left", "right"))
    ]
    names = [f"{number:02d}_0.jpeg" for number in range(0, 21, 2)]
    for n, side in enumerate(("left", "right")):
        files = ", ".join(f'"boards/{side}/{name.replace("_0.", f"_{n}.")}"' for name in names)
        settings.append(f"boards.{side}=[{files}]")
    given = "d_specimen", shared_data / "d_specimen", tmp_path_factory.mktemp("d_specimen"), settings
    return _load(*given), _run(*given)


def test_d_specimen(d_specimen, shared_data):
    against = difference(d_specimen[1], shared_data / "d_specimen")
    assert against.share > 0.97
    np.testing.assert_allclose(against.mean, 0.0, atol=0.05)


@needs_browser
def test_the_report_of_the_d_specimen_in_a_browser(d_specimen, tmp_path):
    _look_at_report(d_specimen[0], tmp_path)
