"""A crack opens between two halves that do not deform, measured from features with one camera."""

import numpy as np
import pytest
from blobs import Pattern

from dicflow.core.status import Status
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.stages.accumulate import Accumulate
from dicflow.stages.displacement import Displacement
from dicflow.stages.features import FindFeatures
from dicflow.stages.match import Match
from dicflow.stages.region import Region
from dicflow.stages.smooth import Smooth
from dicflow.stages.strain import Strain
from dicflow.stages.track import Track

pytestmark = pytest.mark.slow

SHAPE = (300, 260)
CRACK = 150.0
PATTERN = Pattern((15.0, 15.0, 245.0, 260.0))
WIDTHS = (0.0, 3.0, 8.0, 16.0)
TURN = np.deg2rad(0.4)
HALVES = {"polygons": [[(30, 30), (230, 30), (230, 148), (30, 148)], [(30, 152), (230, 152), (230, 250), (30, 250)]]}
CUT = {"rectangle": (30, 30, 230, 250), "cut": [[(20, CRACK), (240, CRACK)]]}


def opened(width):
    """The half below moves away, and turns a little."""
    angle = TURN * width / WIDTHS[-1]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def mapping(places):
        below = (places - [130, CRACK]) @ turn.T + [130 + 0.3 * width, CRACK + width]
        return np.where(places[..., 1:] > CRACK, below, places)

    return mapping


@pytest.fixture(scope="module")
def seen():
    images = [Images.write(PATTERN.photograph(SHAPE, opened(w), seed=k)) for k, w in enumerate(WIDTHS)]
    features = [FindFeatures().run(images=image) for image in images]
    pairs = [
        {
            "features": features[k],
            "features_before": features[k - 1],
            "images": images[k],
            "images_before": images[k - 1],
        }
        for k in range(1, len(images))
    ]
    return images[0], [(pair, Match().run(**pair)) for pair in pairs]


def measured(seen, region):
    """Tracks and totals of all steps."""
    first, pairs = seen
    where = Region(**region).run(images=first)
    tracks, totals = [Track(subsets=(2, 2)).run(region=where)], [None]
    for pair, matches in pairs:
        tracks.append(Track(subsets=(2, 2)).run(region=where, matches=matches, track_before=tracks[-1], **pair))
        increment = Displacement().run(track=tracks[-1], track_before=tracks[-2])
        smooth = Smooth(window=(80, 80)).run(increment=increment)
        strain = Strain(window=(80, 80)).run(increment=smooth)
        totals.append(Accumulate().run(strain=strain, total_before=totals[-1]))
    return tracks, totals[1:]


@pytest.mark.parametrize("region", [HALVES, CUT], ids=["polygons", "cut"])
def test_neither_tracks_nor_strains_reach_across_the_crack(seen, region):
    tracks, totals = measured(seen, region)
    places = tracks[0]["points"]
    for width, track, total in zip(WIDTHS[1:], tracks[1:], totals, strict=True):
        inside = np.isfinite(places[..., 0])
        error = np.linalg.norm(track["points"] - opened(width)(places), axis=-1)[inside]
        assert np.sqrt(np.mean(error**2)) < 0.03
        assert error.max() < 0.15
        status, away = total["status"], np.abs(places[..., 1] - CRACK)
        assert (status[inside] <= Status.FILLED).all()
        assert (status[inside & (away < 15)] == Status.FILLED).all()
        assert (status[inside & (away > 22)] == Status.VALID).all()
        for name in ("exx", "eyy", "gxy"):
            assert np.abs(total[name][inside & (away < 50) & (status == Status.VALID)]).max() <= 1e-3
            assert np.abs(total[name][inside & (away < 22)]).max() <= 2e-3


def test_without_parts_the_strain_is_that_of_the_opening(seen):
    """The measurement that the parts prevent."""
    _, totals = measured(seen, {"rectangle": (30, 30, 230, 250)})
    assert np.nanmax(totals[-1]["eyy"]) > 0.05


def test_the_thesis_s_definition_refuses_parts(seen):
    tracks, _ = measured(seen, HALVES)
    with pytest.raises(StageError, match="definition: material"):
        Displacement(definition="thesis").run(track=tracks[1], track_before=tracks[0])
