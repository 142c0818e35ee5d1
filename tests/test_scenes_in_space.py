import numpy as np
import pytest

from dicflow.core.cameras.camera import project as project_in_camera
from dicflow.core.cameras.camera import to_right
from dicflow.pipeline import Pipeline
from tests.measured_scenes import measured_step
from tests.scenes_in_space import SCENES, gentle, scene
from tests.scenes_in_space.cameras import LEFT, RIG, RIGHT, SIZE, project
from tests.scenes_in_space.files import write_scene
from tests.scenes_in_space.rendering import clean, interpolated, material_at, material_table, seen_box
from tests.scenes_in_space.specimen import bounds, rectangle, turned
from tests.scenes_in_space.truth import (
    Material,
    crack_distance,
    gauge_strain,
    material_of,
    rim_distance,
    ring_in_photograph,
    truth,
)


def inner_pixels(count):
    return np.random.default_rng(3).uniform([350.0, 250.0], [650.0, 550.0], (count, 2))


def test_both_cameras_project_as_their_rig_says():
    points = np.random.default_rng(0).uniform(-30.0, 30.0, (50, 3))
    left = points @ LEFT.rotation.T + LEFT.translation
    assert project(LEFT, points) == pytest.approx(project_in_camera(RIG.left, left), abs=1e-9)
    assert project(RIGHT, points) == pytest.approx(project_in_camera(RIG.right, to_right(RIG, left)), abs=1e-9)


@pytest.mark.parametrize("name", SCENES)
def test_the_region_stays_in_both_photographs(name):
    selected = scene(name)
    for load in selected.loads:
        for view in (LEFT, RIGHT):
            pixels = project(view, selected.parts[0].place(selected.outline, load))
            assert (pixels > 10.0).all()
            assert (pixels < np.array(SIZE) - 11.0).all()


def test_material_at_a_pixel_projects_to_it():
    selected, pixels = scene("bend"), inner_pixels(200)
    part = selected.parts[0]
    for view in (LEFT, RIGHT):
        material = material_at(view, part, 1.0, pixels)
        assert project(view, part.place(material, 1.0)) == pytest.approx(pixels, abs=1e-6)


def test_a_ray_that_misses_the_surface_has_no_material():
    assert np.isnan(material_at(LEFT, scene("bend").parts[0], 1.0, np.array([[50.0, 400.0]]))).all()


def test_a_tilt_moves_rigidly_without_strain():
    selected = scene("tilt")
    material = material_of(selected, inner_pixels(100))
    exact = truth(selected, material, 2)
    flat = np.column_stack([material.points, np.zeros(100)])
    moved = turned(flat, (0.0, np.radians(30.0), 0.0)) - flat
    for axis, name in enumerate("UVW"):
        assert exact[name] == pytest.approx(moved[:, axis], abs=1e-12)
    for name in ("exx", "eyy", "gxy"):
        assert exact[name] == pytest.approx(0.0, abs=1e-9)


def test_bending_keeps_lengths():
    selected = scene("bend")
    exact = truth(selected, material_of(selected, inner_pixels(100)), 3)
    for name in ("exx", "eyy", "gxy"):
        assert exact[name] == pytest.approx(0.0, abs=1e-8)


def test_strains_of_a_sheared_plate_follow_from_its_gradient():
    selected = scene("fastener")
    exact = truth(selected, material_of(selected, np.array([[300.0, 300.0]])), 2)
    assert exact["exx"] == pytest.approx(0.02, abs=1e-9)
    assert exact["eyy"] == pytest.approx(-0.01, abs=1e-9)
    assert exact["gxy"] == pytest.approx(0.0, abs=1e-9)


def test_material_belongs_to_the_side_of_the_crack_that_it_lies_on():
    selected = scene("crack")
    ring = np.array([[-20.0, -0.1], [-20.0, 0.1]])
    material = material_of(selected, ring_in_photograph(selected, ring))
    assert material.points == pytest.approx(ring, abs=1e-6)
    opening = truth(selected, Material(ring, material.part), 2)["V"]
    tip = 30.0 / 44.0
    assert np.diff(opening) == pytest.approx(3.0 * tip**2, rel=0.01)


