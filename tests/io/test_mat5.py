"""Files that scipy writes as MATLAB does."""

import zlib

import numpy as np
import pytest
from scipy.io import savemat

from dicflow.io.calibrations.mat5 import Opaque, read_mat

VARIABLES = {
    "matrix": np.arange(6.0).reshape(2, 3) / 7.0,
    "counts": np.array([[1, 2, 3]], dtype=np.int16),
    "word": "millimetres",
    "rig": {"K": np.eye(3), "inner": {"a_name_that_is_a_little_longer": np.array([[2.5]]), "unit": "mm"}, "none": []},
}


def written(path, variables=VARIABLES, **options) -> bytes:
    savemat(path, variables, **options)
    return path.read_bytes()


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_text_and_structures(tmp_path, compressed):
    found = read_mat(written(tmp_path / "m.mat", do_compression=compressed, long_field_names=True))
    assert list(found) == list(VARIABLES)
    assert (found["matrix"] == VARIABLES["matrix"]).all()
    assert (found["counts"] == VARIABLES["counts"]).all()
    assert found["word"] == "millimetres"
    assert (found["rig"]["K"] == np.eye(3)).all()
    assert found["rig"]["inner"] == {"a_name_that_is_a_little_longer": np.array([[2.5]]), "unit": "mm"}
    assert found["rig"]["none"].size == 0


def test_what_is_no_plain_array(tmp_path):
    cell = np.array([["a", np.eye(2)]], dtype=object)
    many = np.array([[(1.0,), (2.0,)]], dtype=[("x", float)])
    found = read_mat(written(tmp_path / "m.mat", {"cell": cell, "many": many, "one": np.eye(2)}))
    assert isinstance(found["cell"], Opaque)
    assert isinstance(found["many"], Opaque)
    assert (found["one"] == np.eye(2)).all()


def test_an_object_of_a_class_is_opaque_and_leaves_the_others():
    """As MATLAB keeps stereoParameters: flags of class 17, the variable's name, and what only MATLAB knows."""
    flags = np.array([6, 8, 17, 0], "<u4").tobytes()
    name, system = (np.array([1, 8], "<u4").tobytes() + word for word in (b"stereo_p", b"MCOS\0\0\0\0"))
    body = flags + name + system
    data = b"MATLAB 5.0".ljust(124) + b"\0\1IM" + np.array([14, len(body)], "<u4").tobytes() + body
    assert read_mat(data) == {"stereo_p": Opaque(17)}


def test_the_other_byte_order(tmp_path):
    """One number, written by hand as a big-endian machine does."""
    words = [6, 8, 6, 0, 5, 8, 1, 1, (1 << 16) | 1]
    body = (
        np.array(words, ">u4").tobytes()
        + b"x\0\0\0"
        + np.array([9, 8], ">u4").tobytes()
        + np.array([2.5], ">f8").tobytes()
    )
    data = b"MATLAB 5.0".ljust(124) + b"\x01\x00MI" + np.array([14, len(body)], ">u4").tobytes() + body
    assert read_mat(data) == {"x": np.array([[2.5]])}


def test_damaged_files_are_refused_and_never_end_the_process(tmp_path):
    whole = written(tmp_path / "m.mat")
    generator = np.random.default_rng(5)
    refused = 0
    for _ in range(500):
        data = bytearray(whole)
        for place in generator.integers(0, len(data), 3):
            data[place] = generator.integers(256)
        try:
            read_mat(bytes(data[: generator.integers(len(data) // 2, len(data))]))
        except ValueError:
            refused += 1
    assert refused > 250


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "header"),
        (b"\0" * 126 + b"IM" + b"\x0e", "within a tag"),
        (b"\0" * 126 + b"IM" + np.array([14, 99], "<u4").tobytes(), "longer than the file"),
        (b"\0" * 126 + b"IM" + np.array([15, 4], "<u4").tobytes() + b"abcd", "cannot be unpacked"),
    ],
)
def test_what_is_wrong(data, words):
    with pytest.raises(ValueError, match=words):
        read_mat(data)


def test_a_variable_that_unpacks_without_end():
    packed = zlib.compress(b"\0" * 100_000_001)
    data = b"\0" * 126 + b"IM" + np.array([15, len(packed)], "<u4").tobytes() + packed
    with pytest.raises(ValueError, match="more than 50,000,000 bytes"):
        read_mat(data)


def test_the_total_of_all_variables_is_limited(tmp_path):
    packed = written(tmp_path / "m.mat", {f"v{k}": np.zeros(1_000_000) for k in range(8)}, do_compression=True)
    assert len(packed) < 100_000
    with pytest.raises(ValueError, match="unpack to more than 50,000,000 bytes"):
        read_mat(packed)


def test_the_number_of_elements_is_limited(tmp_path):
    data = written(tmp_path / "m.mat")[:128] + b"\x0e\0\0\0\0\0\0\0" * 100_001
    with pytest.raises(ValueError, match="more than 100,000 elements"):
        read_mat(data)
