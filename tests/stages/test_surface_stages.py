import json

import numpy as np
import pytest
from pydantic import ValidationError

from dicflow.core.status import Status
from dicflow.errors import StageError
from dicflow.kinds.cloud import Cloud
from dicflow.stages.fill import Fill
from dicflow.stages.surface import Surface

ROWS, COLS = 120, 90
REGION = (slice(20, 100), slice(25, 65))
OPENING = (slice(40, 80), slice(35, 55))


def truth():
    row, col = np.mgrid[:ROWS, :COLS].astype(float)
    return np.stack([0.1 * col - 4, 0.1 * row - 6, 500 + 0.02 * col - 1e-3 * (row - 60) ** 2], axis=-1)


def cloud(noise=0.0, opening=False, holes=()):
    """A curved sheet in a region of the crop, float32 as a reconstruction gives it."""
    xyz = truth() + np.random.default_rng(1).normal(0, 1, (ROWS, COLS, 3)) * noise
    status = np.full((ROWS, COLS), Status.OUTSIDE, np.uint8)
    status[REGION] = Status.VALID
    if opening:
        status[OPENING] = Status.OUTSIDE
    for where, code in holes:
        status[where] = code
    xyz[status != Status.VALID] = np.nan
    return Cloud.write(xyz, status, (100, 50), {})


def test_a_filled_surface_keeps_its_fit_and_title():
    surface = Surface().run(cloud=cloud(noise=0.01))
    filled = Cloud.read(Fill().run(cloud=surface))
    assert filled.fit == Cloud.read(surface).fit
    assert set(filled.fit) == {"x", "y", "z"}
    assert filled.title == "smooth surface"
    assert Cloud.read(Fill().run(cloud=cloud())).fit == {}


def test_fill_marks_what_it_fills_and_stays_inside():
    holes = [((50, slice(30, 40)), Status.NO_MATCH), ((slice(60, 64), 45), Status.BACKGROUND)]
    raw = cloud(opening=True, holes=holes[:1])
    result = Fill().run(cloud=raw)
    assert np.all(result["status"][50, 30:35] == Status.FILLED)
    outside = raw["status"] == Status.OUTSIDE
    assert np.all(result["status"][50, 35:40] == Status.FILLED)
    assert np.isnan(result["xyz"][outside & (result["status"] != Status.FILLED)]).all()
    measured = raw["status"] == Status.VALID
    assert np.array_equal(result["xyz"][measured], raw["xyz"][measured])
    assert result["xyz"].dtype == np.float32
    assert result.attrs["origin"] == [100.0, 50.0]
    assert result.attrs["summary"]["filled_share"] == pytest.approx(10 / (80 * 40 - 40 * 20 + 5))
    filled = result["status"] == Status.FILLED
    assert np.abs(result["xyz"][filled] - truth()[filled]).max() < 1.0


def test_fill_leaves_too_wide_a_hole_open():
    raw = cloud(holes=[(REGION, Status.NO_MATCH), ((slice(20, 24), slice(25, 65)), Status.VALID)])
    result = Fill(window=4, passes=1).run(cloud=raw)
    assert np.all(result["status"][60, 25:65] == Status.NO_MATCH)
    assert np.isnan(result["xyz"][60]).all()


def test_perfect_surface_with_band():
    result = Surface(margin=6).run(cloud=cloud())
    has = np.isfinite(result["xyz"]).all(axis=2)
    assert np.abs(result["xyz"][has] - truth()[has]).max() < 1e-4
    row, col = np.mgrid[:ROWS, :COLS]
    away = np.hypot(np.maximum(np.maximum(20 - row, row - 99), 0), np.maximum(np.maximum(25 - col, col - 64), 0))
    assert np.array_equal(has, away <= 6)
    assert np.all(result["status"][REGION] == Status.VALID)
    assert np.all(result["status"][has & (away > 0)] == Status.FILLED)
    assert np.all(result["status"][~has] == Status.OUTSIDE)
    assert result.attrs["origin"] == [100.0, 50.0]


def test_an_opening_stays_open_but_for_the_band():
    result = Surface(margin=5).run(cloud=cloud(opening=True))
    assert np.isnan(result["xyz"][46:74, 41:49]).all()
    assert np.all(result["status"][46:74, 41:49] == Status.OUTSIDE)
    assert np.all(result["status"][41:44, 36:54] == Status.FILLED)


