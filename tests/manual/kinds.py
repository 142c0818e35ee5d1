"""The kinds of product in one sentence each, from the docstrings of their classes."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from inspect import getdoc, getmembers, isclass

import dicflow.kinds
from dicflow.kinds.kind import Kind, Table

__all__ = ["kind_sentence"]


def kind_sentence(kind: str) -> str:
    """What a product of this kind is, and the class that reads it."""
    reader = _readers()[kind]
    first = (getdoc(reader) or "").splitlines()[0].replace("``", "`")
    return f"{first} Python reads it with `{reader.__module__}.{reader.__name__}`."


@cache
def _readers() -> dict[str, type[Kind]]:
    names = [found.name for found in pkgutil.iter_modules(dicflow.kinds.__path__)]
    modules = [importlib.import_module(f"dicflow.kinds.{name}") for name in names]
    classes = [one for module in modules for _, one in getmembers(module, isclass) if one.__module__ == module.__name__]
    readers = [one for one in classes if issubclass(one, Kind) and one not in (Kind, Table) and hasattr(one, "KINDS")]
    return {kind: reader for reader in reversed(readers) for kind in reader.KINDS}
