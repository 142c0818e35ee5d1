"""References: what tasks pass to each other in place of arrays.

A reference names a product by its digest. If the product was not kept, the reference also carries its
recipe, and the task that uses the product makes it again; each process caches the products made last.
"""

from __future__ import annotations

import os
import threading
import time
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, overload

from dicflow.engine.files import FilePart
from dicflow.engine.handover import Handover
from dicflow.engine.integrity import GONE, check_product
from dicflow.engine.looks import with_looks
from dicflow.engine.node import Node
from dicflow.engine.objects import LazyVariables, Manifest, describe, normalised, stored_array
from dicflow.engine.product import Product
from dicflow.engine.store import Store
from dicflow.errors import DamagedError, NotKeptError, StageError, StoreError

if TYPE_CHECKING:
    import numpy as np

    from dicflow.engine.graph import Task

__all__ = [
    "Clock",
    "ProductCache",
    "Recipe",
    "Ref",
    "RefInput",
    "Series",
    "arguments",
    "cache",
    "can_be_read",
    "clock",
    "handover",
    "load",
    "recipe_of",
    "refs_in",
]


@dataclass(frozen=True, slots=True)
class Ref:
    """A product by name.

    recipe : how to make it again, if it is not kept
    lost : it is not kept and its recipe is unknown; only its attributes can be read
    """

    digest: str
    recipe: Recipe | None = None
    lost: bool = False

    @property
    def depth(self) -> int:
        """How many stages must run, one after the other, before the product can be used."""
        return 0 if self.recipe is None else self.recipe.depth


RefInput = Ref | None | tuple[tuple[str, Ref], ...]
"""Input of a port: a product, None, or for ``At.ALL`` pairs (step, product)."""


@dataclass(frozen=True)
class Recipe:
    """How to make a product again: its task's name, node, inputs by port and files by argument."""

    task: str
    node: Node
    inputs: Mapping[str, RefInput]
    files: Mapping[str, Path | FilePart]

    @cached_property
    def depth(self) -> int:
        """How many stages must run, one after the other, this one included."""
        return 1 + max((ref.depth for ref in refs_in(self.inputs)), default=0)


def recipe_of(task: Task, refs: Mapping[str, Ref]) -> Recipe:
    """How to make the product of a task again. refs : products of the tasks that it takes something from, by name"""
    inputs: dict[str, RefInput] = {}
    for port, source in task.inputs.items():
        if source is None or isinstance(source, str):
            inputs[port] = None if source is None else refs[source]
        else:
            inputs[port] = tuple((step, refs[name]) for step, name in source)
    return Recipe(task.name, task.node, inputs, task.files)


class Series(Sequence[Product]):
    """The products of all steps in order, as a tuple of them would be; each is opened when it is used.

    It keeps no product, so a loop over it needs the memory of one step.

    steps : names of the steps
    """

    def __init__(self, store: Store, refs: tuple[tuple[str, Ref], ...]) -> None:
        self._store = store
        self._refs = refs

    @property
    def steps(self) -> tuple[str, ...]:
        """Names of the steps, in order."""
        return tuple(step for step, _ in self._refs)

    @overload
    def __getitem__(self, place: int) -> Product: ...
    @overload
    def __getitem__(self, place: slice) -> Series: ...
    def __getitem__(self, place: int | slice) -> Product | Series:
        if isinstance(place, slice):
            return Series(self._store, self._refs[place])
        return load(self._store, self._refs[place][1])

    def __len__(self) -> int:
        return len(self._refs)


class _Cached(NamedTuple):
    """A product in the cache, its size [bytes], and whether it is in the store."""

    product: Product
    nbytes: int
    kept: bool


class ProductCache:
    """Products last made in this process, up to a number of bytes and of products. Safe between threads.

    Those that are in the store as well give way to those that would have to be made again. Of small products the number
    is what counts: with its names and units an array of some points takes several times its own size, and a long series
    must not need more memory than a short one.

    limit : size of all arrays together [bytes]
    most : number of products; a run takes up again what was made a few dozens ago, and older ones seldom
    """

    def __init__(self, limit: int = 64_000_000, most: int = 128) -> None:
        self.limit = limit
        self.most = most
        self._products: OrderedDict[str, _Cached] = OrderedDict()
        self._size = 0
        self._lock = threading.Lock()

    def hold_to(self, limit: int) -> None:
        """Remember no more than so many bytes from now on."""
        self.limit = limit

    def get(self, digest: str) -> Product | None:
        """The product; None if it is not in the cache."""
        with self._lock:
            if digest not in self._products:
                return None
            self._products.move_to_end(digest)
            return self._products[digest].product

    def put(self, digest: str, product: Product, nbytes: int, kept: bool = False) -> None:
        """Remember a product; evicts the least recently used. kept : it is in the store"""
        with self._lock:
            if nbytes > self.limit or digest in self._products:
                return
            self._products[digest] = _Cached(product, nbytes, kept)
            self._size += nbytes
            while self._size > self.limit or len(self._products) > self.most:
                others = (other for other, cached in self._products.items() if cached.kept and other != digest)
                evicted = self._products.pop(next(others, next(iter(self._products))))
                self._size -= evicted.nbytes

    def clear(self) -> None:
        """Remove all products."""
        with self._lock:
            self._products.clear()
            self._size = 0


