"""Material points followed through photographs whose motion is known exactly."""

import json
from itertools import pairwise

import numpy as np
import pytest

from dicflow.core.matching.transform import apply_transform, jacobian
from dicflow.core.photographs.pattern import pattern_of
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import interior
from dicflow.core.status import Status
from dicflow.core.synthetic.planar import planar_pair, render_planar, translation
from dicflow.core.synthetic.render import Extent, add_noise_and_round
from dicflow.core.synthetic.speckle import scatter_speckles
from dicflow.core.tensors import congruent
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.io.images import read_grey
from dicflow.stages.correlate import Correlate
from dicflow.stages.region import Region

pytestmark = pytest.mark.slow

SIZE, MIDDLE = (300, 420), np.array([150.0, 210.0])
SQUARE = [[80.0, 140.0], [220.0, 140.0], [220.0, 280.0], [80.0, 280.0]]
STRETCHES = (1.0, 1.2, 1.45, 1.75, 2.05, 2.3, 1.9, 1.5, 1.2, 1.0)


def photograph(grey):
    return Product("images", {"left": Variable(("row", "col"), grey, "grey level")})


def region(*rings):
    return Product("region", {}, {"polygons": [{"exterior": ring, "holes": []} for ring in rings]})


def follow(images, where=None, matches=None, **parameters):
    """The correlation of every step."""
    stage, photographs, steps = Correlate(**parameters), [photograph(image) for image in images], []
    for k, here in enumerate(photographs):
        before = {"images_before": photographs[k - 1], "correlation_before": steps[-1]} if k else {}
        pairs = matches[k] if matches is not None and k else None
        found = stage.run(
            images=here, images_first=photographs[0], region=where or region(SQUARE), matches=pairs, **before
        )
        assert json.loads(json.dumps(found.attrs)) == found.attrs
        steps.append(found)
    return steps


def error(first, found, transform):
    """Distance of every point from where it is (rows, cols) [px]; NaN where it has no value."""
    grid = first["xy"]
    return found["xy"] - apply_transform(transform, grid.reshape(-1, 2)).reshape(grid.shape)


def about_middle(matrix):
    transform = np.eye(3)
    transform[:2, :2] = matrix
    transform[:2, 2] = MIDDLE - np.asarray(matrix) @ MIDDLE
    return transform


def stretched(stretch):
    return about_middle(np.diag([stretch**-0.5, stretch]))


def series(transforms, changed=None, noise=1.0):
    """Photographs of one pattern; ``changed``: share of it that another pattern replaces in each."""
    patterns = [scatter_speckles((340, 460), (3.0, 7.0), 1.0, 0.45, seed=seed) for seed in (5, 6)]
    rest, extent = translation((0.5 * SIZE[0], -20.0)), Extent(-170.0, 170.0, 0.0, 460.0)
    images = []
    for k, transform in enumerate(transforms):
        share = 0.0 if changed is None else changed[k]
        parts = [(1.0 - share, patterns[0])] + [(share, patterns[1])] * int(share > 0.0)
        grey = sum(weight * render_planar(p, SIZE, transform @ rest, extent, order=2) for weight, p in parts)
        images.append(add_noise_and_round(grey, noise, [k]))
    return images


def known_matches(transforms, false=20):
    """Matched features of each step, a few of them false."""
    rng = np.random.default_rng(0)
    material = rng.uniform(60.0, 300.0, (150, 2))
    pairs = [None]
    for before, after in pairwise(transforms):
        source, target = (apply_transform(transform, material) for transform in (before, after))
        target = target + rng.normal(0.0, 0.2, target.shape)
        target[:false] = rng.uniform(0.0, 300.0, (false, 2))
        names = zip(("reference", "deformed"), (source, target), strict=True)
        pairs.append(Product("matches", {n: Variable(("match", "component"), v.astype(np.float32)) for n, v in names}))
    return pairs


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
def test_shift_of_a_fraction_of_a_pixel(shape_function):
    pair = planar_pair(SIZE, (0.37, -0.62))
    first, found = follow([pair.reference, pair.deformed], shape_function=shape_function, subset_size=31)
    assert (first["way"] == 0).all()
    assert np.nanmax(np.abs(first["xy"] - np.rint(first["xy"]))) == 0.0
    valid = found["status"] == Status.VALID
    assert valid.sum() > 0.95 * np.isfinite(first["xy"][..., 0]).sum()
    assert (found["way"][valid] == 1).all()
    away = error(first, found, pair.transform)[valid]
    assert np.abs(away.mean(axis=0)).max() < 2e-3
    assert away.std() < 0.01
    slope = found["gradient"][valid] - np.eye(2)
    assert np.sqrt((slope**2).mean()) < 3e-3
    assert found.attrs["summary"]["valid_share"] == pytest.approx(
        valid.sum() / (valid.sum() + (~valid & np.isfinite(first["xy"][..., 0])).sum()), abs=0.05
    )