def test_noise_is_averaged_over_the_region():
    """The mean variance of a fit with p coefficients over n points is σ² p / n."""
    sigma = np.array([0.02, 0.02, 0.3])
    result = Surface(robust="none", margin=0).run(cloud=cloud(noise=sigma))
    error = (result["xyz"] - truth())[REGION]
    predicted = sigma * np.sqrt(np.array([10, 10, 6]) / (80 * 40))
    assert np.all(np.sqrt((error**2).mean(axis=(0, 1))) < 1.8 * predicted)
    assert np.all(np.sqrt((error**2).mean(axis=(0, 1))) > 0.3 * predicted)
    assert [result.attrs["fit"][name]["rmse"] for name in "xyz"] == pytest.approx(sigma, rel=0.06)
    assert result.attrs["summary"]["rmse_z_mm"] == result.attrs["fit"]["z"]["rmse"]


@pytest.mark.parametrize("robust", ["bisquare", "lar"])
def test_outliers_stay_out(robust):
    spoiled = cloud(noise=0.01)
    spoiled["xyz"][30:40, 30:50, 2] += 30.0
    result = Surface(robust=robust).run(cloud=spoiled)
    assert np.abs((result["xyz"] - truth())[REGION]).max() < 0.02
    assert np.abs((Surface(robust="none").run(cloud=spoiled)["xyz"] - truth())[REGION]).max() > 1.0


def test_degrees_are_those_given():
    result = Surface(degree={"x": [1, 2], "z": [3, 2]}).run(cloud=cloud(noise=0.01))
    assert {name: fit["degree"] for name, fit in result.attrs["fit"].items()} == {"x": [1, 2], "y": [3, 3], "z": [3, 2]}


def test_degree_auto_says_why():
    fit = Surface(degree="auto").run(cloud=cloud(noise=0.01)).attrs["fit"]
    assert (fit["x"]["degree"], fit["y"]["degree"], fit["z"]["degree"]) == ([1, 1], [1, 1], [2, 2])
    assert "lowest BIC" in fit["z"]["why"]


def test_sse_never_grows_with_the_degree():
    noisy = cloud(noise=0.1)
    fits = [
        Surface(degree={c: [d, d] for c in "xyz"}, robust="none").run(cloud=noisy).attrs["fit"] for d in range(1, 6)
    ]
    for name in "xyz":
        errors = [fit[name]["sse"] for fit in fits]
        assert errors == sorted(errors, reverse=True)


def test_lowess():
    node = Surface(method="lowess", lowess_window=25, lowess_degree=2, robust="none", margin=2)
    result = node.run(cloud=cloud(noise=0.01))
    assert np.abs((result["xyz"] - truth())[REGION]).max() < 0.02
    assert result.attrs["fit"]["z"]["rmse"] == pytest.approx(0.01, rel=0.05)
    assert result.attrs["fit"]["z"]["window_px"] == [25, 25]


def test_attributes_are_json():
    for node in (Surface(), Surface(degree="auto"), Surface(method="lowess")):
        json.dumps(node.run(cloud=cloud(noise=0.01)).attrs, allow_nan=False)


def test_too_few_points():
    holes = [((slice(None), slice(None)), Status.NO_MATCH), ((slice(40, 42), slice(40, 43)), Status.VALID)]
    few = cloud(holes=holes)
    for degree in ("auto", {"z": [2, 2]}):
        with pytest.raises(StageError, match=r"coordinate x: .* lower the degree"):
            Surface(degree=degree).run(cloud=few)
    with pytest.raises(StageError, match="coordinate x"):
        Surface(method="lowess", lowess_degree=2, lowess_window=5).run(
            cloud=cloud(holes=[*holes[:1], ((40, 40), Status.VALID)])
        )


@pytest.mark.parametrize(
    "bad", [{"degree": {"x": [6, 1]}}, {"degree": {"w": [1, 1]}}, {"degree": "best"}, {"margin": -1}]
)
def test_impossible_parameters_are_refused(bad):
    with pytest.raises(ValidationError):
        Surface(**bad)
