"""Looks: what a stage needs of each step of a long series, kept in parts; a series that grows is not read again.

A stage that defines :meth:`dicflow.engine.node.Node.look` gets, in place of the products of all steps, what it saw in
each. Every :data:`AT_ONCE` steps are a task of their own, whose product is kept; only the steps behind the last of
these parts are looked at when the stage runs.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, overload

from dicflow.engine.node import At, Node
from dicflow.engine.product import Product, Variable

__all__ = ["AT_ONCE", "Looks", "look_ports", "looks_product", "with_looks"]

AT_ONCE = 32
"""Steps of a part."""
_KIND = "looks"


class Looks(Sequence[Product]):
    """What was seen in the steps of a series, in order, as a tuple would be.

    steps : names of the steps
    """

    def __init__(self, seen: Mapping[str, Product]) -> None:
        self.steps = tuple(seen)
        self._seen = tuple(seen.values())

    @overload
    def __getitem__(self, place: int) -> Product: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[Product]: ...
    def __getitem__(self, place: int | slice) -> Product | Sequence[Product]:
        return self._seen[place]

    def __len__(self) -> int:
        return len(self._seen)


@cache
def look_ports(stage: type[Node]) -> tuple[str, ...]:
    """Ports that the look of a stage takes, that of the series first; none for a stage without a look."""
    names = [name for name in inspect.signature(stage.look).parameters if name in stage.takes]
    return tuple(sorted(names, key=lambda name: stage.takes[name].at is not At.ALL))


def looks_product(node: Node, given: Mapping[str, Any]) -> Product:
    """What a stage sees in some steps, as one product: arrays of all of them along a first axis.

    given : the arguments of its look, with a series of products in place of one
    """
    import numpy as np

    seen = dict(_seen(node, given))
    first, *_ = seen.values()
    variables = {
        name: Variable(("look", *one.dims), np.stack([look[name] for look in seen.values()]), one.units, one.long_name)
        for name, one in first.variables.items()
    }
    attrs = [dict(look.attrs) for look in seen.values()]
    return Product(_KIND, variables, {"kind": first.kind, "steps": list(seen), "looks": attrs})


def with_looks(node: Node, given: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of ``run`` with what a stage sees in place of a series; the same for a stage without a look.

    given : by port; of a tuple of products the steps count from 1
    """
    ports = look_ports(type(node))
    if not ports or given[ports[0]] is None:
        return dict(given)
    return {**given, ports[0]: Looks(dict(_seen(node, given)))}


def _seen(node: Node, given: Mapping[str, Any]) -> Iterator[tuple[str, Product]]:
    """Name of each step and what the stage sees in it: from a part that was looked at before, or now."""
    series, *others = look_ports(type(node))
    beside = {port: given.get(port) for port in others}
    products = given[series]
    names = getattr(products, "steps", map(str, range(1, len(products) + 1)))
    for step, product in zip(names, products, strict=True):
        if product.kind == _KIND:
            yield from _parted(product)
        else:
            yield step, node.look(**{series: product}, **beside)


def _parted(product: Product) -> Iterator[tuple[str, Product]]:
    """The looks that :func:`looks_product` joined, each with the name of its step."""
    arrays = {name: part._replace(dims=part.dims[1:]) for name, part in product.variables.items()}
    for place, (step, attrs) in enumerate(zip(product.attrs["steps"], product.attrs["looks"], strict=True)):
        values = {name: one._replace(values=one.values[place]) for name, one in arrays.items()}
        yield step, Product(product.attrs["kind"], values, attrs)
