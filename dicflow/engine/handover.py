"""Products that are not kept, handed from worker to worker of a run through files, so that each is made once.

A worker writes what others would have to make again, its last products up to a number of bytes, into a folder that ends
with the run. What is read is the product of its digest, or nothing.
"""

from __future__ import annotations

import io
import shutil
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dicflow.engine.hashing import digest_array
from dicflow.engine.objects import Manifest
from dicflow.engine.product import Product, Variable
from dicflow.engine.store import Store
from dicflow.engine.whole_file import write_file

__all__ = ["Handover", "handover_folder"]


@contextmanager
def handover_folder(store: Store) -> Iterator[Path | None]:
    """A folder of a run; None where it cannot be made, as on a full disk."""
    try:
        folder = store.draft()
        folder.mkdir()
    except OSError:
        yield None
        return
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class Handover:
    """What this process hands over, and what it finds of others.

    folder : of the run; None where nothing is handed over
    limit : size of what this process has in it at once [bytes]
    """

    def __init__(self, limit: int = 64_000_000) -> None:
        self.folder: Path | None = None
        self._limit = limit
        self._given: deque[tuple[Path, int]] = deque()

    def put(self, product: Product, manifest: Manifest) -> None:
        """Hand over a product; the oldest ones make room for it. One that cannot be written is made again by others."""
        if self.folder is None or manifest.nbytes > self._limit:
            return
        self._given.append((self._path(self.folder, manifest), manifest.nbytes))
        while sum(size for _, size in self._given) > self._limit:
            with suppress(OSError):
                self._given.popleft()[0].unlink(missing_ok=True)
        with suppress(OSError):
            _write(self._given[-1][0], product)

    def get(self, manifest: Manifest) -> Product | None:
        """The product that another process has handed over; None without it, or if it is damaged."""
        return None if self.folder is None else _read(self._path(self.folder, manifest), manifest)

    def _path(self, folder: Path, manifest: Manifest) -> Path:
        return folder / f"{manifest.digest.removeprefix('sha256:')}.npz"


def _write(path: Path, product: Product) -> None:
    """Write the arrays in their order. Raises OSError."""
    import numpy as np

    content = io.BytesIO()
    np.savez(content, *(variable.values for variable in product.variables.values()))
    write_file(path, content.getvalue())


def _read(path: Path, manifest: Manifest) -> Product | None:
    import numpy as np

    content = manifest.content
    variables = {}
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            for (name, spec), key in zip(content["variables"].items(), file.files, strict=True):
                values = file[key]
                if digest_array(values) != spec["digest"]:
                    return None
                variables[name] = Variable(tuple(spec["dims"]), values, spec["units"], spec["long_name"])
    except Exception:  # what is damaged makes zipfile and numpy raise errors of many kinds
        return None
    return Product(content["kind"], variables, content["attrs"])
