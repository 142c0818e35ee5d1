import google_crc32c
import numpy as np
import pytest
import zarr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dicflow.engine.product import Variable
from dicflow.engine.zarr_files import array_files, group_file, read_array

DTYPES = ["?", "u1", "i2", ">i4", "u8", "f2", "f4", ">f8"]


def written(folder, values, dims):
    files = dict([group_file({"kind": "a"}), *array_files("a", Variable(dims, values, "mm", ""))])
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return files


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(DTYPES).flatmap(lambda dtype: arrays.arrays(dtype, arrays.array_shapes(min_dims=0, min_side=0))))
def test_zarr_reads_what_is_written_and_so_does_dicflow(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("group")
    dims = tuple(f"axis_{axis}" for axis in range(values.ndim))
    files = written(folder, values, dims)
    array = zarr.open_group(folder, mode="r")["a"]
    assert array.metadata.dimension_names == dims
    assert array.attrs.asdict() == {"units": "mm", "long_name": "a"}
    little = values.dtype.newbyteorder("<")
    for found in (array[...], read_array(folder, files, "a", little.str, values.shape)):
        assert found.dtype == little
        np.testing.assert_array_equal(found, values)


def test_planes_of_a_large_field_are_chunks(tmp_path):
    values = np.random.default_rng(1).normal(size=(2, 700, 800)).astype(np.float32)
    files = written(tmp_path, values, ("component", "row", "col"))
    assert [name for name in files if "/c." in name] == ["a/c.0.0.0", "a/c.1.0.0"]
    np.testing.assert_array_equal(zarr.open_array(tmp_path / "a", mode="r")[...], values)
    np.testing.assert_array_equal(read_array(tmp_path, files, "a", "<f4", values.shape), values)


def test_a_chunk_of_zeros_has_no_file(tmp_path):
    files = written(tmp_path, np.zeros((3, 4), np.uint8), ("row", "col"))
    assert set(files) == {"zarr.json", "a/zarr.json"}
    assert not zarr.open_array(tmp_path / "a", mode="r")[...].any()


def test_smooth_photographs_shrink(tmp_path):
    ramp = np.tile(np.arange(256, dtype=np.uint8), (256, 1))
    assert len(written(tmp_path, ramp, ("row", "col"))["a/c.0.0"]) < 0.2 * ramp.nbytes


def tampered(content, start, number):
    packed = bytearray(content[:-4])
    packed[start : start + 4] = number.to_bytes(4, "little")
    return bytes(packed) + google_crc32c.value(bytes(packed)).to_bytes(4, "little")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda content: content[:-1], "check sum"),
        (lambda content: b"", "check sum|holds 0 bytes"),
        (lambda content: content[:20] + bytes([content[20] ^ 1]) + content[21:], "check sum"),
        (lambda content: tampered(content, 4, 2**31 - 1), "holds 2147483647 bytes instead of 8000"),
        (lambda content: tampered(content, 4, 0), "holds 0 bytes instead of 8000"),
    ],
)
def test_a_chunk_that_cannot_be_right_is_refused(tmp_path, damage, message):
    files = written(tmp_path, np.arange(1000.0), ("point",))
    chunk = tmp_path / "a" / "c.0"
    chunk.write_bytes(damage(chunk.read_bytes()))
    with pytest.raises(ValueError, match=message):
        read_array(tmp_path, files, "a", "<f8", (1000,))
