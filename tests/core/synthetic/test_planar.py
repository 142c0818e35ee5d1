import numpy as np
import pytest

from dicflow.core.synthetic.planar import planar_pair, render_planar, translation
from dicflow.core.synthetic.render import Extent, GreyLevels
from dicflow.core.synthetic.speckle import scatter_speckles

EVERYWHERE = Extent(-1e9, 1e9, -1e9, 1e9)
INK = GreyLevels(paper=0.0, ink=1.0, background=0.0)


def one_dot(edge: float = 1.0):
    return scatter_speckles((30.0, 30.0), (8.0, 8.0), edge, coverage=1e-3, elongation=1.0, seed=3)


def centroid(image: np.ndarray) -> np.ndarray:
    rows, cols = np.indices(image.shape)
    return np.array([(cols * image).sum(), (rows * image).sum()]) / image.sum()


@pytest.mark.parametrize(("order", "tolerance"), [(3, 5e-4), (10, 1e-4)])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.37, -0.61), (0.5, 0.25)])
def test_a_dot_lands_where_the_shift_puts_it(shift, order, tolerance):
    dot, to_pixels = one_dot(edge=4.0), translation((30.0, 15.0))
    image = render_planar(dot, (60, 60), translation(shift) @ to_pixels, EVERYWHERE, INK, order)
    assert centroid(image) == pytest.approx(dot.centres[0] + [30.0, 15.0] + shift, abs=tolerance)


@pytest.mark.parametrize("edge", [1.0, 2.0])
def test_all_the_ink_of_a_dot_is_in_the_picture(edge):
    # the radius of a soft edge is spread with the variance edge²/20, so that the area is π (r² + edge²/20)
    image = render_planar(one_dot(edge), (60, 60), translation((30.0, 15.0)), EVERYWHERE, INK)
    assert image.sum() == pytest.approx(np.pi * (16.0 + edge**2 / 20.0), rel=1e-3)


def test_area_grows_by_the_determinant():
    stretch = np.array([[1.2, 0.1, 0.0], [-0.05, 0.9, 0.0], [0.0, 0.0, 1.0]])
    images = [
        render_planar(one_dot(), (80, 80), translation((35.0, 20.0)) @ m, EVERYWHERE, INK) for m in (np.eye(3), stretch)
    ]
    assert images[1].sum() / images[0].sum() == pytest.approx(np.linalg.det(stretch), rel=2e-3)


def test_a_projective_transform_carries_points():
    transform = np.array([[1.02, 0.03, 2.0], [-0.02, 0.97, 3.0], [4e-4, -3e-4, 1.0]]) @ translation((30.0, 15.0))
    dot = one_dot()
    image = render_planar(dot, (80, 80), transform, EVERYWHERE, INK)
    x, y, w = transform @ np.append(dot.centres[0], 1.0)
    assert centroid(image) == pytest.approx([x / w, y / w], abs=0.02)


def test_a_whole_pixel_shift_moves_the_same_greys():
    pair = planar_pair((90, 70), (3, -2), seed=5)
    assert np.array_equal(pair.reference[10:60, 10:80], pair.deformed[8:58, 13:83])
    assert pair.reference.std() > 30.0


def test_noise_and_seed():
    quiet, noisy = planar_pair((64, 48), (0, 0), seed=1), planar_pair((64, 48), (0, 0), noise=3.0, seed=1)
    difference = noisy.deformed.astype(float) - noisy.reference
    assert np.array_equal(quiet.reference, quiet.deformed)
    assert difference.std() == pytest.approx(3.0 * np.sqrt(2.0), rel=0.05)
    assert not np.array_equal(quiet.reference, planar_pair((64, 48), (0, 0), seed=2).reference)


def test_speckles_fill_both_images():
    turn = np.array([[0.9, -0.2, 20.0], [0.2, 0.9, -10.0], [0.0, 0.0, 1.0]])
    pair = planar_pair((120, 100), turn)
    for image in pair[:2]:
        blocks = image.reshape(10, 10, 12, 10).std(axis=(1, 3))
        assert blocks.min() > 20.0
