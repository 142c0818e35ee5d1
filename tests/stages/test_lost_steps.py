"""Steps that cannot be measured in the thesis's form: each costs only itself."""

import numpy as np
import pytest
from analytic import SHAPE, affine, cloud, track, tracks, true_strain
from blobs import Pattern, stretched

from dicflow.core.status import Status
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.track import Track as TrackProduct
from dicflow.kinds.track import lost_track
from dicflow.stages.accumulate import Accumulate
from dicflow.stages.disparity import Disparity
from dicflow.stages.displacement import Displacement
from dicflow.stages.features import FindFeatures
from dicflow.stages.match import Match
from dicflow.stages.region import Region
from dicflow.stages.smooth import Smooth
from dicflow.stages.strain import Strain
from dicflow.stages.surface import Surface
from dicflow.stages.track import Track

PHOTOGRAPH = (300, 220)
FIXED = np.array([110.0, 30.0])
PATTERN = Pattern((30.0, 20.0, 190.0, 210.0))
OTHER = Pattern((30.0, 20.0, 190.0, 260.0), seed=9)
GAUGE = (45, 35, 175, 195)
STRETCHES = (1.0, 1.06, 1.13, 1.2, 1.27)
BLACK = np.zeros(PHOTOGRAPH, np.uint8)
DARK = np.clip(np.random.default_rng(0).normal(6, 2, PHOTOGRAPH), 0, 255).astype(np.uint8)
WHITE = np.full(PHOTOGRAPH, 255, np.uint8)
BURIED = OTHER.photograph(PHOTOGRAPH)


def photographs():
    return [PATTERN.photograph(PHOTOGRAPH, stretched(s, FIXED), seed=k) for k, s in enumerate(STRETCHES)]


def followed(grey):
    """The tracks of a series of photographs."""
    images = [Images.write(image) for image in grey]
    features = [FindFeatures().run(images=image) for image in images]
    region = Region(rectangle=GAUGE).run(images=images[0])
    found = [Track().run(region=region)]
    for k in range(1, len(images)):
        seen = {
            "features": features[k], "features_before": features[k - 1],
            "images": images[k], "images_before": images[k - 1],
        }  # fmt: skip
        found.append(Track().run(region=region, matches=Match().run(**seen), track_before=found[-1], **seen))
    return found


@pytest.fixture(scope="module")
def series():
    return photographs()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lost", "code", "text"),
    [
        ({2: BLACK}, Status.LOW_TEXTURE, "no texture in this left photograph"),
        ({4: DARK}, Status.LOW_TEXTURE, "no texture in this left photograph"),
        ({2: WHITE, 3: DARK}, Status.LOW_TEXTURE, "no texture in this left photograph"),
        ({1: BLACK, 3: BLACK}, Status.LOW_TEXTURE, "no texture in this left photograph"),
        ({2: BURIED}, Status.UNTRACKED, "3 × 3 subsets"),
    ],
    ids=["middle", "last", "neighbours", "alternate", "another picture"],
)
def test_a_photograph_that_shows_nothing_costs_its_own_step(series, lost, code, text):
    found = followed([lost.get(k, image) for k, image in enumerate(series)])
    for k, (step, stretch) in enumerate(zip(found, STRETCHES, strict=True)):
        if k in lost:
            assert np.isnan(step["points"]).all()
            assert (step["status"] == code).all()
            assert text in step.warnings[0]
            continue
        expected = stretched(stretch, FIXED)(found[0]["points"].reshape(-1, 2)).reshape(step["points"].shape)
        assert (step["status"] == Status.VALID).all()
        assert np.sqrt(np.mean((step["points"] - expected) ** 2)) < 0.03
        assert not step.warnings


@pytest.mark.slow
def test_without_photographs_the_steps_after_a_lost_one_are_lost_with_a_warning(series):
    images = [Images.write(image) for image in (series[0], BLACK, series[2])]
    features = [FindFeatures().run(images=image) for image in images]
    region = Region(rectangle=GAUGE).run(images=images[0])
    step = Track().run(region=region)
    for k in (1, 2):
        matches = Match().run(
            features=features[k], features_before=features[k - 1], images=images[k], images_before=images[k - 1]
        )
        step = Track().run(region=region, matches=matches, track_before=step)
        assert np.isnan(step["points"]).all()
        assert "no point is followed" in step.warnings[0]