def test_rims_are_edges_holes_and_cracks():
    selected = scene("hole")
    corner, rim, middle = ring_in_photograph(selected, np.array([[-25.0, -25.0], [2.5, 0.0], [12.0, 0.0]]))
    away = rim_distance(selected, np.array([corner, rim, middle]))
    assert away[:2] == pytest.approx(0.0, abs=1.5)
    assert away[2] == pytest.approx(np.linalg.norm(middle - rim), abs=1.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_interpolated_material_is_exact(name):
    selected = scene(name)
    load, (x, y) = selected.loads[-1], np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    pixels = np.stack([x, y], axis=-1) + 1.0 / 3.0
    for part in selected.parts:
        table = material_table(RIGHT, part, load)
        x0, x1, y0, y1 = box = seen_box(table)
        found = interpolated(table, 1.0 / 3.0, 1.0 / 3.0, box)
        seen = part.holds(found[..., :2])
        errors = np.linalg.norm(project(RIGHT, part.place(found[seen, :2], load)) - pixels[y0:y1, x0:x1][seen], axis=-1)
        assert seen.any()
        assert np.quantile(errors, 0.999) < 1e-3


@pytest.mark.slow
def test_photographs_show_speckles_before_a_background_and_a_part_in_front():
    grey = clean(LEFT, scene("fastener"), 0.0)
    middle = project(LEFT, np.array([[0.0, 0.0, -3.0], [20.0, 0.0, 0.0]])).astype(int)
    assert grey[5, 5] == pytest.approx(65.0)
    assert grey[middle[0, 1], middle[0, 0]] == pytest.approx(95.0)
    speckled = grey[middle[1, 1] - 40 : middle[1, 1] + 40, middle[1, 0] - 40 : middle[1, 0] + 40]
    assert speckled.std() > 35.0


@pytest.mark.slow
def test_without_noise_a_scene_is_measured_as_its_truth_says(tmp_path):
    """Away from rims all errors are below what noise of two grey levels causes there, and a third of it in the mean.

    Where the degree is chosen point by point, windows of a high degree have larger errors, as they state.
    """
    half_width, half_height = 11.0, 9.0
    sheet = gentle.SCENE.parts[0]._replace(bounds=bounds(half_width, half_height))
    small = gentle.SCENE._replace(
        loads=(0.0, 0.02), parts=(sheet,), outline=rectangle(-half_width, -half_height, half_width, half_height)
    )
    write_scene(tmp_path, small, [None])
    fixed, chosen = (
        measured_step(small, Pipeline.load(tmp_path / "None" / "pipeline.yaml", settings=settings).run(), 1)
        for settings in (["total.degree=2"], [])
    )
    fixed, chosen = (points.of(~points.on_rim) for points in (fixed, chosen))
    assert len(fixed.status) > 450
    assert fixed.valid.all()
    assert chosen.valid.all()
    caused_by_noise = {"U": 3.4e-4, "V": 2.8e-4, "W": 1.5e-3, "exx": 8.5e-5, "eyy": 8.3e-5, "gxy": 1.2e-4}
    for quantity, noise in caused_by_noise.items():
        assert np.abs(fixed.error[quantity]).max() < noise
        assert (np.abs(chosen.error[quantity]) < np.maximum(noise, 3.0 * chosen.stated[quantity])).all()
        for points in (fixed, chosen):
            assert np.sqrt(np.mean(points.error[quantity] ** 2)) < noise / 3.0
            assert abs(np.median(points.error[quantity])) < noise / 10.0


def test_a_square_reaches_a_crack_from_the_distance_of_its_half_side():
    selected = scene("crack")
    before, tip = ring_in_photograph(selected, np.array([[-20.0, 0.0], [10.0, 0.0]]))
    away = crack_distance(selected, np.array([before, before + np.array([0.0, 20.0]), tip + np.array([30.0, 25.0])]))
    assert away == pytest.approx([0.0, 20.0, 30.0], abs=1.5)


def test_an_extensometer_along_a_strip_measures_its_stretch():
    selected = scene("strip")
    gauge = np.array([[0.0, -10.0], [0.0, 10.0]])
    assert gauge_strain(selected, gauge, 8) == pytest.approx(1.19, abs=1e-9)
