"""Products for other programs: a group of zarr's, and datasets over many steps that read an array when it is used."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dicflow.engine.objects import Manifest
from dicflow.engine.references import Ref, load
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, DamagedError

if TYPE_CHECKING:
    import numpy as np
    import xarray
    import zarr

__all__ = ["lazy_dataset", "open_group"]


def open_group(store: Store, ref: Ref) -> zarr.Group:
    """A product as a group of arrays: that of the store, read-only; in memory where the store does not keep it.

    Raises DamagedError where the product is missing or damaged.
    """
    import zarr

    if _manifest(store, ref).files:
        return zarr.open_group(store.object_path(ref.digest), mode="r", use_consolidated=False)
    product = load(store, ref)
    group = zarr.open_group(zarr.storage.MemoryStore(), mode="w", attributes={"kind": product.kind, **product.attrs})
    for name, variable in product.variables.items():
        attributes = {"units": variable.units, "long_name": variable.long_name or name}
        group.create_array(name, data=variable.values, dimension_names=variable.dims, attributes=attributes)
    return group


def lazy_dataset(store: Store, refs: Mapping[str, Ref]) -> xarray.Dataset:
    """The products of all steps along a dimension ``step``; an array of a step is read when it is first used.

    refs : name of the step → product
    Raises ConfigurationError where an array has not one shape at all steps, DamagedError where a product is missing.
    """
    import xarray

    manifests = {step: _manifest(store, ref) for step, ref in refs.items()}
    first = next(iter(manifests.values())).content
    arrays = {
        name: (("step", *spec["dims"]), _stacked(store.path, refs, manifests, name), _attributes(name, spec))
        for name, spec in first["variables"].items()
    }
    return xarray.Dataset(arrays, attrs={"kind": first["kind"], **_common_attributes(manifests.values())})


def _common_attributes(manifests: Iterable[Manifest]) -> dict[str, Any]:
    """Attributes that are equal at all steps."""
    first, *others = (manifest.content["attrs"] for manifest in manifests)
    return {name: value for name, value in first.items() if all(other.get(name) == value for other in others)}


def _attributes(name: str, spec: Mapping[str, Any]) -> dict[str, str]:
    return {"units": spec["units"], "long_name": spec["long_name"] or name}


def _stacked(store: Path, refs: Mapping[str, Ref], manifests: Mapping[str, Manifest], name: str) -> Any:
    """One array of all steps as a dask array with a chunk per step."""
    import dask.array
    from dask import delayed

    specs = {step: manifest.content["variables"].get(name) for step, manifest in manifests.items()}
    shapes = {step: None if spec is None else (tuple(spec["shape"]), spec["dtype"]) for step, spec in specs.items()}
    first, (shape, dtype) = next(iter(shapes.items()))  # type: ignore[misc]
    if other := next((step for step, found in shapes.items() if found != (shape, dtype)), None):
        raise ConfigurationError(
            f"{name} has another shape at {other} than at {first}; name one step, or read the steps one by one"
        )
    parts = [dask.array.from_delayed(delayed(_values)(store, ref, name), shape, dtype) for ref in refs.values()]
    return dask.array.stack(parts)


def _values(store: Path, ref: Ref, name: str) -> np.ndarray:
    return load(Store.open(store), ref)[name]


def _manifest(store: Store, ref: Ref) -> Manifest:
    found = store.manifest(ref.digest)
    if found is None:
        raise DamagedError(f"{store.path}: the product {ref.digest[:19]}… is missing; run again to make it")
    return found
