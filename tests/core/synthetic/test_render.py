import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.cameras.camera import Camera, camera_matrix, rotation_matrix
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.render import (
    Extent,
    GreyLevels,
    add_noise_and_round,
    extent_outline,
    pixel_shares,
    render_strip,
)
from dicflow.core.synthetic.speckle import darkness, scatter_speckles
from dicflow.core.synthetic.trace import image_of, material_at, trace

CAMERA = Camera(camera_matrix(900.0, (151.0, 197.0)), np.array([-0.11, 0.16, 4e-4, -3e-4, 0.02]), (300, 400))
STATE = Deformation(
    60.0, 20.0, 1.7, 0.5, 0.08, 0.02, -1.0, 0.4, rotation_matrix([0.05, 0.15, -0.04]), np.array([0.0, -50.0, 400.0])
)
EVERYWHERE = Extent(-1e9, 1e9, -1e9, 1e9)


def unit_pixels() -> tuple[np.ndarray, np.ndarray]:
    points = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0)), axis=-1)
    return points, np.broadcast_to(np.eye(2), (4, 5, 2, 2))


def test_a_ramp_integrates_to_its_value_at_the_centre():
    points, slopes = unit_pixels()
    ramp = pixel_shares(points, 0.3 * slopes, EVERYWHERE, lambda p: 0.02 * p[..., 0] + 0.01 * p[..., 1] + 0.1, 3).ink
    assert ramp == pytest.approx(0.02 * points[..., 0] + 0.01 * points[..., 1] + 0.1, abs=1e-15)


def test_a_parabola_integrates_with_its_second_moment():
    points, slopes = unit_pixels()
    ink = pixel_shares(points, 0.3 * slopes, EVERYWHERE, lambda p: p[..., 0] ** 2, 2).ink
    assert ink == pytest.approx(points[..., 0] ** 2 + 0.3**2 / 12.0, abs=1e-12)


def test_a_polynomial_of_fifth_degree_is_exact_with_three_points():
    points, slopes = unit_pixels()
    ink = pixel_shares(points, slopes, EVERYWHERE, lambda p: p[..., 0] ** 5, 3).ink
    x = points[..., 0]
    assert ink == pytest.approx(((x + 0.5) ** 6 - (x - 0.5) ** 6) / 6.0, rel=1e-12)


def test_pixels_without_material_show_nothing():
    points, slopes = unit_pixels()
    points[0, 0] = np.nan
    surface, ink = pixel_shares(points, slopes, EVERYWHERE, lambda p: np.ones(p.shape[:-1]), 3)
    assert surface[0, 0] == ink[0, 0] == 0.0
    assert surface.sum() == pytest.approx(19.0)


@settings(max_examples=40)
@given(st.floats(-10.0, 10.0), st.floats(-4.0, 64.0))
def test_material_at_inverts_image_of(x, y):
    assert material_at(CAMERA, STATE, image_of(CAMERA, STATE, [x, y])) == pytest.approx([x, y], abs=1e-9)


def test_trace_finds_every_pixels_material_and_its_slopes():
    box = (120, 150, 140, 171)
    points, slopes = trace(CAMERA, STATE, box, (0.0, 30.0))
    pixels = np.stack(np.meshgrid(np.arange(120, 140), np.arange(150, 171)), axis=-1).astype(float)
    assert image_of(CAMERA, STATE, points) == pytest.approx(pixels, abs=1e-9)
    h = 1e-4
    for axis, step in enumerate(h * np.eye(2)):
        ahead, behind = (material_at(CAMERA, STATE, pixels + s, (0.0, 30.0)) for s in (step, -step))
        assert slopes[..., axis] == pytest.approx((ahead - behind) / (2.0 * h), abs=1e-8)


def test_nothing_is_found_behind_the_camera():
    behind = STATE._replace(translation=np.array([0.0, 0.0, -400.0]))
    assert np.isnan(material_at(CAMERA, behind, [150.0, 200.0])).all()


def bare_look() -> GreyLevels:
    return GreyLevels(paper=1.0, ink=0.0, background=0.0, unevenness=0.0, light=(0.0, 0.0))


def test_the_strip_covers_the_area_of_its_outline():
    blank = scatter_speckles((20.0, 60.0), (0.5, 0.5), 0.1, coverage=1e-6)
    image = render_strip(
        CAMERA, STATE, blank._replace(radii=blank.radii * 0 + 1e-9, shapes=blank.shapes * 1e12), 4.0, bare_look()
    )
    x, y = image_of(CAMERA, STATE, extent_outline(Extent(-10.0, 10.0, -4.0, 64.0), 400)).T
    area = 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
    assert image.sum() == pytest.approx(area, rel=5e-4)


def test_each_pixel_shows_the_material_on_its_ray():
    speckles = scatter_speckles((20.0, 60.0), (3.0, 5.0), 0.3, seed=2)
    image = render_strip(CAMERA, STATE, speckles, 4.0, bare_look())
    material = np.random.default_rng(1).uniform([-9.0, 1.0], [9.0, 59.0], (400, 2))
    pixels = np.rint(image_of(CAMERA, STATE, material)).astype(int)
    around = material_at(CAMERA, STATE, pixels[:, None] + np.array([(i, j) for i in (-0.6, 0.6) for j in (-0.6, 0.6)]))
    inked = darkness(speckles, around)
    grey = image[pixels[:, 1], pixels[:, 0]]
    assert grey[(inked == 1.0).all(axis=1)].max() < 0.1
    assert grey[(inked == 0.0).all(axis=1)].min() > 0.9
    assert (inked == 1.0).all(axis=1).sum() > 50


def test_the_background_is_plain_and_untouched_by_the_strip():
    speckles = scatter_speckles((20.0, 60.0), (1.0, 2.0), 0.3)
    image = render_strip(CAMERA, STATE, speckles, 4.0, GreyLevels())
    assert image[:, :60].std() < 6.0
    assert np.abs(np.diff(image[:, :60], axis=1)).max() < 0.5
    assert image.shape == (400, 300)


def test_noise_has_its_standard_deviation_and_rounding_adds_a_twelfth():
    image = add_noise_and_round(np.full((400, 500), 100.3), 2.0, [1, 2])
    assert image.dtype == np.uint8
    assert image.mean() == pytest.approx(100.3, abs=0.02)
    assert image.std() == pytest.approx(np.sqrt(4.0 + 1.0 / 12.0), rel=0.01)
    assert np.array_equal(image, add_noise_and_round(np.full((400, 500), 100.3), 2.0, [1, 2]))


def test_exposure_saturates():
    assert add_noise_and_round(np.array([[-30.0, 300.0]]), 0.0, [1]).tolist() == [[0, 255]]
