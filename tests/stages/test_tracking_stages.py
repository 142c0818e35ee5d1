import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from blobs import Pattern, stretched
from PIL import Image
from pydantic import ValidationError

from dicflow.core.cameras.camera import Camera, Rig
from dicflow.core.cameras.rectification import raw_to_rectified, rectification
from dicflow.core.matching.detectors import DETECTORS
from dicflow.core.matching.steps import Matching
from dicflow.core.photographs.region import area, bounding_box, contains
from dicflow.core.status import Status
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.matches import Matches
from dicflow.kinds.region import polygons_from_json
from dicflow.kinds.rig import CalibratedRig
from dicflow.stages.features import FindFeatures
from dicflow.stages.match import Match
from dicflow.stages.region import Region
from dicflow.stages.track import Track

pytestmark = pytest.mark.slow

SPECIMEN = (40.0, 30.0, 200.0, 230.0)
SHAPE = (340, 240)
PATTERN = Pattern(SPECIMEN)
FIXED = np.array([120.0, 30.0])


def images(grey, kind="images"):
    return Images.write(grey, kind=kind)


def photograph(mapping=None, seed=1):
    return images(PATTERN.photograph(SHAPE, mapping, seed=seed))


def follow(photographs, region, match=None, track=None, features=None):
    """All tracks of a series, and the matches of its last pair."""
    features, match, track = features or FindFeatures(), match or Match(), track or Track()
    found = [features.run(images=photograph) for photograph in photographs]
    tracks, matches = [track.run(region=region)], None
    for k in range(1, len(photographs)):
        matches = match.run(
            features=found[k], features_before=found[k - 1], images=photographs[k], images_before=photographs[k - 1]
        )
        tracks.append(track.run(region=region, matches=matches, track_before=tracks[-1]))
    return tracks, matches


def rectangle(x0, y0, x1, y1, **options):
    return Region(rectangle=(x0, y0, x1, y1), **options)


REFERENCE = photograph()
GAUGE = rectangle(50, 40, 190, 220).run(images=REFERENCE)


@pytest.fixture(scope="module")
def unloading():
    """Loaded in two steps, and most of the stretch taken back in one."""
    mappings = [stretched(stretch, FIXED) for stretch in (1.0, 1.18, 1.39, 1.02)]
    photographs = [photograph(mapping, seed) for seed, mapping in enumerate(mappings)]
    return mappings, *follow(photographs, GAUGE)


def test_points_follow_the_material_over_a_large_step(unloading):
    mappings, tracks, _ = unloading
    for mapping, track in zip(mappings, tracks, strict=True):
        error = track["points"] - mapping(tracks[0]["points"].reshape(-1, 2)).reshape(track["points"].shape)
        assert (track["status"] == Status.VALID).all()
        assert np.sqrt(np.mean(error**2)) < 0.03
        assert np.abs(error).max() < 0.2


def test_the_region_is_carried_along(unloading):
    mappings, tracks, _ = unloading
    for stretch, mapping, track in zip((1.0, 1.18, 1.39, 1.02), mappings, tracks, strict=True):
        polygons = polygons_from_json(track.attrs["polygons"])
        corners = mapping(np.array([[50.0, 40], [190, 220]]))
        np.testing.assert_allclose(bounding_box(polygons), corners.ravel(), atol=0.3)
        assert area(polygons) == pytest.approx(140 * 180 * np.sqrt(stretch), rel=3e-3)


def test_transforms_are_those_of_the_step(unloading):
    mappings, tracks, _ = unloading
    np.testing.assert_array_equal(tracks[0]["transforms"], np.broadcast_to(np.eye(3), (3, 3, 3, 3)))
    centre = np.array([[120.0, 130.0]])
    gradient = np.diag([(1.39 / 1.02) ** 0.5, 1.02 / 1.39])
    for row, column in np.ndindex(3, 3):
        found = tracks[3]["transforms"][row, column]
        np.testing.assert_allclose(found[:2, :2], gradient, atol=0.02)
        before, after = (np.append(mapping(centre)[0], 1.0) for mapping in mappings[2:])
        np.testing.assert_allclose((found @ before / (found @ before)[2])[:2], after[:2], atol=0.2)