def test_the_first_step_keeps_the_pattern_of_its_region():
    images = series([np.eye(3), np.eye(3)])
    first, second = follow(images, step_size=20)
    inside = interior([Polygon(np.array(SQUARE), ())], images[0].shape)
    assert first.attrs["pattern"] == pattern_of(images[0], inside)._asdict()
    assert "pattern" not in second.attrs


def test_noise_of_a_static_pair_and_the_spread_it_makes():
    pair = planar_pair(SIZE, (0.0, 0.0), noise=3.0)
    first, found = follow([pair.reference, pair.deformed], step_size=10)
    assert first.attrs["noise_source"] == "first photograph"
    assert found.attrs["noise_source"] == "static pair"
    assert found.attrs["noise_grey"] == pytest.approx(np.hypot(3.0, 12**-0.5), rel=0.02)
    variance = found["covariance"] + congruent(found["gradient"], found["template"])
    normalised = error(first, found, pair.transform) / np.sqrt(variance[..., [0, 2]])
    assert np.nanstd(normalised) == pytest.approx(1.0, abs=0.12)


def test_given_noise_is_taken():
    pair = planar_pair(SIZE, (0.2, 0.0), noise=1.0)
    images = [pair.reference, pair.deformed]
    one, two = (follow(images, step_size=20, noise=level, misfit=False)[1] for level in (1.0, 2.0))
    assert two.attrs["noise_source"] == "given"
    for name in ("covariance", "template"):
        np.testing.assert_allclose(two[name], 4.0 * one[name])


def noise_of(steps):
    return [(step.attrs["noise_grey"], step.attrs["noise_source"]) for step in steps]


def test_noise_stays_when_all_points_are_lost_and_found_again():
    """Two photographs give it; a step without points, and a still scene later, change nothing."""
    gone, still = translation((-500.0, 0.0)), np.eye(3)
    moved = follow(series([still, translation((5.3, 2.6)), gone, still], noise=3.0), step_size=14)
    assert moved[2].attrs["summary"]["points"] == 0
    assert moved[1].attrs["noise_source"] != "static pair"
    assert noise_of(moved[1:]) == [noise_of(moved)[1]] * 3
    had = moved[0]["status"] == Status.VALID
    np.testing.assert_allclose(moved[3]["template"][had], moved[1]["template"][had], rtol=1e-12)


def test_noise_waits_for_the_first_step_with_points():
    steps = follow(series([np.eye(3), translation((-500.0, 0.0)), np.eye(3)], noise=3.0), step_size=14)
    assert noise_of(steps)[1] == noise_of(steps)[0]
    assert steps[2].attrs["noise_source"] == "static pair"
    assert steps[2].attrs["noise_grey"] == pytest.approx(np.hypot(3.0, 12**-0.5), rel=0.03)


def test_misfit_counts_only_where_there_is_any():
    """Half of the pattern has been replaced: it moves the subsets far more than the noise can."""
    transforms = [np.eye(3), translation((0.3, 0.2))]
    clean, spoiled = series(transforms), series(transforms, changed=(0.0, 0.2))
    plain = follow(spoiled, step_size=14, misfit=False)[1]
    honest = follow(spoiled, step_size=14)
    normalised = error(honest[0], honest[1], transforms[1]) / np.sqrt(honest[1]["covariance"][..., [0, 2]])
    assert np.nanmedian(honest[1]["covariance"][..., 0]) > 10.0 * np.nanmedian(plain["covariance"][..., 0])
    assert 0.5 < np.nanstd(normalised) < 3.0
    assert np.nanmedian(follow(clean, step_size=14)[1]["covariance"][..., 0]) < 1e-4


