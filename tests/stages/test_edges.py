"""Cracks, reflections, shadows, dark photographs, repeating patterns: every value is right, or lost with a reason."""

import json

import numpy as np
import pytest

from dicflow.core.correlation.edges import AT_EDGES
from dicflow.core.photographs.footprint import blurred
from dicflow.core.status import Status
from dicflow.core.synthetic.planar import render_planar, translation
from dicflow.core.synthetic.render import Extent, add_noise_and_round
from dicflow.core.synthetic.speckle import scatter_speckles
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.stages.correlate import Correlate
from dicflow.stages.deformation import Deformation
from dicflow.stages.region import Region

pytestmark = pytest.mark.slow

SIZE, MIDDLE = (260, 200), 100.0
Y, X = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
PATTERN = scatter_speckles((360, 300), (3.5, 6.5), 1.0, 0.48, seed=3)
EXTENT = Extent(-180.0, 180.0, 0.0, 300.0)
WHOLE = {"rectangle": (30.0, 30.0, 230.0, 170.0)}
TWO = {
    "polygons": [
        [[30.0, 30.0], [230.0, 30.0], [230.0, 97.0], [30.0, 97.0]],
        [[30.0, 103.0], [230.0, 103.0], [230.0, 170.0], [30.0, 170.0]],
    ]
}


def moved(u=0.0, v=0.0):
    """Grey levels of the pattern after a shift [px], without noise."""
    return render_planar(PATTERN, SIZE, translation((130.0 + u, -50.0 + v)), EXTENT, order=2)


def photograph(grey, seed):
    return add_noise_and_round(np.asarray(grey), 1.5, [seed])


def cracked(u, v, seed):
    """Both sides of a crack in the middle, the upper one moved by (−u, −v) and the lower one by (u, v) [px]."""
    grey = np.where(MIDDLE > Y, moved(-u, -v), moved(u, v))
    return photograph(np.where(np.abs(Y - MIDDLE) < v, 10.0, grey), seed)


def measured(images, region, counts=None, **parameters):
    """The correlation and the total of every step; ``counts``: pixels that do, in all but the first photograph."""
    masks = [{} if counts is None or k == 0 else {"left": counts} for k in range(len(images))]
    photographs = [Images.write(image, counts=mask) for image, mask in zip(images, masks, strict=True)]
    chosen, stage, steps = Region(**region).run(images=photographs[0]), Correlate(**parameters), []
    for k, here in enumerate(photographs):
        before = {"images_before": photographs[k - 1], "correlation_before": steps[-1]} if k else {}
        steps.append(stage.run(images=here, images_first=photographs[0], region=chosen, **before))
    return steps, [Deformation().run(points=step, points_first=steps[0]) for step in steps]


def errors(total, u, v):
    """Errors of U and V (n,) of the points with a value, and how many σ they are."""
    known = np.isfinite(total["U"])
    away = np.stack([(total["U"] - u)[known], (total["V"] - v)[known]])
    sigma = np.stack([total["sigma_U"][known], total["sigma_V"][known]])
    return np.abs(away).max(axis=0), (np.abs(away) / np.hypot(sigma, 0.005)).max(axis=0)


@pytest.mark.parametrize("motion", [(0.0, 2.0), (0.0, 0.4), (3.0, 0.0), (2.0, 1.0)])
@pytest.mark.parametrize("region", [TWO, {**WHOLE, "cut": [[(20.0, 100.0), (240.0, 100.0)]]}])
def test_two_sides_of_a_marked_crack(motion, region):
    """Almost all points are measured, right up to the crack, and neither side strains."""
    images = [photograph(moved(), 0), cracked(*motion, 1), cracked(2.0 * motion[0], 2.0 * motion[1], 2)]
    steps, totals = measured(images, region)
    side = np.sign(steps[0]["xy"][..., 1] - MIDDLE)
    for k in (1, 2):
        away, sigmas = errors(totals[k], k * motion[0] * side, k * motion[1] * side)
        assert away.max() < 0.05
        assert np.quantile(sigmas, 0.99) < 5.0
        for name in ("exx", "eyy"):
            assert np.nanmax(np.abs(totals[k][name])) < 2e-3
    assert (steps[2]["status"] == Status.VALID).sum() > 0.97 * (steps[0]["status"] == Status.VALID).sum()