class Clock(threading.local):
    """Seconds that this thread has spent reading products, and making again what was not kept."""

    read_s = 0.0
    remake_s = 0.0

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Count the time inside as reading."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.read_s += time.perf_counter() - start

    @contextmanager
    def remaking(self) -> Iterator[None]:
        """Count the time inside as making again, except what is counted there already."""
        start, before = time.perf_counter(), self.read_s + self.remake_s
        try:
            yield
        finally:
            counted = self.read_s + self.remake_s - before
            self.remake_s += time.perf_counter() - start - counted


cache = ProductCache()
handover = Handover()
clock = Clock()


def load(store: Store, ref: Ref) -> Product:
    """A product by its reference; an array is read, or made again, at its first use, and belongs to the caller.

    Raises DamagedError if it is missing or its attributes are damaged; so does the first use of a damaged array.
    """
    path, manifest = store.manifest_path(ref.digest), store.manifest(ref.digest)
    if manifest is None and not os.path.lexists(path):
        raise DamagedError(f"{store.path}: the product {ref.digest[:19]}… is missing; run again to make it")
    if manifest is None or not manifest.is_sound:
        raise _damaged(store, ref.digest, path)

    def read(name: str) -> np.ndarray:
        made = cache.get(ref.digest)
        if made is None and not manifest.kept:
            made = _handed_over(manifest) or _remade(store, ref)
        return made[name].copy() if made is not None else _stored(store, manifest, name)

    content = manifest.content
    return Product(content["kind"], LazyVariables(content["variables"], read), content["attrs"])


def can_be_read(store: Store, ref: Ref) -> bool:
    """Whether the arrays of a product are stored, or the files are there of which it is made again; none is read."""
    manifest = store.manifest(ref.digest)
    if manifest is None or manifest.kept or ref.recipe is None:
        return manifest is not None and manifest.kept
    return all(map(os.path.isfile, ref.recipe.files.values())) and all(
        can_be_read(store, one) for one in refs_in(ref.recipe.inputs)
    )


def arguments(store: Store, inputs: Mapping[str, RefInput], files: Mapping[str, Path | FilePart]) -> dict[str, Any]:
    """The keyword arguments of ``run``: products by port and paths by name. Raises DamagedError."""
    return {**{port: _opened(store, source) for port, source in inputs.items()}, **files}


def _opened(store: Store, source: RefInput) -> Product | Series | None:
    if source is None or isinstance(source, Ref):
        return None if source is None else load(store, source)
    return Series(store, source)


def refs_in(inputs: Mapping[str, RefInput]) -> Iterator[Ref]:
    """All references among the inputs of a task."""
    for source in inputs.values():
        if isinstance(source, Ref):
            yield source
        elif source is not None:
            yield from (ref for _, ref in source)


def _handed_over(manifest: Manifest) -> Product | None:
    """A product that another worker of the run has made; None if it is not to be had."""
    with clock.reading():
        product = handover.get(manifest)
    if product is not None:
        cache.put(manifest.digest, product, manifest.nbytes)
    return product


def _remade(store: Store, ref: Ref) -> Product:
    recipe = ref.recipe
    if recipe is None:
        raise NotKeptError(f"{store.path}: {ref.digest[:19]}… was not kept; run the pipeline again to use it")
    with clock.remaking():
        product = normalised(recipe.node.run(**with_looks(recipe.node, arguments(store, recipe.inputs, recipe.files))))
        manifest = describe(product)
    if manifest.digest != ref.digest:
        raise StageError(
            f"{recipe.task}: its product, made again, differs from the first one; "
            "run with the code policy 'recompute', or set 'keep: always' if the stage uses random numbers"
        )
    cache.put(ref.digest, product, manifest.nbytes)
    return product


def _stored(store: Store, manifest: Manifest, name: str) -> np.ndarray:
    digest = manifest.digest
    folder = store.object_path(digest)
    try:
        with clock.reading():
            return stored_array(folder, manifest, name)
    except (MemoryError, ImportError):
        raise
    except Exception as error:
        with store.reading():
            if isinstance(error, OSError) and not isinstance(error, GONE):
                raise
            damage = check_product(store, digest)
        if not damage:
            raise StoreError(f"{folder / name}: could not be read ({error}), but is not damaged; run again") from error
        raise _damaged(store, digest, folder / name) from error


def _damaged(store: Store, digest: str, what: Path) -> DamagedError:
    """The error for a damaged product, which is moved into quarantine so that it is made again."""
    with suppress(StoreError):
        store.quarantine(digest)
    return DamagedError(f"{what}: is damaged and was moved into quarantine; run again to make it")
