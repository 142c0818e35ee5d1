import numpy as np
import pytest
from scenes import grey, texture

from dicflow.core.matching import fft_search
from dicflow.core.matching.fft_search import correlation_peak, fft_matches

pytestmark = pytest.mark.slow


def scene(shape, dx=0.0, dy=0.0, noise=0.0, seed=0):
    """A texture shifted by (dx, dy) [px]."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    return grey(texture(x - dx, y - dy), noise, seed).astype(float)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (37.0, -21.0), (-83.0, 60.0)])
def test_whole_shift_of_a_window(shift):
    whole = scene((200, 240), *shift)
    window = scene((200, 240))[70:140, 90:170]
    found = correlation_peak(window, whole)
    np.testing.assert_allclose(found.shift, np.add(shift, (90, 70)), atol=0.02)
    assert found.correlation == pytest.approx(1.0, abs=1e-3)


def test_fraction_of_a_pixel():
    found = correlation_peak(scene((200, 240))[60:120, 60:120], scene((200, 240), 12.3, -7.4))
    np.testing.assert_allclose(found.shift, (72.3, 52.6), atol=0.05)


def test_window_over_the_edge():
    """A quarter of the window is outside the image; the rest gives the position."""
    found = correlation_peak(scene((120, 120))[20:80, 10:70], scene((120, 120), -25.0, 0.0))
    np.testing.assert_allclose(found.shift, (-15.0, 20.0), atol=0.05)
    assert found.correlation > 0.99


def test_unusable_pixels_do_not_count():
    window, usable = scene((200, 240))[70:140, 90:170], np.ones((70, 80), dtype=bool)
    usable[:, :30] = False
    spoiled = np.where(usable, window, 7.0 * np.arange(80))
    found = correlation_peak(spoiled, scene((200, 240), 30.0, 20.0), usable)
    np.testing.assert_allclose(found.shift, (120.0, 90.0), atol=0.02)


def test_other_light_changes_nothing():
    window, image = scene((200, 240))[70:140, 90:170], scene((200, 240), 15.0, 5.0)
    first, second = correlation_peak(window, image), correlation_peak(0.4 * window + 70.0, image)
    np.testing.assert_allclose(first.shift, second.shift, atol=1e-6)
    assert first.correlation == pytest.approx(second.correlation)


def test_nothing_is_found_in_a_plain_image():
    assert correlation_peak(scene((50, 50)), np.full((90, 90), 50.0)).correlation == -1.0


@pytest.mark.parametrize(
    ("stretch", "separate_windows"), [(1.0, False), (1.03, False), (1.1, True), (1.3, True), (0.8, True)]
)
def test_pairs_of_windows(stretch, separate_windows):
    y, x = np.mgrid[:360, :420].astype(float)
    middle = np.array([180.0, 170.0])
    reference = grey(texture(x, y), 2.0, 1)
    back = (np.stack([x, y], axis=-1) - (60.0, 25.0) - middle) / (1.0, stretch) + middle
    target = grey(texture(back[..., 0], back[..., 1]), 2.0, 2)
    usable = np.zeros(x.shape, dtype=bool)
    usable[70:280, 60:310] = True
    usable[140:190, 150:220] = False
    source, found = fft_matches(reference, target, usable, separate_windows=separate_windows)
    truth = (source - middle) * (1.0, stretch) + middle + (60.0, 25.0)
    assert len(source) > 30
    assert np.abs(found - truth).max() < 0.5
    assert np.median(np.abs(found - truth)) < 0.05


@pytest.mark.parametrize("off", [(9.0, 0.0), (-9.0, 5.0), (14.0, 14.0), (-13.0, -15.0)])
def test_guided_windows_correct_a_prediction_in_every_direction(off):
    """Every one of the windows is found, on whichever side of its predicted place it lies."""
    y, x = np.mgrid[:300, :300].astype(float)
    usable = np.zeros(x.shape, dtype=bool)
    usable[50:250, 50:250] = True
    centres = fft_search._window_centres(usable, fft_search.WINDOW_PX, 16)
    predicted = np.array([[150.0, 150.0]]), np.array([[150.0, 150.0]])
    views = np.float32(texture(x, y)), np.float32(texture(x - off[0], y - off[1])), usable
    source, found = fft_search._guided_window_matches(views, centres, 2, predicted, 24)
    assert len(source) == len(centres)
    np.testing.assert_allclose(found - source, np.broadcast_to(off, found.shape), atol=0.05)