def test_cuts_of_a_file(tmp_path):
    """A line beside a polygon in GeoJSON cuts it; too many places are refused."""
    ring = [[30, 30], [230, 30], [230, 170], [30, 170]]
    shapes = [
        {"type": "Polygon", "coordinates": [ring]},
        {"type": "LineString", "coordinates": [[20, 100], [240, 100]]},
    ]
    path = tmp_path / "r.geojson"
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": shapes}))
    image = Images.write(photograph(moved(), 0))
    found = Region(file=str(path)).run(images=image, file_path=path)
    assert found.attrs["cuts"] == [[[20.0, 100.0], [240.0, 100.0]]]
    assert found.attrs["area_px"] == pytest.approx(200.0 * 137.0)
    first = Correlate().run(images=image, images_first=image, region=found)
    assert sorted(np.unique(first["part"])) == [0, 1, 2]
    many = [[float(k % 200), float(k // 200)] for k in range(1001)]
    with pytest.raises(StageError, match=r"1,001 places, at most 1,000"):
        Region(**WHOLE, cut=[many]).run(images=image)


def test_a_cut_that_ends_inside_the_region():
    """A notch opens by a turn of its two sides about the tip; the points beside it see their own side only."""
    opening = 0.03 * np.maximum(130.0 - X, 0.0)
    grey = np.where(
        np.abs(Y - MIDDLE) < opening,
        10.0,
        np.where(MIDDLE > Y, _sheared(-0.03), _sheared(0.03)),
    )
    steps, totals = measured(
        [photograph(moved(), 0), photograph(grey, 1)], {**WHOLE, "cut": [[(20.0, 100.0), (130.0, 100.0)]]}
    )
    places = steps[0]["xy"]
    side = np.sign(places[..., 1] - MIDDLE)
    left = places[..., 0] < 110.0
    truth = np.where(left, 0.03 * np.maximum(130.0 - places[..., 0], 0.0) * side, np.nan)
    wrong = np.abs(totals[1]["V"] - truth)[left]
    assert np.isfinite(wrong).mean() > 0.9
    assert np.nanmax(wrong) < 0.06
    assert np.nanmax(np.abs(totals[1]["eyy"])[left & (places[..., 0] < 90.0)]) < 3e-3
    assert opening.max() > 2.0


def _sheared(slope):
    """The pattern moved along y by slope · (130 − x) left of x = 130."""
    transform = np.array([[1.0, 0.0, 130.0], [0.0, 1.0, -50.0], [0.0, 0.0, 1.0]])
    shear = np.array([[1.0, 0.0, 0.0], [-slope, 1.0, 130.0 * slope], [0.0, 0.0, 1.0]])
    left = render_planar(PATTERN, SIZE, shear @ transform, EXTENT, order=2)
    return np.where(X < 130.0, left, moved())


@pytest.mark.parametrize("motion", [(0.0, 2.0), (0.0, 4.0), (3.0, 0.0), (1.5, 1.5)])
def test_an_unmarked_crack_loses_points_but_gives_no_wrong_place(motion):
    images = [photograph(moved(), 0), cracked(*motion, 1), cracked(2.0 * motion[0], 2.0 * motion[1], 2)]
    steps, totals = measured(images, WHOLE)
    side = np.sign(steps[0]["xy"][..., 1] - MIDDLE)
    for k in (1, 2):
        away, sigmas = errors(totals[k], k * motion[0] * side, k * motion[1] * side)
        assert sigmas.max() < 6.0
        assert np.quantile(away, 0.95) < 0.05
        assert len(away) > 0.7 * (steps[0]["status"] == Status.VALID).sum()
    assert (steps[1]["status"] == Status.DISCONTINUITY).sum() > 10


def test_beside_a_small_unmarked_crack_places_are_lost_or_uncertain():
    steps, totals = measured([photograph(moved(), 0), cracked(0.0, 0.5, 1)], WHOLE)
    side = np.sign(steps[0]["xy"][..., 1] - MIDDLE)
    away, sigmas = errors(totals[1], 0.0 * side, 0.5 * side)
    assert away.max() < 0.2
    assert sigmas.max() < 6.0
    assert len(away) > 0.7 * (steps[0]["status"] == Status.VALID).sum()


@pytest.mark.parametrize("opening_px", [1.0, 1.7])
def test_points_beside_an_unmarked_crack_are_lost_or_right(opening_px):
    """Of the points whose subset touches it; those farther than a subset away are measured."""
    steps, totals = measured([photograph(moved(), 0), cracked(0.0, opening_px, 1)], WHOLE)
    away = steps[0]["xy"][..., 1] - MIDDLE
    known = steps[0]["status"] == Status.VALID
    error = np.abs(totals[1]["V"] - opening_px * np.sign(away))
    wrong = error > 3.0 * np.hypot(totals[1]["sigma_V"], 0.005)
    touching, far = known & (np.abs(away) < 16.0), known & (np.abs(away) > 31.0)
    assert wrong[touching].mean() <= 0.02
    assert (steps[1]["status"] == Status.VALID)[far].mean() >= 0.9


@pytest.mark.parametrize("sigma_px", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("soft", [0, 1])
def test_a_photograph_out_of_focus(sigma_px, soft):
    """Almost all points are found, and σ is that of their errors. soft : the photograph that is blurred"""
    greys = [np.asarray(moved(), dtype=np.float32), np.asarray(moved(3.3, -1.7), dtype=np.float32)]
    greys[soft] = blurred(greys[soft], sigma_px**2 * np.eye(2))
    steps, totals = measured([photograph(grey, seed) for seed, grey in enumerate(greys)], WHOLE, step_size=14)
    known = steps[0]["status"] == Status.VALID
    assert (steps[1]["status"] == Status.VALID)[known].mean() >= 0.97
    errors_over_sigma = np.concatenate(
        [((totals[1][name] - truth) / totals[1][f"sigma_{name}"])[known] for name, truth in (("U", 3.3), ("V", -1.7))]
    )
    assert np.nanmean(np.abs(errors_over_sigma) < 1.0) == pytest.approx(0.70, abs=0.12)
    assert np.nanmean(np.abs(errors_over_sigma) < 3.0) > 0.97


def test_a_reflection_that_stands_still():
    glare = 420.0 * np.exp(-((((X - 130.0) / 45.0) ** 2 + ((Y - 100.0) / 30.0) ** 2) ** 2))
    images = [photograph(moved(3.3 * k, -1.7 * k) + glare, k) for k in range(3)]
    steps, totals = measured(images, WHOLE)
    assert (steps[0]["status"] == Status.OVEREXPOSED).sum() > 20
    for k in (1, 2):
        away, _ = errors(totals[k], 3.3 * k, -1.7 * k)
        assert away.max() < 0.1
        assert len(away) > 200
        assert np.isin(steps[k]["status"], AT_EDGES).sum() > 20


def test_white_paint_that_is_clipped_moves_with_the_specimen():
    """A quarter of the pixels is white; they do not count, and no point is lost."""
    light = 1.28 + 0.15 * X / SIZE[0]
    images = [photograph(moved(3.3 * k, -1.7 * k) * light + 8.0, k) for k in range(2)]
    assert 0.05 < (images[0][30:170, 30:230] == 255).mean() < 0.25
    steps, totals = measured(images, WHOLE)
    away, _ = errors(totals[1], 3.3, -1.7)
    assert away.max() < 0.05
    assert (steps[1]["status"] == Status.VALID).sum() > 0.97 * np.isfinite(steps[0]["xy"][..., 0]).sum()


def test_pixels_that_show_nothing_do_not_count():
    """What a mask hides in the second photograph is no place of any point."""
    shown = ((X - 130.0) / 30.0) ** 2 + ((Y - 100.0) / 20.0) ** 2 > 1.0
    hidden = photograph(moved(50.0, 40.0), 9)
    images = [photograph(moved(), 0), np.where(shown, photograph(moved(3.3, -1.7), 1), hidden)]
    steps, totals = measured(images, WHOLE, counts=shown)
    away, _ = errors(totals[1], 3.3, -1.7)
    assert away.max() < 0.08
    assert (steps[1]["status"] == Status.OVEREXPOSED).any()


def test_the_edge_of_a_shadow_that_wanders():
    images = [
        photograph(moved(3.3 * k, -1.7 * k) * (1.0 - 0.65 / (1.0 + np.exp(-(X - 80.0 - 50.0 * k) / 2.0))), k)
        for k in range(3)
    ]
    steps, totals = measured(images, WHOLE)
    for k in (1, 2):
        away, sigmas = errors(totals[k], 3.3 * k, -1.7 * k)
        assert away.max() < 0.12
        assert np.quantile(sigmas, 0.995) < 6.0
        assert np.nanmax(np.abs(totals[k]["exx"]) / totals[k]["sigma_exx"]) < 8.0
        assert len(away) > 0.6 * (steps[0]["status"] == Status.VALID).sum()


def test_good_photographs_lose_nothing():
    """Slow changes of the light, a stretch, a wave of half a pixel and noise are no edges."""
    light = 0.8 + 0.3 * X / SIZE[0] + 0.1 * np.sin(Y / 40.0)
    images = [photograph(moved(), 0), photograph(moved(5.3, -2.2) * light, 1), photograph(moved(10.6, -4.4), 2)]
    steps, _ = measured(images, WHOLE)
    for step in steps[1:]:
        assert not np.isin(step["status"], (*AT_EDGES, Status.OUTLIER, Status.OVEREXPOSED)).any()


@pytest.mark.parametrize("bad", ["black", "uniform", "noise"])
def test_a_photograph_without_the_specimen_costs_its_own_step_only(bad):
    rng = np.random.default_rng(0)
    grey = {"black": 0.0 * X, "uniform": 0.0 * X + 128.0, "noise": rng.normal(90.0, 20.0, X.shape)}[bad]
    images = [photograph(moved(7.3 * k, -4.1 * k), k) for k in range(5)]
    images[2] = np.rint(grey).astype(np.uint8)
    steps, totals = measured(images, WHOLE)
    assert not np.isfinite(totals[2]["U"]).any()
    assert set(np.unique(steps[2]["status"])) <= {
        Status.LOW_TEXTURE,
        Status.UNTRACKED,
        Status.CUT_SUBSET,
        Status.OUTSIDE,
    }
    (text,) = steps[2].attrs["warnings"]
    assert ("no texture" in text) == (bad != "noise")
    for k in (1, 3, 4):
        away, _ = errors(totals[k], 7.3 * k, -4.1 * k)
        assert away.max() < 0.05
        assert (steps[k]["status"] == Status.VALID).sum() > 0.95 * (steps[0]["status"] == Status.VALID).sum()


def test_a_repeating_pattern_is_followed_within_half_a_period():
    """Dots every 14 px, moved by 5 px a step, and once by 10, which looks like −4."""

    def dots(u):
        away = np.hypot((X - u) % 14.0 - 7.0, Y % 14.0 - 7.0)
        return photograph(210.0 - 170.0 / (1.0 + np.exp((away - 4.2) / 0.6)), int(u))

    steps, totals = measured([dots(u) for u in (0, 5, 10, 15)], WHOLE)
    (text,) = steps[0].attrs["warnings"]
    assert "14.0 px" in text
    assert "7.0 px" in text
    for k in (1, 2, 3):
        away, _ = errors(totals[k], 5.0 * k, 0.0)
        assert away.max() < 0.05
    steps, totals = measured([dots(0), dots(10)], WHOLE)
    away, _ = errors(totals[1], -4.0, 0.0)
    assert away.max() < 0.05


def test_a_repeating_pattern_after_a_lost_step_starts_from_the_first_photograph():
    """Of which only the part around the region is kept, away from the photograph's corner."""

    def dots(u):
        away = np.hypot((X - u) % 14.0 - 7.0, Y % 14.0 - 7.0)
        return photograph(210.0 - 170.0 / (1.0 + np.exp((away - 4.2) / 0.6)), int(u))

    steps, totals = measured([dots(0), np.zeros_like(dots(0)), dots(3)], {"rectangle": (110.0, 90.0, 230.0, 170.0)})
    away, _ = errors(totals[2], 3.0, 0.0)
    assert len(away) > 0.9 * (steps[0]["status"] == Status.VALID).sum()
    assert away.max() < 0.05


def test_cuts_with_doubled_or_dense_places():
    image = Images.write(photograph(moved(), 0))
    line = [(30.0 + 0.5 * k, 100.0 + 0.3 * (k % 2)) for k in range(300)]
    whole = Region(**WHOLE, cut=[[(30.0, 100.0), (30.0, 100.0), (179.5, 100.0)]]).run(images=image)
    dense = Region(**WHOLE, cut=[line]).run(images=image)
    assert whole.attrs["area_px"] == pytest.approx(200.0 * 140.0 - 3.0 * 151.0, abs=3.0)
    assert dense.attrs["area_px"] == pytest.approx(whole.attrs["area_px"], abs=10.0)
    with pytest.raises(StageError, match="one place only"):
        Region(**WHOLE, cut=[[(100.0, 100.0), (100.0, 100.0)]]).run(images=image)


def test_stripes_are_refused():
    stripes = photograph(125.0 + 80.0 * np.tanh(2.0 * np.sin(2.0 * np.pi * X / 9.0)), 0)
    with pytest.raises(StageError, match="stripes"):
        measured([stripes, stripes], WHOLE)
