import ast
from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

import numpy as np
import pytest

import dicflow.kinds
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.kind import GRID, Kind, Layout, laid_out, summary_of
from dicflow.pipeline.registry import node_class, stage_names
from tests.measure import layer_of, read_package


def defined_readers() -> Iterator[type[Kind]]:
    """All classes of :mod:`dicflow.kinds` that read a kind of product."""
    for info in iter_modules(dicflow.kinds.__path__, "dicflow.kinds."):
        for value in vars(import_module(info.name)).values():
            is_own = isinstance(value, type) and issubclass(value, Kind) and value.__module__ == info.name
            if is_own and "KINDS" in vars(value):
                yield value


READERS = list(defined_readers())
OWNERS = [(kind, reader) for reader in READERS for kind in reader.KINDS]


def name_of(value: object) -> str | None:
    return value.__name__ if isinstance(value, type) else None


@pytest.mark.parametrize(("kind", "reader"), OWNERS, ids=name_of)
def test_a_reader_takes_its_own_kind(kind: str, reader: type[Kind]):
    product = Product(kind)
    assert reader.read(product).product is product


@pytest.mark.parametrize("reader", READERS, ids=name_of)
def test_a_reader_refuses_another_kind_and_names_both(reader: type[Kind]):
    with pytest.raises(StageError) as refusal:
        reader.read(Product("spectrum"))
    message = str(refusal.value)
    assert "spectrum" in message
    assert all(kind in message for kind in reader.KINDS)


def test_each_kind_that_a_stage_gives_has_a_reader():
    assert {node_class(name).gives for name in stage_names()} <= {kind for kind, _ in OWNERS}


@pytest.mark.slow
def test_keys_of_attributes_are_read_in_kinds_alone():
    """But the warnings, which the engine passes on from products of any kind, and several products as one."""
    modules = [m for m in read_package().values() if layer_of(m.name) != "kinds"]
    assert {m.name for m in modules for _ in key_reads(m.tree)} == {"dicflow.engine.product"}


def key_reads(tree: ast.AST) -> Iterator[int]:
    """Lines that look up one entry of ``attrs`` or ``….attrs``, by a subscript or by get."""
    for node in ast.walk(tree):
        by_subscript = isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load) and is_attrs(node.value)
        by_get = isinstance(node, ast.Attribute) and node.attr == "get" and is_attrs(node.value)
        if by_subscript or by_get:
            yield node.lineno


def is_attrs(node: ast.expr) -> bool:
    return (isinstance(node, ast.Attribute) and node.attr == "attrs") or (
        isinstance(node, ast.Name) and node.id == "attrs"
    )


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ('a = product.attrs["rig"]', [1]),
        ('a = 1\nb = attrs["rig"]', [2]),
        ('a = product.attrs.get("rig", {})', [1]),
        ('file.attrs["kind"] = "rig"', []),
        ("a = {**product.attrs}", []),
    ],
)
def test_reads_of_keys_are_found_in_source(text, lines):
    assert list(key_reads(ast.parse(text))) == lines


def test_a_layout_gives_values_their_axes_unit_and_name():
    values = np.arange(6.0).reshape(2, 3)
    array = Layout(GRID, "mm", "depth")(values)
    assert array.values is values
    assert (array.dims, array.units, array.long_name) == (("row", "col"), "mm", "depth")


def test_arrays_keep_the_order_of_the_values():
    layouts = {"a": Layout(GRID), "b": Layout(GRID), "c": Layout(GRID)}
    assert list(laid_out(layouts, {"c": np.zeros((1, 1)), "a": np.zeros((1, 1))})) == ["c", "a"]


def test_a_product_without_summary_has_an_empty_one():
    assert summary_of(Product("rig")) == {}
    assert summary_of(Product("rig", attrs={"summary": {"rms_px": 0.1}})) == {"rms_px": 0.1}
