import numpy as np
import pytest
from analytic import affine, cloud, run_all, tracks, true_strain

from dicflow.core.status import Status
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.stages.accumulate import Accumulate
from dicflow.stages.displacement import Displacement
from dicflow.stages.strain import Strain

MEASURES = ("exx", "eyy", "gxy")
FACTORS = np.linspace(1.0, 2.2, 11)


def powers(last, count):
    """Transforms from nothing to ``last`` in equal stretches."""
    return [affine(xx=last[0] ** t, yy=last[1] ** t) for t in np.linspace(0, 1, count + 1)]


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("plane", [(0.0, 0.0), (0.3, -0.4)])
def test_perfect_stretch_of_2_2_in_ten_steps(plane, smooth):
    totals = [affine(xx=f**-0.5, yy=f) for f in FACTORS]
    surface = cloud(plane)
    for k, (_, _, total) in enumerate(run_all(totals, [surface] * 11, smooth=smooth), start=1):
        gradient, truth = true_strain(totals[k], plane)
        assert np.abs(total["gradient"] - gradient).max() < 1e-8
        for name in MEASURES:
            assert np.abs(total[name] - getattr(truth, name)).max() < 1e-8
    assert np.abs(total["U"] - (total["xyz"] - total["xyz_reference"])[..., 0]).max() < 1e-9
    assert np.abs(total["V"] - (total["xyz"] - total["xyz_reference"])[..., 1]).max() < 1e-9
    if plane == (0.0, 0.0):
        assert np.abs(total["eyy"] - 1.2).max() < 1e-8
        assert total.attrs["summary"]["mean_eyy"] == pytest.approx(1.2)
    assert not total["status"].any()


def test_one_camera_gives_the_same_strain():
    totals = [affine(), affine(xx=0.9, xy=0.1, yy=1.4)]
    _, _, total = run_all(totals)[-1]
    _, truth = true_strain(totals[1])
    for name in MEASURES:
        assert np.abs(total[name] - getattr(truth, name)).max() < 1e-9
    assert total.attrs["unit"] == "px"
    assert total.variables["V"].units == "px"


def test_rotation_in_the_image_and_depth_give_no_strain():
    angle = np.radians(20)
    turned = affine(np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle), shift=(3.0, 5.0))
    _, _, total = run_all([affine(), turned], [cloud(z=500.0), cloud(z=470.0)])[-1]
    assert max(np.abs(total[name]).max() for name in MEASURES) < 1e-9
    assert np.allclose(total["W"], -30.0)


def test_steps_compose():
    """Two halves give the gradient of the whole, also where they do not commute."""
    first, second = affine(xy=0.3, yy=1.2), affine(xx=0.8, yx=0.1, yy=1.3)
    halves = run_all([affine(), first, second @ first])[-1][2]
    whole = run_all([affine(), second @ first])[-1][2]
    for name in ("gradient", *MEASURES, "U", "V"):
        assert np.abs(halves[name] - whole[name]).max() < 1e-9


def test_a_lost_point_stays_lost():
    totals = [affine(), affine(yy=1.1), affine(yy=1.2)]
    (_, first, total), (_, second, _) = run_all(totals)
    gone = total["U"].copy()
    gone[5, 5] = np.nan
    status = total["status"].copy()
    status[5, 5] = Status.UNTRACKED
    before = Product(
        "total",
        {**total.variables, "U": Variable(("row", "col"), gone), "status": Variable(("row", "col"), status)},
        total.attrs,
    )
    result = Accumulate().run(strain=second, total_before=before)
    for name in ("U", "V", "W", *MEASURES, "gradient", "xyz", "xyz_reference", "xy"):
        assert np.isnan(result[name][5, 5]).all()
        assert np.isfinite(result[name]).sum() == result[name].size - result[name][5, 5].size
    assert result["status"][5, 5] == Status.UNTRACKED
    assert not first["status"].any()


