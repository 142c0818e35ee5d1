"""Products as zarr groups: writing a product, and reading an array at its first use."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dicflow.engine.hashing import digest_array, digest_json, is_digest, plain
from dicflow.engine.product import Product, Variable
from dicflow.engine.share import in_free_threads
from dicflow.engine.stored_json import (
    anything,
    fields,
    is_count,
    is_flag,
    is_text,
    list_of,
    mapping_of,
    read_stored,
    unseal,
)
from dicflow.engine.zarr_files import array_description, array_files, group_description, group_file, read_array
from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

__all__ = ["LazyVariables", "Manifest", "describe", "descriptions", "normalised", "stored_array", "write_group"]


def _is_inside(name: str) -> bool:
    """Whether a relative path stays in its folder."""
    return bool(name) and "\\" not in name and not name.startswith("/") and ".." not in name.split("/")


_DTYPE = re.compile(r"\|[biu]1|<[iu][248]|<f(?:2|4|8|16)")
_LARGEST_ARRAY = 1 << 34
"""Size of an array [bytes] above which its description is damage."""
_VARIABLE = fields({
    "dims": list_of(is_text), "dtype": is_text, "shape": list_of(is_count),
    "units": is_text, "long_name": is_text, "digest": is_digest,
})  # fmt: skip


def _is_variable(value: Any) -> bool:
    """Whether a value describes an array, of a size that an array may have."""
    if not _VARIABLE(value) or not _DTYPE.fullmatch(value["dtype"]) or len(value["dims"]) != len(value["shape"]):
        return False
    nbytes: int = math.prod(max(size, 1) for size in value["shape"]) * int(value["dtype"][2:])
    return nbytes <= _LARGEST_ARRAY


_CONTENT = {"kind": is_text, "attrs": mapping_of(anything), "variables": mapping_of(_is_variable, _is_inside)}
_MANIFEST = fields({
    "digest": is_digest, "kept": is_flag, "nbytes": is_count, "files": mapping_of(is_count, _is_inside),
    "content": fields(_CONTENT),
})  # fmt: skip


@dataclass(frozen=True)
class Manifest:
    """Content of a product, and its files.

    digest : of the content
    content : kind, attrs, and of every variable dims, dtype, shape, units, long_name and digest
    nbytes : size of all arrays in memory [bytes]
    kept : whether the arrays are in the store; if not, they are made again when they are used
    files : size [bytes] of every file of the group by relative path
    """

    digest: str
    content: Mapping[str, Any]
    nbytes: int
    kept: bool = True
    files: Mapping[str, int] = field(default_factory=dict)

    @property
    def is_sound(self) -> bool:
        """Whether the digest is that of the content."""
        try:
            return digest_json(self.content) == self.digest
        except (TypeError, ValueError):
            return False

    def to_json(self) -> dict[str, Any]:
        """The manifest as JSON."""
        return {
            "digest": self.digest,
            "kept": self.kept,
            "nbytes": self.nbytes,
            "files": dict(self.files),
            "content": self.content,
        }

    @classmethod
    def read(cls, path: Path) -> Manifest:
        """The manifest in a file. Raises OSError where it cannot be read.

        Raises ValueError where it is damaged, or names files outside the product's folder.
        """
        return cls(**read_stored(path, _MANIFEST))

    @classmethod
    def parse(cls, content: bytes) -> Manifest:
        """The manifest in the contents of such a file. Raises ValueError as :meth:`read` does."""
        return cls(**unseal(content, _MANIFEST))


class LazyVariables(Mapping[str, Variable]):
    """Variables whose arrays are read at their first use.

    specs : content of a manifest's ``variables``
    read : name → array
    """

    def __init__(self, specs: Mapping[str, Any], read: Callable[[str], np.ndarray]) -> None:
        self._specs = specs
        self._read = read
        self._found: dict[str, Variable] = {}

    def __getitem__(self, name: str) -> Variable:
        if name not in self._found:
            spec = self._specs[name]
            values = self._read(name)
            self._found[name] = Variable(tuple(spec["dims"]), values, spec["units"], spec["long_name"])
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._specs)

    def __len__(self) -> int:
        return len(self._specs)

    def __contains__(self, name: object) -> bool:
        return name in self._specs


def normalised(product: Product) -> Product:
    """The product with attributes in JSON's own types, as it is read from the store.

    Raises StageError that names an attribute or array that cannot be stored.
    """
    for name, variable in product.variables.items():
        if not isinstance(variable, Variable):
            found = type(variable).__name__
            raise StageError(f"{product.kind}.{name}: is {found}; give Variable(dims, values, units, long_name)")
        if variable.values.ndim != len(variable.dims):
            raise StageError(
                f"{product.kind}.{name}: {variable.values.ndim} axes, but dims {variable.dims}; name each axis"
            )
        if not _is_inside(name) or "/" in name:
            raise StageError(f"{product.kind}: '{name}' cannot name an array; use letters, digits and _")
    try:
        return replace(product, attrs=plain(product.attrs))
    except TypeError as error:
        raise StageError(f"{product.kind}: an attribute cannot be kept ({error}); give JSON values") from error


def describe(product: Product) -> Manifest:
    """Manifest of a product in memory. Raises StageError for an array that has no digest."""
    try:
        specs = in_free_threads(_spec, product.variables.values())
    except TypeError as error:
        raise StageError(f"{product.kind}: {error}") from error
    variables = dict(zip(product.variables, specs, strict=True))
    content = {"kind": product.kind, "attrs": product.attrs, "variables": variables}
    nbytes = sum(variable.values.nbytes for variable in product.variables.values())
    return Manifest(digest_json(content), content, nbytes)


def write_group(folder: Path, product: Product) -> dict[str, int]:
    """Write the arrays into a new zarr group, which xarray can open; size of each file by relative path.

    Raises OSError.
    """
    for name in ("", *product.variables):
        (folder / name).mkdir()

    def written(files: Iterable[tuple[str, bytes]]) -> list[tuple[str, int]]:
        return [(name, (folder / name).write_bytes(content)) for name, content in files]

    arrays = (array_files(name, variable) for name, variable in product.variables.items())
    group = [group_file({"kind": product.kind, **product.attrs})]
    return dict(chain.from_iterable(in_free_threads(written, [group, *arrays])))


def descriptions(manifest: Manifest) -> dict[str, Any]:
    """What each ``zarr.json`` of a product's group must say, by relative path."""
    content = manifest.content
    found = {"zarr.json": group_description({"kind": content["kind"], **content["attrs"]})}
    for name, spec in content["variables"].items():
        label = spec["long_name"] or name
        found[f"{name}/zarr.json"] = array_description(spec["dtype"], spec["shape"], spec["dims"], spec["units"], label)
    return found


def stored_array(folder: Path, manifest: Manifest, name: str) -> np.ndarray:
    """One array of a group. Raises OSError, and ValueError for a damaged one."""
    spec = manifest.content["variables"][name]
    return read_array(folder, manifest.files, name, spec["dtype"], tuple(spec["shape"]))


def _spec(variable: Variable) -> dict[str, Any]:
    return {
        "dims": list(variable.dims),
        "dtype": variable.values.dtype.newbyteorder("<").str,
        "shape": list(variable.values.shape),
        "units": variable.units,
        "long_name": variable.long_name,
        "digest": digest_array(variable.values),
    }