def test_summaries_tell_what_the_transforms_rest_on(unloading):
    _, tracks, matches = unloading
    summary = matches.attrs["summary"]
    assert summary["matches_by_descriptor"] < summary["matches"] < summary["features_reference"]
    track = tracks[3].attrs["summary"]
    assert track["subsets"] == 9
    assert track["subsets_filled"] == 0
    assert 0 < track["inliers"] <= track["matches"]
    assert track["residual_px"] < 0.1
    assert tracks[0].attrs["summary"] == {"points": tracks[0]["points"].shape[0] * tracks[0]["points"].shape[1]}


def test_two_runs_give_equal_bytes(unloading):
    mappings, tracks, _ = unloading
    again, _ = follow([photograph(mapping, seed) for seed, mapping in enumerate(mappings[:2])], GAUGE)
    for name, variable in tracks[1].variables.items():
        assert again[1][name].tobytes() == variable.values.tobytes()
    assert json.dumps(again[1].attrs) == json.dumps(tracks[1].attrs)


@pytest.mark.parametrize("detector", ["AKAZE", "BRISK", "ORB", "SIFT"])
def test_every_detector_follows(detector):
    mapping = stretched(1.1, FIXED)
    tracks, _ = follow([REFERENCE, photograph(mapping, 2)], GAUGE, features=FindFeatures(detector=detector))
    error = tracks[1]["points"] - mapping(tracks[0]["points"].reshape(-1, 2)).reshape(tracks[0]["points"].shape)
    assert np.sqrt(np.mean(error**2)) < 0.1


def test_positions_of_features_alone_are_ten_times_coarser():
    mapping = stretched(1.2, FIXED)
    last = photograph(mapping, 2)
    errors = []
    for refine in (False, True):
        _, matches = follow([REFERENCE, last], GAUGE, match=Match(refine=refine))
        error = matches["deformed"] - mapping(matches["reference"].astype(float))
        errors.append(np.sqrt(np.mean(error**2)))
    assert errors[1] < 0.05
    assert errors[0] > 10 * errors[1]


@pytest.mark.parametrize("follows", ["matches", "blend", "subset"])
@pytest.mark.parametrize("transform", ["similarity", "affine", "projective"])
def test_a_shift_is_a_shift_for_every_transform(transform, follows):
    shift = np.array([3.3, 7.6])
    track = Track(transform=transform, follow=follows, subsets=(2, 2))
    tracks, _ = follow([REFERENCE, photograph(lambda p: p + shift, 2)], GAUGE, track=track)
    moved = tracks[1]["points"] - tracks[0]["points"]
    np.testing.assert_allclose(moved.mean(axis=(0, 1)), shift, atol=0.01)
    np.testing.assert_allclose(moved, np.broadcast_to(shift, moved.shape), atol=0.15)


def test_points_off_the_photograph_are_given_up():
    track, _ = follow([REFERENCE, photograph(lambda p: p - np.array([0.0, 82.5]), 2)], GAUGE)
    before, after = track
    left = before["points"][..., 1] < 82.5
    np.testing.assert_array_equal(after["status"] == Status.OUTSIDE, left)
    np.testing.assert_array_equal(np.isnan(after["points"]).all(axis=-1), left)


def test_a_hole_in_the_region_stays_one():
    hole = [(100, 100), (140, 100), (140, 150), (100, 150)]
    outline = {"exterior": [(50, 40), (190, 40), (190, 220), (50, 220)], "holes": [hole]}
    region = Region(polygons=[outline]).run(images=REFERENCE)
    mapping = stretched(1.15, FIXED)
    tracks, _ = follow([REFERENCE, photograph(mapping, 2)], region)
    inside = contains(polygons_from_json(region.attrs["polygons"]), tracks[0]["points"])
    np.testing.assert_array_equal(tracks[0]["status"] == Status.VALID, inside)
    np.testing.assert_array_equal(tracks[0]["status"] == Status.OUTSIDE, ~np.isfinite(tracks[0]["points"][..., 0]))
    assert (~inside).sum() == 8 * 10
    carried = polygons_from_json(tracks[1].attrs["polygons"])
    np.testing.assert_allclose(carried[0].holes[0].mean(axis=0), mapping(np.array([[120.0, 125.0]]))[0], atol=1.0)