def measured(totals, lost_tracks=(), lost_clouds=(), definition="material"):
    """Totals by the stages after the track and the clouds, some of which have no point."""
    found, clouds = tracks(totals), [cloud() for _ in totals]
    for k in lost_tracks:
        last = found[k - 1] if k - 1 not in lost_tracks else found[k - 2]
        empty = track(totals[k])
        nothing = np.full_like(empty["points"], np.nan)
        status = np.full(empty["status"].shape, Status.LOW_TEXTURE, np.uint8)
        variables = {
            **empty.variables,
            "points": Variable(("row", "col", "component"), nothing, "px"),
            "status": Variable(("row", "col"), status),
            "transforms": Variable(("subset_row", "subset_col", "i", "j"), np.full((3, 3, 3, 3), np.nan)),
        }
        state = TrackProduct.read(last).last
        found[k] = lost_track(Product("track", variables, last.attrs), state, None)
        found[k + 1] = track(totals[k + 1], totals[k - 1])
    for k in lost_clouds:
        clouds[k] = cloud(z=np.nan, status=Status.LOW_TEXTURE)
        clouds[k]["xyz"][:] = np.nan
    increments, results = None, [None]
    for k in range(1, len(totals)):
        pair = {"cloud": clouds[k], "cloud_before": clouds[k - 1], "increment_before": increments}
        increments = Displacement(definition=definition).run(track=found[k], track_before=found[k - 1], **pair)
        smooth = Smooth(window=(40, 20)).run(increment=increments)
        strain = Strain(window=(40, 20)).run(increment=smooth)
        results.append(Accumulate().run(strain=strain, total_before=results[-1]))
    return results[1:]


TOTALS = [affine(), affine(yy=1.1), affine(yy=1.25, xy=0.02), affine(yy=1.4, xy=0.04), affine(yy=1.5, xy=0.05)]


@pytest.mark.parametrize(
    "lost",
    [
        {"lost_clouds": (2,)},
        {"lost_clouds": (1,)},
        {"lost_clouds": (2, 3)},
        {"lost_tracks": (2,)},
        {"lost_tracks": (3,), "lost_clouds": (2,)},
    ],
    ids=["cloud", "first cloud", "neighbours", "track", "track after a cloud"],
)
def test_totals_go_on_from_the_last_step_that_has_points(lost):
    gone = {k for steps in lost.values() for k in steps}
    for k, total in enumerate(measured(TOTALS, **lost), start=1):
        if k in gone:
            assert np.isnan(total["U"]).all()
            assert (total["status"] == Status.LOW_TEXTURE).all()
            continue
        gradient, strain = true_strain(TOTALS[k])
        known = total["status"] == Status.VALID
        assert known.all()
        np.testing.assert_allclose(total["gradient"], np.broadcast_to(gradient, total["gradient"].shape), atol=1e-6)
        for name in ("exx", "eyy", "gxy"):
            np.testing.assert_allclose(total[name], getattr(strain, name), atol=1e-6)


@pytest.mark.parametrize("lost", [{"lost_clouds": (2,)}, {"lost_tracks": (2,)}], ids=["cloud", "track"])
def test_the_increment_of_the_thesis_spans_the_lost_step(lost):
    """Its sums of increments are those of a test without that step."""
    spanned = measured([*TOTALS[:2], *TOTALS[3:]], definition="thesis")
    total = measured(TOTALS, definition="thesis", **lost)
    assert np.isnan(total[1]["U"]).all()
    for name in ("V", "eyy"):
        np.testing.assert_allclose(total[2][name], spanned[1][name], atol=2e-3)


def textured(shift):
    """A pair whose right photograph shows the pattern farther left."""
    pattern = Pattern((0.0, 0.0, 220.0, 300.0), seed=4)
    left = pattern.photograph(PHOTOGRAPH)
    return left, pattern.photograph(PHOTOGRAPH, lambda places: places - [shift, 0.0])


def test_a_covered_camera_costs_the_disparities_of_its_step():
    left, right = textured(20.0)
    first = Disparity().run(pair=Images.write(left, right, "rectified"))
    for pair, side in (((left, BLACK), "right"), ((DARK, right), "left")):
        images = Images.write(*pair, "rectified")
        lost = Disparity().run(pair=images, disparity_first=first)
        assert np.isnan(lost["disparity"]).all()
        assert (lost["status"][:-1, :-1] == Status.LOW_TEXTURE).all()
        assert lost.warnings[0].startswith(f"no texture in this {side} photograph")
        with pytest.raises(StageError):
            Disparity().run(pair=images)


def test_a_range_that_does_not_fit_at_a_later_step_is_said():
    left, right = textured(20.0)
    first = Disparity().run(pair=Images.write(left, right, "rectified"))
    other = Images.write(left, Pattern((0.0, 0.0, 220.0, 300.0), seed=8).photograph(PHOTOGRAPH), "rectified")
    lost = Disparity().run(pair=other, disparity_first=first)
    assert np.isnan(lost["disparity"]).all()
    assert (lost["status"][:-1, :-1] == Status.NO_MATCH).all()
    assert "range" in lost.warnings[0]


def test_a_cloud_without_points_stays_empty():
    empty = cloud(status=Status.LOW_TEXTURE)
    empty["xyz"][:] = np.nan
    surface = Surface().run(cloud=empty)
    assert np.isnan(surface["xyz"]).all()
    assert surface["xyz"].shape == (*SHAPE, 3)
