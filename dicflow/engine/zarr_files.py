"""Arrays in the files of zarr's format 3, which zarr and xarray open; packed and unpacked without zarr.

The library costs too much for small arrays. Processor time to write and read one array, in ms, with one thread, no
consolidated metadata, the codecs below and the files in the page cache (zarr 3.1.6, zarrs 0.2.3, obstore 0.12.1,
numcodecs 0.16.6, Python 3.11 on Linux)::

                                   50 × 50 float64     2 … 8 MB
                                   write    read       write   read
    this module                    0.33     0.03         9.6    3.1
    zarr, LocalStore               3.0      0.8         11.3    4.7
    zarr with zarrs' pipeline      2.1      0.9         15.0    4.7
    zarr on obstore's LocalStore   2.8      0.9         14.0    4.5

A full run spends 90 s in its stages and keeps 330 products of 10 arrays, each read about once: 1.3 % of that time goes
into this module, and 11 to 14 % would go into the library. The library is to take this module's place when writing and
reading a small array costs 1.6 ms or less, which is 6 %.

An array is one chunk, or above 4 MB one chunk per plane of its two longest axes. It is packed with lz4 bit plane by bit
plane, since in a photograph or a field the upper bits of neighbours are mostly equal. Every chunk ends with its
check sum (CRC-32C). A chunk of integers that are all 0 has no file, as zarr has it.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dicflow.engine.hashing import canonical_json
from dicflow.engine.product import Variable
from dicflow.engine.whole_file import read_file

if TYPE_CHECKING:
    import numpy as np

__all__ = ["array_description", "array_files", "group_description", "group_file", "is_described", "read_array"]

_ONE_CHUNK = 4_000_000
"""Arrays up to this size [bytes] are one chunk."""
_CHECK_SUM = 4
"""Length of a check sum [bytes]."""
_PACKING = {"cname": "lz4", "clevel": 1, "shuffle": "bitshuffle", "blocksize": 0}


def group_file(attributes: Mapping[str, Any]) -> tuple[str, bytes]:
    """The file that makes its folder a group of arrays: relative path and contents."""
    return "zarr.json", _json(group_description(attributes))


def array_files(name: str, variable: Variable) -> Iterator[tuple[str, bytes]]:
    """The files of one array: relative path and contents."""
    import numpy as np

    values = np.asarray(variable.values, dtype=variable.values.dtype.newbyteorder("<"))
    label = variable.long_name or name
    described = array_description(values.dtype.str, values.shape, variable.dims, variable.units, label)
    yield f"{name}/zarr.json", _json(described)
    for key, place in _chunks(name, values.shape, _chunk(values.shape, values.nbytes)):
        part = np.ascontiguousarray(values[place])
        if part.dtype.kind == "f" or part.any():
            yield key, _packed(part)


def read_array(folder: Path, files: Collection[str], name: str, dtype: str, shape: tuple[int, ...]) -> np.ndarray:
    """One array of a group.

    files : relative paths of the files that the group was written with
    Raises OSError, and ValueError for a chunk that is damaged or does not fit dtype and shape.
    """
    import numpy as np

    values = np.zeros(shape, dtype)
    for key, place in _chunks(name, shape, _chunk(shape, values.nbytes)):
        if key in files:
            values[place] = _unpacked(read_file(folder / key), values[place])
    return values


def is_described(content: bytes, description: Mapping[str, Any]) -> bool:
    """Whether the contents of a ``zarr.json`` are a description, in the bytes that are written for it.

    The order of entries does not matter: attributes may come in another one from another process.
    """
    try:
        found = json.loads(content)
        return _json(found) == content and canonical_json(found) == canonical_json(description)
    except (ValueError, RecursionError):
        return False


def group_description(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Contents of ``zarr.json`` of a group."""
    return {"attributes": attributes, "zarr_format": 3, "node_type": "group"}


def array_description(dtype: str, shape: Sequence[int], dims: Sequence[str], units: str, label: str) -> dict[str, Any]:
    """Contents of ``zarr.json`` of an array. label : of an axis that shows it"""
    import numpy as np

    kind = np.dtype(dtype)
    chunk = _chunk(tuple(shape), math.prod(shape) * kind.itemsize)
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(shape),
        "data_type": kind.name,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(chunk)}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": kind.type(0).item(),
        "codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "blosc", "configuration": {"typesize": kind.itemsize, **_PACKING}},
            {"name": "crc32c"},
        ],
        "dimension_names": list(dims),
        "attributes": {"units": units, "long_name": label},
    }


def _chunk(shape: tuple[int, ...], nbytes: int) -> tuple[int, ...]:
    """Shape of a chunk."""
    sizes = [max(length, 1) for length in shape]
    if nbytes <= _ONE_CHUNK or math.prod(sizes) == 0:
        return tuple(sizes)
    longest = sorted(range(len(sizes)), key=lambda axis: -sizes[axis])[:2]
    return tuple(size if axis in longest else 1 for axis, size in enumerate(sizes))


def _chunks(name: str, shape: tuple[int, ...], chunk: tuple[int, ...]) -> Iterator[tuple[str, tuple[slice, ...]]]:
    """File and place of each chunk; along every axis there is one chunk, or one per index."""
    counts = [length // size for length, size in zip(shape, chunk, strict=True)]
    for index in itertools.product(*map(range, counts)):
        place = tuple(slice(i * size, (i + 1) * size) for i, size in zip(index, chunk, strict=True))
        yield f"{name}/{'.'.join(['c', *map(str, index)])}", place


def _packed(part: np.ndarray) -> bytes:
    """A chunk's bytes with their check sum."""
    packed = bytes(_codec().encode(part))
    return packed + _check_sum(packed)


def _unpacked(content: bytes, like: np.ndarray) -> np.ndarray:
    """The values of a chunk, of the dtype and shape of ``like``. Raises ValueError."""
    import numpy as np

    packed, check_sum = content[:-_CHECK_SUM], content[-_CHECK_SUM:]
    if _check_sum(packed) != check_sum:
        raise ValueError("the check sum differs")
    nbytes = int.from_bytes(packed[4:8], "little")  # from blosc's header, before a damaged chunk can fill the memory
    if nbytes != like.nbytes:
        raise ValueError(f"a chunk holds {nbytes} bytes instead of {like.nbytes}")
    return np.frombuffer(_codec().decode(packed), like.dtype).reshape(like.shape)


def _check_sum(packed: bytes) -> bytes:
    import google_crc32c

    value: int = google_crc32c.value(packed)
    return value.to_bytes(_CHECK_SUM, "little")


@cache
def _codec() -> Any:
    from numcodecs import blosc

    blosc.use_threads = False  # a task has one thread
    return blosc.Blosc(_PACKING["cname"], _PACKING["clevel"], blosc.BITSHUFFLE, _PACKING["blocksize"])


def _json(value: Any) -> bytes:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode("utf-8")