def test_islands_far_away_without_matches():
    """Two islands, one with a hole, 130 px away in one step."""
    pair = planar_pair((420, 420), (95.0, -90.0), noise=2.0)
    polygons = [
        {
            "exterior": [[60, 120], [170, 120], [170, 360], [60, 360]],
            "holes": [[[100, 200], [130, 200], [130, 240], [100, 240]]],
        },
        {"exterior": [[200, 140], [290, 140], [290, 330], [200, 330]], "holes": []},
    ]
    first, found = follow([pair.reference, pair.deformed], Product("region", {}, {"polygons": polygons}), step_size=10)
    had = first["status"] == Status.VALID
    assert (found["status"][had] == Status.VALID).mean() > 0.99
    assert np.nanstd(error(first, found, pair.transform)) < 0.01
    assert (found["status"][~had] == first["status"][~had]).all()
    np.testing.assert_allclose(np.array(found.attrs["polygons"][1]["exterior"]).min(axis=0), (295.0, 50.0), atol=0.1)


@pytest.fixture(scope="module")
def loading():
    transforms = [stretched(stretch) for stretch in STRETCHES]
    return transforms, series(transforms), known_matches(transforms)


@pytest.mark.parametrize("update", ["on_demand", "never"])
def test_stretch_to_more_than_twice_and_back(loading, update):
    """The pattern stays the same, so every point is found directly, and its error does not grow with the steps."""
    transforms, images, matches = loading
    steps = follow(images, matches=matches, step_size=14, reference={"update": update})
    had = steps[0]["status"] == Status.VALID
    for found, transform in zip(steps[1:], transforms[1:], strict=True):
        assert (found["status"][had] == Status.VALID).all()
        assert (found["way"][had] == 1).all()
        assert np.nanstd(error(steps[0], found, transform)) < 0.02
        places = steps[0]["xy"][had]
        np.testing.assert_allclose(found["gradient"][had], jacobian(transform, places), atol=0.02)
    assert np.nanstd(error(steps[0], steps[-1], transforms[-1])) < 0.004


@pytest.fixture(scope="module")
def changing():
    transforms = [translation((3.0 * k, 1.5 * k)) @ stretched(1.0 + 0.04 * k) for k in range(7)]
    changed = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.0])
    return transforms, series(transforms, changed), known_matches(transforms)


def test_a_pattern_that_changes_needs_references(changing):
    transforms, images, matches = changing
    never = follow(images, matches=matches, step_size=14, reference={"update": "never"})
    assert not (never[5]["status"] == Status.VALID).any()
    steps = follow(images, matches=matches, step_size=14)
    had = steps[0]["status"] == Status.VALID
    assert (steps[1]["way"][had] == 1).all()
    for found, transform in zip(steps[4:6], transforms[4:6], strict=True):
        chained = found["way"] == 2
        assert chained[had].mean() > 0.9
        assert "reference" in found.attrs
        assert np.nanstd(error(steps[0], found, transform)) < 0.5
        assert np.nanmedian(found["covariance"][chained]) > np.nanmedian(steps[1]["covariance"])
        assert found.attrs["summary"]["chained_points"] == chained.sum()
    back = steps[6]
    assert (back["way"][had] == 1).mean() > 0.99
    assert "reference" not in back.attrs
    assert "reference_image" not in back
    assert np.nanstd(error(steps[0], back, transforms[6])) < 0.01


def test_a_reference_every_so_many_steps(changing):
    _, images, matches = changing
    steps = follow(images[:5], matches=matches, step_size=14, reference={"update": "every", "steps": 2})
    assert [step.attrs.get("reference", {}).get("age") for step in steps[:4]] == [None, 0, 1, 0]


def test_specimen_that_leaves_the_frame_and_returns():
    """Half of the points leave; nothing stops, and all have a value again when they are back."""
    transforms = [
        np.eye(3),
        translation((-60.0, 0.0)),
        translation((-150.0, 0.0)),
        translation((-500.0, 0.0)),
        np.eye(3),
    ]
    images = series(transforms)
    steps = follow(images, step_size=14)
    had = steps[0]["status"] == Status.VALID
    gone = had & (steps[0]["xy"][..., 0] < 150.0)
    assert (steps[1]["status"][had] == Status.VALID).mean() > 0.8
    assert (steps[2]["status"][gone] == Status.OUTSIDE).all()
    assert (steps[2]["status"][had & (steps[0]["xy"][..., 0] > 175.0)] == Status.VALID).all()
    assert (steps[3]["status"][had] == Status.OUTSIDE).all()
    assert np.isnan(steps[3]["xy"]).all()
    assert steps[3].attrs["summary"]["points"] == 0
    assert (steps[4]["status"] == steps[0]["status"]).all()


