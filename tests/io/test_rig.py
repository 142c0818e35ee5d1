import json

import numpy as np
import pytest

from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, rotation_matrix
from dicflow.core.cameras.rig_parameters import PARAMETERS
from dicflow.errors import InputError
from dicflow.io.rig import read_covariance, read_rig, write_rig
from dicflow.kinds.rig import rig_to_json


def make_rig() -> Rig:
    left = Camera(camera_matrix(2400.1, (720.3, 960.7)), np.array([-0.1, 0.05, 1e-4, -2e-4, 0.0]), (1440, 1920))
    right = left._replace(matrix=camera_matrix(2390.7, (715.0, 955.5)))
    return Rig(left, right, rotation_matrix([0.01, 0.2, -0.003]), np.array([-101.3, 0.4, 7.9]))


def test_a_rig_comes_back_bit_for_bit(tmp_path):
    write_rig(tmp_path / "rig.json", make_rig())
    back = read_rig(tmp_path / "rig.json")
    assert rig_to_json(back) == rig_to_json(make_rig())
    assert back.left.size == (1440, 1920)


@pytest.mark.parametrize(
    ("text", "word"),
    [("[1, 2", "rig.json"), ("{}", "left"), ('{"left": 3}', "rig.json"), ("[]", "rig.json")],
)
def test_a_file_without_a_rig_is_refused_by_name(tmp_path, text, word):
    (tmp_path / "rig.json").write_text(text)
    with pytest.raises(InputError, match=word):
        read_rig(tmp_path / "rig.json")


def test_a_wrong_shape_is_named(tmp_path):
    write_rig(tmp_path / "rig.json", make_rig()._replace(translation=np.zeros(2)))
    with pytest.raises(InputError, match="translation_mm"):
        read_rig(tmp_path / "rig.json")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.json"):
        read_rig(tmp_path / "none.json")


def covariance():
    root = (
        np.random.default_rng(3).normal(size=(len(PARAMETERS), 30)) * np.geomspace(1e-6, 3.0, len(PARAMETERS))[:, None]
    )
    return root @ root.T


def test_a_covariance_comes_back_bit_for_bit(tmp_path):
    path = tmp_path / "rig.json"
    write_rig(path, make_rig(), covariance())
    np.testing.assert_array_equal(read_covariance(path), covariance())
    assert rig_to_json(read_rig(path)) == rig_to_json(make_rig())
    write_rig(path, make_rig())
    assert read_covariance(path) is None


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda matrix: matrix[:-1], "covariance is not 24 × 24 finite numbers"),
        (lambda matrix: np.where(matrix == matrix[0, 1], matrix.max(), matrix) + np.triu(matrix, 1), "not symmetric"),
        (lambda matrix: matrix - 1.1 * np.diag(np.diagonal(matrix)), "negative variances"),
        (lambda matrix: np.diag([-1e-9, *np.ones(23)]), "negative variances"),
        (lambda matrix: matrix - 0.9 * np.diag(np.diagonal(matrix)), "not positive semidefinite"),
        (lambda matrix: "unknown", "could not convert"),
    ],
)
def test_what_is_no_covariance_is_named(tmp_path, spoil, word):
    values = {**rig_to_json(make_rig()), "covariance": np.asarray(spoil(covariance())).tolist()}
    (tmp_path / "rig.json").write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(InputError, match=rf"rig\.json: .*{word}.*; export the rig again, or leave its covariance out"):
        read_covariance(tmp_path / "rig.json")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"rotation": [[1e308] * 3] * 3}, "beyond"),
        ({"translation_mm": [1e12, 0, 0]}, "beyond"),
        ({"left": [1, 2]}, "as dicflow writes it"),
        ({"rotation": {"a": 1}}, "as dicflow writes it"),
    ],
)
def test_numbers_that_no_rig_has_are_refused(tmp_path, change, word):
    (tmp_path / "rig.json").write_text(json.dumps({**rig_to_json(make_rig()), **change}), encoding="utf-8")
    with pytest.raises(InputError, match=word):
        read_rig(tmp_path / "rig.json")
