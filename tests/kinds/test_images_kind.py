import numpy as np
import pytest

from dicflow.core.cameras.camera import Camera, Rig, camera_matrix
from dicflow.errors import StageError
from dicflow.kinds.images import Images, check_size
from tests.kinds.layouts import layouts, long_names, stored

LEFT, RIGHT = np.random.default_rng(7).integers(0, 255, (2, 48, 64)).astype(np.uint8)


def rig(left=(64, 48), right=(64, 48)):
    one, other = (Camera(camera_matrix(100.0, (32.0, 24.0)), np.zeros(5), size) for size in (left, right))
    return Rig(one, other, np.eye(3), np.array([-100.0, 0.0, 0.0]))


@pytest.mark.parametrize("kind", ["images", "rectified", "plane"])
def test_photographs_come_back_bit_for_bit(kind):
    product = stored(Images.write(LEFT, RIGHT, kind))
    images = Images.read(product)
    assert product.kind == kind
    np.testing.assert_array_equal(images.left, LEFT)
    np.testing.assert_array_equal(images.right, RIGHT)
    assert images.as_taken is (kind == "images")
    assert images.size == (64, 48)
    assert layouts(product) == dict.fromkeys(("left", "right"), ("row col", "grey level"))


def test_long_names_distinguish_photographs_from_rectified_ones():
    assert long_names(Images.write(LEFT, RIGHT)) == {"left": "left photograph", "right": "right photograph"}
    assert long_names(Images.write(LEFT, RIGHT, "rectified"))["right"] == "rectified right photograph"
    assert long_names(Images.write(LEFT, kind="plane")) == {"left": "undistorted photograph"}


def test_one_camera_has_no_right_photograph():
    images = Images.read(Images.write(LEFT))
    assert not images.has_right
    assert [side for side, _ in images.sides] == ["left"]
    with pytest.raises(StageError, match="right"):
        _ = images.right


@pytest.mark.parametrize(("side", "sizes"), [("left", {"left": (48, 64)}), ("right", {"right": (640, 480)})])
def test_photographs_of_another_size_than_the_rig_are_refused_by_side_and_sizes(side, sizes):
    images = Images.read(Images.write(LEFT, RIGHT))
    width, height = sizes[side]
    with pytest.raises(StageError, match=rf"{side} camera .*{width} × {height} px.* 64 × 48 px"):
        images.check_sizes(rig(**sizes))
    images.check_sizes(rig())


def test_sizes_from_json_compare_as_pairs():
    check_size("left", (64, 48), [64, 48])


def test_a_mask_names_the_pixels_that_count_and_is_left_out_where_all_do():
    opaque = np.ones(LEFT.shape, bool)
    opaque[:, :10] = False
    product = stored(Images.write(LEFT, RIGHT, counts={"left": opaque, "right": np.ones(RIGHT.shape, bool)}))
    images = Images.read(product)
    np.testing.assert_array_equal(images.counts("left"), opaque)
    assert images.counts("right") is None
    assert [side for side, _ in images.sides] == ["left", "right"]
    assert layouts(product)["left_counts"] == ("row col", "1")


def test_photographs_in_which_all_pixels_count_are_stored_without_masks():
    assert set(Images.write(LEFT, RIGHT).variables) == {"left", "right"}
    assert set(Images.write(LEFT, counts={"left": np.ones(LEFT.shape, bool)}).variables) == {"left"}


def test_the_time_of_a_step_comes_back_and_may_be_unknown():
    assert Images.read(stored(Images.write(LEFT, RIGHT, time=1772366405.25))).time == 1772366405.25
    assert Images.read(stored(Images.write(LEFT, time=0.0))).time == 0.0
    assert Images.read(stored(Images.write(LEFT))).time is None