def test_specimen_that_is_gone_for_two_steps_is_outside():
    """By its last places and motion, though no photograph shows it."""
    shifts = (0.0, -70.0, -145.0, -225.0, -310.0, -145.0, 0.0)
    transforms = [translation((shift, 0.0)) for shift in shifts]
    steps = follow(series(transforms), step_size=14)
    had = steps[0]["status"] == Status.VALID
    for gone in steps[3:5]:
        assert gone.attrs["summary"]["points"] == 0
        assert (gone["status"][had] == Status.OUTSIDE).all()
    inside = had & (steps[0]["xy"][..., 0] > 175.0)
    assert (steps[5]["status"][inside] == Status.VALID).all()
    np.testing.assert_array_equal(steps[6]["status"], steps[0]["status"])
    assert np.nanstd(error(steps[0], steps[6], np.eye(3))) < 0.01


def test_a_photograph_in_the_dark_loses_points_that_are_not_outside():
    images = series([np.eye(3), translation((-4.0, 0.0))])
    steps = follow([*images, np.full_like(images[0], 20)], step_size=14)
    had = steps[0]["status"] == Status.VALID
    assert not np.isin(steps[2]["status"][had], (Status.VALID, Status.OUTSIDE)).any()


def test_a_later_photograph_that_is_overexposed_says_so():
    images = series([np.eye(3), translation((2.0, 1.0)), translation((-500.0, 0.0))])
    bright = np.where(images[1] > 150, 255, images[1]).astype(np.uint8)
    steps = follow([images[0], bright, images[2]], step_size=14)
    shares = [step.attrs["summary"]["overexposed_share"] for step in steps]
    assert shares[0] == 0.0
    assert shares[1] == pytest.approx((bright[142:281, 83:222] == 255).mean(), abs=0.01)


def test_threads_change_nothing():
    pair = planar_pair(SIZE, (1.4, 0.3), noise=1.0)
    one, two = (follow([pair.reference, pair.deformed], step_size=14, threads=n)[1] for n in (1, 2))
    for name, variable in one.variables.items():
        assert two[name].tobytes() == variable.values.tobytes()


def refused(image, ring=SQUARE, **parameters):
    with pytest.raises(StageError) as caught:
        follow([image], region(ring), **parameters)
    return str(caught.value)


def test_a_first_photograph_without_a_usable_pattern():
    grey = planar_pair(SIZE, (0.0, 0.0)).reference
    dull = (120.0 + 0.02 * grey).astype(np.uint8)
    assert "mean intensity gradient is 0." in refused(dull)
    assert "at least 1.5" in refused(dull)
    bright = np.where(grey > 150, 255, grey).astype(np.uint8)
    share = (bright[141:280, 81:220] == 255).mean()
    assert f"{100 * share:.0f} % of the region is overexposed" in refused(bright)
    coarse = planar_pair(SIZE, (0.0, 0.0), diameter=(12.0, 16.0)).reference
    message = refused(coarse, subset_size=15)
    assert "fewer than 3 speckles" in message
    assert 25 <= int(message.split("subset_size of ")[1].split()[0]) <= 49


def test_subset_larger_than_the_region():
    grey = planar_pair(SIZE, (0.0, 0.0)).reference
    message = refused(grey, [[100.0, 100.0], [130.0, 100.0], [130.0, 150.0], [100.0, 150.0]], subset_size=81)
    assert "no subset of 81 px" in message
    assert "take a subset_size of" in message


def test_necking_is_followed_to_the_last_photograph(shared_data):
    """A real tensile bar: stretch grows steadily to the neck, where it exceeds 1.4; no point folds or jumps."""
    folder = shared_data / "necking"
    images = [read_grey(path)[:, 60:780] for path in sorted(folder.glob("*.tif"))[::3]]
    where = Region(auto=True).run(images=photograph(images[0]))
    steps = follow(images, where, subset_size=41, step_size=24)
    last = steps[-1]
    along = last["gradient"][..., 1, 1]
    assert np.nanquantile(along, 0.995) > 1.4
    assert np.nanmin(along) > 0.97
    inside = steps[0]["status"] == Status.VALID
    lost = inside & (last["status"] != Status.VALID) & (last["status"] != Status.OUTSIDE)
    assert lost.sum() < 0.01 * inside.sum()
    length = np.diff(last["xy"][..., 1], axis=0) / 24.0
    assert 0.97 < np.nanmin(length) < np.nanmax(length) < 1.8
