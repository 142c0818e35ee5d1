"""The run that every fault befalls: the engine's toy stages, and what each of their products must be."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from pathlib import Path
from unittest.mock import patch

TOYS = Path(__file__).resolve().parents[1] / "engine"
if str(TOYS) not in sys.path:
    sys.path.insert(0, str(TOYS))

import toys  # noqa: E402

from dicflow.engine import files, plan  # noqa: E402
from dicflow.engine.execute import RunResult  # noqa: E402
from dicflow.engine.graph import Graph  # noqa: E402
from dicflow.engine.objects import describe, normalised  # noqa: E402
from dicflow.engine.product import Product, Variable  # noqa: E402
from dicflow.engine.references import cache, load  # noqa: E402
from dicflow.engine.store import Store  # noqa: E402
from dicflow.errors import DicflowError  # noqa: E402

__all__ = ["by_index", "finished_well", "graph", "made_clean", "numbers", "run", "wrong_products"]

Expected = dict[str, str]
"""Digest of each task's product, made where nothing goes wrong."""


def numbers(folder: Path, count: int = 4) -> Path:
    """The files that the chain reads."""
    return toys.numbers(folder, count)


def graph(folder: Path, factor: float = 2.0) -> Graph:
    """The chain; each factor gives other products but for those that only read."""
    return toys.chain(folder, keep="always", factor=factor)


def run(folder: Path, store: Path, factor: float = 2.0, **options: object) -> RunResult:
    """Run the chain as a new process would: with nothing in memory."""
    cache.clear()
    return toys.run_sync(graph(folder, factor), Store.open(store), ahead=lambda _: [_load], **options)


def _load() -> None:
    """A call ahead, so that workers are forked from the process that makes it."""


def made_clean(folder: Path, store: Path, factor: float = 2.0) -> Expected:
    """What each task gives, in a store of its own that knows all files."""
    with _known_at_once():
        outcomes = run(folder, store, factor).outcomes
    return {name: outcome.ref.digest for name, outcome in outcomes.items() if outcome.ref is not None}


def finished_well(folder: Path, store: Path, expected: Expected, factor: float = 2.0) -> list[str]:
    """Run the chain; what is wrong with how it ends, or with a product of it.

    A hit may turn out damaged only when it is read, and says then that another run makes it; so all are read, and
    there is one more.
    """
    result = run(folder, store, factor)
    hits = [name for name, outcome in result.outcomes.items() if outcome.status == "hit"]
    if [name for name in hits if _damaged(result, name)]:
        result = run(folder, store, factor)
    return [*result.errors, *wrong_products(result, expected)]


def wrong_products(result: RunResult, expected: Expected) -> list[str]:
    """Tasks whose product is missing or another one, by what is read from the store."""
    return [name for name, digest in expected.items() if _content(result, name) != digest]


def _damaged(result: RunResult, name: str) -> bool:
    try:
        return _content(result, name) == ""
    except DicflowError:
        return True


def _content(result: RunResult, name: str) -> str:
    """Digest of a product's contents as they are read."""
    outcome = result.outcomes[name]
    if outcome.ref is None:
        return ""
    stored = load(result.store, outcome.ref)
    variables = {key: Variable(*variable) for key, variable in stored.variables.items()}
    return describe(normalised(Product(stored.kind, variables, stored.attrs))).digest


def _known_at_once() -> AbstractContextManager[object]:
    """Keep facts also about files that have just been written."""
    return patch.object(files, "_FRESH_NS", 0)


def by_index() -> AbstractContextManager[object]:
    """Plan as for many tasks, by the store's index."""
    return patch.object(plan, "_MANY", 0)