def test_thesis_sum_is_the_sum_of_increments_not_the_total():
    """n equal steps to the stretch λ: the sum is n (λ^(1/n) − 1), which tends to ln λ, far from λ − 1."""
    stretch, count = 2.2, 10
    _, _, total = run_all(powers((1.0, stretch), count), [cloud()] * (count + 1), "thesis", smooth=True)[-1]
    known = total["eyy"][np.isfinite(total["eyy"])]
    summed = count * (stretch ** (1 / count) - 1)
    assert np.median(known) == pytest.approx(summed, rel=0.01)
    assert np.log(stretch) < summed < 0.7 * (stretch - 1)
    shape = total["eyy"].shape
    assert shape == total["xy"].shape[:2]
    assert shape[0] == pytest.approx(120 * stretch / 3, abs=2)
    assert "gradient" not in total
    assert np.array_equal(np.isfinite(total["eyy"]), total["status"] <= Status.FILLED)
    assert "sum of" in total.attrs["measures"]["eyy"]


def test_thesis_displacement_is_carried_over_to_the_new_grid():
    """An empty cell at the edge takes the mean of up to three beside it: two cells away, in each of the steps."""
    totals = powers((0.9, 1.5), 3)
    _, _, total = run_all(totals, [cloud()] * 4, "thesis", smooth=True)[-1]
    known = np.isfinite(total["V"])
    y = total["xy"][..., 1]
    truth = 0.1 * (y - 40.0) * (1 - 1 / 1.5)
    error = np.abs((total["V"] - truth)[known])
    assert np.median(error) < 0.02
    assert error.max() < 3 * (2 * 3 * 0.1) * (1 - 1.5 ** (-1 / 3))
    assert known.mean() > 0.9


def test_thesis_totals_do_not_wear_away_in_many_steps():
    """Ten steps of a region whose border never falls on the grid: every cell with an increment has a total."""
    turned = [affine(1.0, 0.15, 0.1, f) for f in FACTORS]
    _, strain, total = run_all(turned, [cloud()] * 11, "thesis", smooth=True)[-1]
    assert np.array_equal(np.isfinite(total["V"]), np.isfinite(strain["V"]))
    assert np.isfinite(total["V"]).sum() * 9 == pytest.approx(60 * 120 * (2.2 - 0.015), rel=0.03)


def test_thesis_strain_of_one_step():
    _, strain, total = run_all([affine(), affine(xx=0.98, yy=1.05)], [cloud()] * 2, "thesis", smooth=True)[-1]
    assert np.nanmedian(strain["eyy"]) == pytest.approx(0.05, abs=0.002)
    assert np.nanmedian(strain["exx"]) == pytest.approx(-0.02, abs=0.002)
    assert np.array_equal(strain["eyy"], total["eyy"], equal_nan=True)


def test_strain_carries_what_is_accumulated():
    _, strain, _ = run_all([affine(), affine(yy=1.1)])[0]
    assert strain.kind == "strain_increment"
    assert {"U", "V", "W", "xy", "xyz", "xyz_reference", "gradient", "status", *MEASURES} == set(strain.variables)
    assert strain.attrs["window_points"] == [9, 5]


def test_a_window_too_small_is_refused():
    increment, _, _ = run_all([affine(), affine(yy=1.1)])[0]
    with pytest.raises(StageError, match="widen the window"):
        Strain(window=(5, 5), degree=4).run(increment=increment)


def test_thesis_step_without_any_point_has_no_strain():
    before, after = tracks([affine(), affine()])
    lost = np.full_like(after["transforms"], np.nan)
    empty = Product("track", {**after.variables, "transforms": Variable(("a", "b", "i", "j"), lost)}, after.attrs)
    blind = Product(
        "cloud", {**cloud().variables, "xyz": Variable(("row", "col", "k"), cloud()["xyz"] * np.nan)}, cloud().attrs
    )
    increment = Displacement(definition="thesis").run(track=empty, track_before=before, cloud=blind, cloud_before=blind)
    strain = Strain().run(increment=increment)
    assert np.isnan(strain["eyy"]).all()
    assert (strain["status"] > Status.FILLED).all()
