import numpy as np
import pytest
from blobs import Pattern

from dicflow.core.matching.detectors import DETECTORS
from dicflow.core.matching.features import Features, detect

pytestmark = pytest.mark.slow

IMAGE = Pattern((20, 20, 230, 210)).photograph((230, 250), seed=1)


@pytest.mark.parametrize("detector", DETECTORS)
def test_features_shift_with_the_image(detector):
    shifted = np.roll(IMAGE, (3, 5), axis=(0, 1))
    box = (60, 60, 190, 170)
    before = detect(IMAGE, detector, box=box)
    after = detect(shifted, detector, box=(65, 63, 195, 173))
    assert len(before.xy) > 50
    near = np.abs(before.xy[:, None] + [5, 3] - after.xy[None]).max(axis=2).min(axis=1)
    assert np.mean(near < 0.05) > 0.95


@pytest.mark.parametrize("detector", ["KAZE", "AKAZE", "SIFT"])
def test_pixel_centres_are_at_integers(detector):
    """An image turned by half a circle has its features where the turn puts them."""
    height, width = IMAGE.shape
    before, after = detect(IMAGE, detector, upright=False), detect(IMAGE[::-1, ::-1].copy(), detector, upright=False)
    turned = np.array([width - 1.0, height - 1.0]) - before.xy
    away = turned[:, None] - after.xy[None]
    nearest = away[np.arange(len(turned)), np.abs(away).max(axis=2).argmin(axis=1)]
    close = nearest[np.abs(nearest).max(axis=1) < 1.5]
    assert len(close) > 0.8 * len(before.xy)
    assert np.abs(np.median(close, axis=0)).max() < 0.03


@pytest.mark.parametrize("detector", DETECTORS)
def test_features_come_in_order_and_again_with_equal_bytes(detector):
    one, two = detect(IMAGE, detector), detect(IMAGE.copy(), detector)
    assert (np.diff(one.xy[:, 1]) >= 0).all()
    for a, b in zip(one, two, strict=True):
        assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize("detector", ["KAZE", "AKAZE", "ORB", "SIFT"])
def test_upright_features_have_no_orientation(detector):
    assert (detect(IMAGE, detector).angle == 0).all()
    assert np.ptp(detect(IMAGE, detector, upright=False).angle) > 180


def test_no_feature_outside_the_box():
    xy = detect(IMAGE, box=(50, 40, 150, 120)).xy
    assert (xy >= [50, 40]).all()
    assert (xy <= [149, 119]).all()


def test_the_strongest_are_kept_and_stay_spread_out():
    everything, few = detect(IMAGE), detect(IMAGE, max_features=200)
    assert len(few.xy) == 200 < len(everything.xy)
    assert few.response.mean() > everything.response.mean()
    share = [np.mean(f.xy[:, 0] < 125) for f in (everything, few)]
    assert share[1] == pytest.approx(share[0], abs=0.1)


def test_contrast_and_depth_of_the_photograph_do_not_matter():
    dim = (IMAGE.astype(np.uint16) * 20) + 400
    assert len(detect(dim).xy) == pytest.approx(len(detect(IMAGE).xy), rel=0.02)


@pytest.mark.parametrize("detector", DETECTORS)
def test_a_plain_image_has_no_features(detector):
    found = detect(np.full((100, 100), 128, dtype=np.uint8), detector)
    assert isinstance(found, Features)
    assert len(found.xy) == len(found.descriptors) == 0
    assert found.descriptors.dtype == detect(IMAGE, detector).descriptors.dtype
    assert found.descriptors.shape[1] == detect(IMAGE, detector).descriptors.shape[1]