def pairs(source, target, size=(240, 340)):
    source, target = (np.asarray(values, dtype=np.float32) for values in (source, target))
    return Matches.write(source, target, source, size, Matching(), {})


def test_points_of_a_filled_subset_are_marked_from_then_on():
    source = np.random.default_rng(0).uniform((50, 40), (190, 220), (600, 2))
    bare = (source < (50 + 1.25 * 140 / 3, 40 + 1.25 * 60)).all(axis=1)
    track = Track(step_size=7)
    first = track.run(region=GAUGE)
    second = track.run(region=GAUGE, matches=pairs(source[~bare], source[~bare] + 2), track_before=first)
    third = track.run(region=GAUGE, matches=pairs(source + 2, source + 4), track_before=second)
    np.testing.assert_array_equal(np.argwhere(second.attrs["subsets"]["filled"]), [[0, 0]])
    marked = (first["points"] < (50 + 140 / 3, 100)).all(axis=-1)
    for found in (second, third):
        np.testing.assert_array_equal(found["status"] == Status.FILLED, marked)
    assert not np.any(third.attrs["subsets"]["filled"])
    np.testing.assert_allclose(third["points"], first["points"] + 4, atol=1e-3)


def test_a_step_with_too_few_matches():
    first = Track().run(region=GAUGE)
    few = pairs([[60.0, 50.0], [70.0, 60.0]], [[60.0, 50.0], [70.0, 60.0]])
    lost = Track().run(region=GAUGE, matches=few, track_before=first)
    assert (lost["status"] == Status.UNTRACKED).all()
    assert lost.attrs["polygons"] == first.attrs["polygons"]
    (text,) = lost.warnings
    assert text.startswith("no point is followed to this step; in none of the region's 3 × 3 subsets do 8 matches")
    with pytest.raises(StageError, match="no matches"):
        Track().run(region=GAUGE, track_before=first)


@pytest.mark.parametrize("detector", ["KAZE", "AKAZE", "SIFT", "BRISK", "ORB"])
def test_a_photograph_without_texture_has_no_features_and_no_matches(detector):
    dark = images(np.full((340, 240), 90, dtype=np.uint8))
    found, before = (FindFeatures(detector=detector).run(images=image) for image in (dark, REFERENCE))
    (text,) = found.attrs["warnings"]
    assert "mean intensity gradient" in text
    assert found["xy"].shape == (0, 2)
    for one, other, pictures in ((found, before, (dark, REFERENCE)), (before, found, (REFERENCE, dark))):
        matches = Match().run(features=one, features_before=other, images=pictures[0], images_before=pictures[1])
        assert matches["reference"].shape == matches["deformed"].shape == (0, 2)


def test_the_searched_area_holds_the_specimen_only():
    x0, y0, x1, y1 = FindFeatures().run(images=REFERENCE).attrs["area"]
    np.testing.assert_allclose([x0, y0, x1, y1], SPECIMEN, atol=20)
    full = FindFeatures(area="full").run(images=REFERENCE)
    assert full.attrs["area"] == [0, 0, 240, 340]
    with pytest.raises(StageError, match="240 × 340 px"):
        FindFeatures(area=(0, 0, 300, 100)).run(images=REFERENCE)


def test_features_of_two_detectors_do_not_match():
    kinds = [FindFeatures(detector=d).run(images=REFERENCE) for d in ("KAZE", "ORB")]
    with pytest.raises(StageError, match="different detectors"):
        Match().run(features=kinds[0], features_before=kinds[1], images=REFERENCE, images_before=REFERENCE)


def test_without_a_choice_the_specimen_is_the_region():
    region = Region().run(images=REFERENCE)
    np.testing.assert_allclose(bounding_box(polygons_from_json(region.attrs["polygons"])), SPECIMEN, atol=16)
    assert region.attrs["area_px"] == area(polygons_from_json(region.attrs["polygons"]))


def test_nothing_given_is_auto():
    assert Region() == Region(auto=True)
    assert not rectangle(0, 0, 9, 9).auto


@pytest.mark.parametrize(
    "given",
    [
        {"auto": False},
        {"auto": True, "rectangle": (0, 0, 9, 9)},
        {"file": "a.png", "rectangle": (0, 0, 9, 9)},
        {"rectangle": (9, 0, 0, 9)},
        {"rectangle": (0, 0, float("nan"), 9)},
        {"polygons": [[(0, 0), (1, 1)]]},
    ],
)
def test_a_region_has_exactly_one_valid_source(given):
    with pytest.raises(ValidationError):
        Region(**given)


def test_a_region_outside_the_image_names_both_extents():
    with pytest.raises(StageError, match=r"x 50 … 400 .* y 40 … 220 .* x 0 … 239 .* y 0 … 339"):
        rectangle(50, 40, 400, 220).run(images=REFERENCE)


def test_a_region_without_texture_names_its_gradient_and_the_limit():
    blank = rectangle(40, 260, 200, 330)
    with pytest.raises(StageError, match=r"gradient is \d\.\d\d .* 1\.5"):
        blank.run(images=REFERENCE)
    with pytest.raises(StageError, match="no speckled specimen"):
        Region().run(images=images(np.full((100, 120), 90, dtype=np.uint8)))


def test_region_from_a_mask_and_from_geojson(tmp_path):
    mask = np.zeros(SHAPE, dtype=np.uint8)
    mask[40:221, 50:191] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    ring = [[50, 40], [190, 40], [190, 220], [50, 220], [50, 40]]
    (tmp_path / "r.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    for name in ("mask.png", "r.geojson"):
        region = Region(file=name).run(images=REFERENCE, file_path=tmp_path / name)
        assert region.attrs["area_px"] == 140 * 180
    Image.fromarray(mask[:-9]).save(tmp_path / "mask.png")
    with pytest.raises(StageError, match=r"240 × 331 .* 240 × 340"):
        Region(file="mask.png").run(images=REFERENCE, file_path=tmp_path / "mask.png")


def verged_rig():
    matrix = np.array([[900.0, 0, 119.5], [0, 900, 169.5], [0, 0, 1]])
    turn = cv2.Rodrigues(np.array([0.01, -0.15, 0.02]))[0]
    cameras = (Camera(matrix, np.array([-0.15, 0.05, 0, 0, 0]), (240, 340)) for _ in range(2))
    return Rig(*cameras, turn, np.array([-60.0, 1.0, 5.0]))


def test_a_region_of_the_photograph_is_carried_into_the_rectified_image():
    rig = verged_rig()
    rectified = rectification(rig)
    width, height = rectified.size
    grain = np.random.default_rng(0).integers(0, 255, (height // 4 + 1, width // 4 + 1), dtype=np.uint8)
    tracked = images(np.kron(grain, np.ones((4, 4), dtype=np.uint8))[:height, :width], "rectified")
    stored = CalibratedRig.write(rig, "", {})
    region = rectangle(60, 80, 160, 240).run(images=tracked, rig=stored)
    (found,) = polygons_from_json(region.attrs["polygons"])
    edge = np.array([[60.0, y] for y in np.linspace(80, 240, 9)])
    expected = raw_to_rectified(edge, rig.left, rectified.rotation_left, rectified.matrix_left)
    distance = np.abs(found.exterior[:, None] - expected[None]).max(axis=2).min(axis=0)
    assert distance.max() < 1e-3
    same = rectangle(60, 80, 160, 200, frame="tracked").run(images=tracked)
    assert same.attrs["area_px"] == 100 * 120
    with pytest.raises(StageError, match="needs the rig"):
        rectangle(60, 80, 160, 240).run(images=tracked)
    with pytest.raises(StageError, match="the left photograph has x 0 … 239"):
        rectangle(60, 80, 250, 240).run(images=tracked, rig=stored)


def real(path):
    return images(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))


def test_sample3_is_followed_to_a_fiftieth_of_a_pixel(shared_data):
    folder = shared_data / "challenge_2d" / "sample3"
    names = sorted(folder.glob("Sample3-*.tif"))
    photographs = [real(folder / "Sample3 Reference.tif"), *map(real, names)]
    region = Region(file="roi.tif").run(images=photographs[0], file_path=folder / "roi.tif")
    tracks, _ = follow(photographs, region, features=FindFeatures(max_features=800))
    for name, track in zip(names, tracks[1:], strict=True):
        shift = float(name.stem.split(" X")[1][:4])
        moved = np.nanmean(track["points"] - tracks[0]["points"], axis=(0, 1))
        np.testing.assert_allclose(moved, shift, atol=0.005)


def test_necking_is_followed_to_the_last_photograph(shared_data):
    names: list[Path] = sorted((shared_data / "necking").glob("*.tif"))
    photographs = [real(name) for name in (names[0], names[3], names[6], names[9])]
    region = Region().run(images=photographs[0])
    tracks, _ = follow(photographs, region, track=Track(subsets=(4, 2)), features=FindFeatures(max_features=2000))
    points, step_size = tracks[-1]["points"], tracks[-1].attrs["step_size"]
    gradient = np.stack(np.gradient(points, step_size, axis=(1, 0)), axis=-1)
    known = np.isfinite(gradient).all(axis=(2, 3))
    assert np.linalg.det(gradient[known]).min() > 0.9
    stretch = gradient[known][:, 1, 1]
    assert stretch.min() > 0.95
    assert 1.4 < stretch.max() < 2.2
    assert np.nanmin((points - tracks[0]["points"])[..., 1]) < -130


def test_the_part_with_an_opening_moves_as_another_program_says(shared_data):
    left, reference = shared_data / "d_specimen" / "left", shared_data / "d_specimen" / "reference"
    photographs = [real(left / f"GT4-{step:04d}_0.tif") for step in (0, 273)]
    region = Region().run(images=photographs[0])
    (part,) = polygons_from_json(region.attrs["polygons"])
    assert len(part.holes) == 1
    tracks, _ = follow(photographs, region, features=FindFeatures(max_features=4000))
    table = np.genfromtxt(reference / "points_0273.csv", delimiter=",", skip_header=1)
    here, there, correlation = table[:, :2], table[:, 10:12], table[:, 6]
    start = tracks[0]["points"]
    origin = np.nanmin(start, axis=(0, 1))
    index = np.rint((here - origin) / tracks[0].attrs["step_size"]).astype(int)
    inside = (index >= 0).all(axis=1) & (index < start.shape[1::-1]).all(axis=1) & (correlation > 0.9)
    j, i = index[inside].T
    moved = (tracks[1]["points"] - start)[i, j]
    known = np.isfinite(moved).all(axis=1)
    error = (moved - (there - here)[inside])[known]
    assert known.sum() > 8000
    assert np.abs(error.mean(axis=0)).max() < 0.15
    assert np.median(np.linalg.norm(error, axis=1)) < 0.5  # the nearest grid point is up to 3.5 px away


def test_a_window_without_a_middle_is_refused():
    with pytest.raises(ValidationError, match="20 is even; use an odd number"):
        Match(window=20)
    assert Match(window=23).window == 23


def test_the_stage_takes_the_detectors_of_the_table():
    schema = FindFeatures.model_json_schema()["properties"]["detector"]
    assert schema["enum"] == list(DETECTORS) == ["KAZE", "AKAZE", "BRISK", "ORB", "SIFT"]
