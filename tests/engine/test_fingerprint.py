"""What a fingerprint covers: small packages are written, edited and never run."""

import sys
import types
from pathlib import Path

import pytest
import toys
from hypothesis import given
from hypothesis import strategies as st

from dicflow.engine.components import components
from dicflow.engine.files import FileIndex
from dicflow.engine.fingerprint import Sources, changed_names
from dicflow.errors import ConfigurationError

STAGE = '''"""A stage."""
from __future__ import annotations
import logging
from typing import TYPE_CHECKING
import numpy
from sample import fields, helper as other_name
from sample.errors import TooFewError
from sample.helper import LIMIT, Base
if TYPE_CHECKING:
    from sample.shown import Shown
_LOG = logging.getLogger(__name__)
def marked(function=LIMIT): return function
class Stage(Base):
    """What it does."""
    title: str = "a title"
    degree: fields.Degree = parameter(2, "description", ge=1)
    @marked
    def run(self, rows: Shown) -> Shown:
        from .inner import deep
        from dicflow.engine import store
        import dicflow.engine.units
        if not rows:
            raise TooFewError(f"{len(rows)} rows; bring more")
        _LOG.info("a line")
        total: int = sum(own(row) for row in rows)
        return deep.value + other_name.scale(numpy.asarray(total), dicflow.engine.units.quantity)
def own(row):
    fields = row
    return fields.unused
def unused(): return 1
'''
HELPER = """
import math
LIMIT = 3
SIZE, SHAPE = 4, 5
class Base:
    order: int = 1
def scale(value, unit="mm"):
    return even(value) * SIZE
def even(n): return n == 0 or odd(n - 1)
def odd(n): return n != 0 and even(n - 1)
def unused(): return 2
"""
FILES = {
    "__init__": "",
    "stage": STAGE,
    "helper": HELPER,
    "fields": "from typing import Annotated\nDegree = Annotated[int, 'degree']\nOther = 1",
    "errors": 'class TooFewError(ValueError):\n    """Too few."""\nclass TooManyError(ValueError): """Too many."""',
    "shown": "class Shown: pass",
    "inner/__init__": "",
    "inner/deep": "import sample.helper\nvalue = sample.helper.LIMIT + 1\nother = 2",
}


def write(root, files):
    """A package of source files, by name without suffix; returns its folder."""
    for name, text in files.items():
        path = root / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def taken(root, module="stage", uses=(), name="Stage"):
    """Fingerprint of the stage in a module of a package, which is never imported."""
    full = f"{root.name}.{module}"
    placed = types.ModuleType(full)
    placed.__file__ = str(root.joinpath(*module.split("."))) + ".py"
    sys.modules[full] = placed
    try:
        return Sources(FileIndex(root / "index")).fingerprint(type(name, (), {"__module__": full}), uses)
    finally:
        del sys.modules[full]


@pytest.fixture
def package(tmp_path):
    return write(tmp_path / "sample", FILES)


def edit(package, file, old, new):
    path = package / f"{file}.py"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def small(tmp_path, **files):
    """Root of the fingerprint of a package of these modules, of which ``stage`` holds the stage."""
    number = len(list(tmp_path.iterdir()))
    return taken(write(tmp_path / str(number) / "sample", {"__init__": "", **files}))


def test_it_covers_what_is_used_and_nothing_else(package):
    found = set(taken(package).parts)
    own = {
        "stage:Stage",
        "stage:marked",
        "stage:own",
        "errors:TooFewError",
        "fields:Degree",
        "inner.deep:value",
        "stage",
    }
    own |= {f"helper:{name}" for name in ("LIMIT", "SIZE", "Base", "scale", "even", "odd")}
    assert {name for name in found if name.startswith("sample")} == {f"sample.{name}" for name in own}
    assert "dicflow.engine.units:quantity" in found
    assert not any("store" in name for name in found)


COSMETIC = [
    ("stage", "What it does", "What it does, in other words"),
    ("stage", "a title", "another title"),
    ("stage", '"description"', '"a better description"'),
    ("stage", '(2, "description", ge=1)', '(2, description="another", ge=1)'),
    ("stage", "rows; bring more", "rows are too few"),
    ("stage", '_LOG.info("a line")', '"""Nothing."""  # and a comment'),
    ("stage", "rows: Shown) -> Shown", "rows: list[int]) -> int"),
    ("stage", "total: int =", "total ="),
    ("stage", "def unused(): return 1", ""),
    ("stage", "numpy", "np"),
    ("stage", "    from sample.shown import Shown", "    from sample.seen import Shown"),
    ("helper", "LIMIT = 3", '"""Doc."""\n# why\nLIMIT: int = (\n    3\n)\n"""At most."""'),
    ("helper", "def unused(): return 2", "def unused(): return 3"),
    ("errors", "Too few.", "Fewer than are needed."),
    ("errors", "Too many.", "More than are needed."),
    ("fields", "Other = 1", "Other = 2"),
    ("shown", "pass", "size = 1"),
    ("inner/deep", "other = 2", "other = 3"),
]


@pytest.mark.parametrize(("file", "old", "new"), COSMETIC)
def test_cosmetic_edits_do_not_count(package, file, old, new):
    before = taken(package)
    edit(package, file, old, new)
    if new == "np":
        edit(package, file, "import np", "import numpy as np")
    assert taken(package) == before


EDITS = [
    ("stage", "(2, ", "(3, ", "stage:Stage"),
    ("stage", "ge=1", "ge=0", "stage:Stage"),
    ("stage", "not rows", "len(rows) < 2", "stage:Stage"),
    ("stage", "numpy.asarray", "numpy.ascontiguousarray", "stage:Stage"),
    ("stage", "import numpy", "import other as numpy", "stage:Stage"),
    ("stage", "return fields.unused", "return fields.used", "stage:own"),
    ("stage", "return function", "return function()", "stage:marked"),
    ("helper", "LIMIT = 3", "LIMIT = 2", "helper:LIMIT"),
    ("helper", "SIZE, SHAPE = 4, 5", "SIZE, SHAPE = 5, 4", "helper:SIZE"),
    ("helper", "SIZE, SHAPE", "SHAPE, SIZE", "helper:SIZE"),
    ("helper", "order: int", "order: float", "helper:Base"),
    ("helper", 'unit="mm"', 'unit="cm"', "helper:scale"),
    ("helper", "n != 0", "n == 0", "helper:odd"),
    ("fields", "[int, 'degree']", "[float, 'degree']", "fields:Degree"),
    ("errors", "class TooFewError(ValueError)", "class TooFewError(KeyError)", "errors:TooFewError"),
    ("inner/deep", "+ 1", "+ 2", "inner.deep:value"),
]


@pytest.mark.parametrize(("file", "old", "new", "place"), EDITS)
def test_edits_of_the_code_count_where_they_are(package, file, old, new, place):
    before = taken(package)
    edit(package, file, old, new)
    after = taken(package)
    assert after != before
    assert changed_names(before.parts, after.parts) == [f"sample.{place}"]


def test_which_error_is_raised_counts(package):
    before = taken(package)
    edit(package, "stage", "TooFewError", "TooManyError")
    assert taken(package) != before


@pytest.mark.parametrize(
    ("old", "new"),
    [("helper", "tools"), ("errors", "problems"), ("inner", "within"), ("scale", "stretched"), ("LIMIT", "MOST")],
)
def test_modules_and_definitions_may_have_other_names(tmp_path, old, new):
    files = {name.replace(old, new): text.replace(old, new) for name, text in FILES.items()}
    assert taken(write(tmp_path / "before" / "sample", FILES)) == taken(write(tmp_path / "after" / "sample", files))


def test_a_module_may_be_split_and_moved(tmp_path, package):
    before = taken(package)
    head, tail = HELPER.split("def even")
    parts = {
        "deeper/__init__": "",
        "deeper/parity": f"def even{tail}",
        "deeper/base": head.replace("import math", "from sample.deeper.parity import even as is_even").replace(
            "even(value)", "is_even(value)"
        ),
        "helper": "from sample.deeper.base import LIMIT, Base, scale\n__all__ = ['LIMIT', 'Base', 'scale']",
    }
    assert taken(write(package, parts)) == before


def test_a_package_may_have_another_name(tmp_path):
    files = {name: text.replace("sample", "renamed") for name, text in FILES.items()}
    assert taken(write(tmp_path / "sample", FILES)) == taken(write(tmp_path / "renamed", files))


@pytest.mark.parametrize(
    "stage",
    [
        "import sample.code as c\nclass Stage:\n    def run(self): return c.f()",
        "import sample.code\nclass Stage:\n    def run(self): return sample.code.f()",
        "from sample.code import f as g\nclass Stage:\n    def run(self): return g()",
        "from sample import code\nclass Stage:\n    def run(self): return code.f()",
        "from . import code\nclass Stage:\n    def run(self): return code.f()",
        "class Stage:\n    def run(self):\n        from .code import f\n        return f()",
        "class Stage:\n    def run(self):\n        import sample.code as c\n        return (lambda: c.f())()",
        "from sample.code import f\nclass Stage:\n    def run(self): return [f() for f in [f]]",
        "from sample.code import f\nclass Stage:\n    a: f = 1",
        "from sample.code import f\nclass Stage:\n    a: 'f' = 1",
        "from sample.code import f\nclass Stage:\n    def run(self, a=f): return a()",
        "from sample.code import f\n@f\nclass Stage: pass",
        "from sample.code import f\nclass Stage(f): pass",
        "from sample.code import f\nclass Stage:\n    def run(self):\n        f = 1\n        return f\n    a = f",
        "import sample.code as c\nclass Stage:\n    def run(self): return getattr(c, 'f')()",
        "from sample.code import *\nclass Stage:\n    def run(self): return f()",
        "import sample.code\nclass Stage: pass",
        "import sample.code as c\nclass Stage:\n    def run(self): return c.made_at_run_time()",
        "try:\n    from sample.code import f\nexcept ImportError:\n    f = None\nclass Stage:\n    a = f",
        "from sample.exported import f\nclass Stage:\n    a = f",
        "from sample.code import f\nTABLE = {}\nTABLE['f'] = f\nclass Stage:\n    a = TABLE",
        "from sample.code import f\nTABLE = {}\ndef note(g): TABLE['f'] = g\n@note\ndef noted(): f()\n"
        "class Stage:\n    a = TABLE",
        "import numba\nfrom sample.code import f\n@numba.extending.overload(len)\ndef noted(): f()\nclass Stage: pass",
        "from sample import code\ndef f(): return code.f()\nclass Stage:\n    def run(self): return eval('f')()",
        "from sample.code import f\nclass Stage:\n    def run(self):\n        global g\n        g = f",
        "from sample.code import f\nclass Stage:\n    def run(self):\n        match self:\n            case f(): pass",
    ],
)
def test_all_ways_to_a_function_lead_to_it(tmp_path, stage):
    exported = "from .code import f\n__all__ = ['f']"
    first = small(tmp_path, stage=stage, exported=exported, code="def f(): return 1")
    second = small(tmp_path, stage=stage, exported=exported, code="def f(): return 2")
    assert first != second
    assert changed_names(first.parts, second.parts) == ["sample.code:f"]


@pytest.mark.parametrize(
    "use",
    [
        "def run(self, f): return f()",
        "def run(self):\n        f = 1\n        return f",
        "def run(self):\n        for f in (1, 2): pass\n        return f",
        "def run(self): return [f for f in (1, 2)]",
        "def run(self): return (lambda f: f)(1)",
        "def run(self): return self.f()",
        "def run(self, rows: f) -> f: return rows",
        "def run(self):\n        raise ValueError(f'{f()}')",
        "def run(self):\n        warnings.warn(f())",
        "f: int = 1",
    ],
)
def test_names_that_only_look_alike_lead_nowhere(tmp_path, use):
    stage = f"import warnings\nfrom sample.code import f\n__all__ = ['Stage', 'f']\nclass Stage:\n    {use}"
    found = [small(tmp_path, stage=stage, code=f"def f(): return {number}") for number in (1, 2)]
    assert found[0] == found[1]


@pytest.mark.parametrize("place", ["", "    "], ids=["at the top", "in a function"])
def test_what_another_package_gives_instead_counts(tmp_path, place):
    chosen = "try:\n{0}    from sample.code import f\n{0}except ImportError:\n{0}    from math import {1} as f\n"
    stage = "def g():\n    {}    return f\nclass Stage: a = g" if place else "{}def g(): return f\nclass Stage: a = g"
    stages = [stage.format(chosen.format(place, name)) for name in ("sin", "cos")]
    found = [small(tmp_path, stage=text, code="def f(): return 1") for text in stages]
    assert found[0] != found[1]


def test_statements_of_a_module_count_for_all_of_it(tmp_path):
    code = "import cv2\ncv2.setNumThreads({})\ndef f(): return 1\ndef g(): return 2"
    stage = "from sample.code import f\nclass Stage:\n    a = f"
    first, second = (small(tmp_path, stage=stage, code=code.format(number)) for number in (1, 2))
    assert changed_names(first.parts, second.parts) == ["sample.code"]


def test_circles_are_told_apart_by_what_they_do(tmp_path):
    stage = "from sample.code import a\nclass Stage:\n    def run(self): return a()"
    code = "def a(): return b(0)\ndef b(n): return c(n)\ndef c(n): return a()"
    same = "def x(n): return y()\ndef y(): return z(0)\ndef z(n): return x(n)"
    other = "def a(): return b(0)\ndef b(n): return c(n)\ndef c(n): return b(n)"
    root = small(tmp_path, stage=stage, code=code)
    assert small(tmp_path, stage=stage.replace("import a", "import y as a"), code=same) == root
    assert small(tmp_path, stage=stage, code=other) != root


def body(values, edges):
    """Functions that return their value and call those that the edges lead to."""
    calls = [[f"f{end}()" for start, end in edges if start == number] for number in range(len(values))]
    return "\n".join(
        f"def f{number}(): return ({', '.join([str(value), *calls[number]])},)" for number, value in enumerate(values)
    )


def reached(edges):
    found = {0}
    for _ in edges:
        found |= {end for start, end in edges if start in found}
    return found


@given(
    st.lists(st.integers(0, 1), min_size=6, max_size=6),
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=12),
    st.integers(0, 5),
)
def test_an_edit_counts_exactly_where_it_is_reached(tmp_path_factory, values, edges, edited):
    stage = "from sample.code import f0\nclass Stage:\n    def run(self): return f0()"
    before = small(tmp_path_factory.mktemp("graph"), stage=stage, code=body(values, edges))
    values[edited] = 2
    after = small(tmp_path_factory.mktemp("graph"), stage=stage, code=body(values, edges))
    assert (after != before) == (edited in reached(edges))
    assert changed_names(before.parts, after.parts) == [f"sample.code:f{edited}"] * (edited in reached(edges))


def test_components_come_after_what_they_lead_to():
    arrows = {"a": "bd", "b": "c", "c": "b", "d": "ea", "e": ""}
    assert [sorted(group) for group in components("a", arrows.__getitem__, ())] == [["b", "c"], ["e"], ["a", "d"]]
    assert [sorted(group) for group in components("a", arrows.__getitem__, "bc")] == [["e"], ["a", "d"]]


@pytest.mark.parametrize("name", ["elsewhere.measures:engineering", "elsewhere.measures"])
def test_code_found_at_run_time_counts_when_it_is_named(tmp_path, monkeypatch, name):
    stage = {"__init__": "", "stage": "class Stage: pass"}
    other = {"__init__": "raise RuntimeError", "measures": "from .base import half\ndef engineering(e): return half(e)"}
    monkeypatch.syspath_prepend(tmp_path)
    root = write(tmp_path / "sample", stage)
    write(tmp_path / "elsewhere", {**other, "base": "def half(e): return e / 2\ndef unused(): return 1"})
    without, before = taken(root), taken(root, uses=(name,))
    assert without != before
    assert {"elsewhere.measures:engineering", "elsewhere.base:half"} <= set(before.parts)
    edit(tmp_path / "elsewhere", "base", "return 1", "return 3")
    assert taken(root, uses=(name,)) == before
    edit(tmp_path / "elsewhere", "base", "e / 2", "e / 3")
    assert changed_names(before.parts, taken(root, uses=(name,)).parts) == ["elsewhere.base:half"]
    assert "elsewhere" not in sys.modules


def test_a_module_without_source_counts_by_its_name():
    assert toys.Scale().uses() == ()
    sources = Sources(FileIndex(Path("/nowhere/index")))
    uses = [(), ("no_such.module:f",), ("no_such.module:g",), ("math",)]
    assert len({sources.fingerprint(toys.Scale, one).root for one in uses}) == len(uses)


def test_a_module_that_python_cannot_run_counts_by_its_name(tmp_path):
    stage = "class Stage: pass"
    root = write(tmp_path / "sample", {"__init__": "", "stage": stage, "broken": "def f(:"})
    assert taken(root, uses=("sample.broken",)) != taken(root)


def test_real_stages_have_one():
    found = set(Sources(FileIndex(Path("/nowhere/index"))).fingerprint(toys.Scale).parts)
    assert {"toys:Scale", "toys:field", "dicflow.engine.node:Node", "dicflow.engine.product:Product"} <= found
    assert not {"toys:Rig", "toys:chain", "dicflow.errors:StageError"} & found
    assert not any(name.startswith("dicflow.engine.store") for name in found)


def test_a_class_from_nowhere_is_refused():
    nowhere = type("Nowhere", (), {"__module__": "nowhere"})
    with pytest.raises(ConfigurationError, match="put the stage into a module"):
        Sources(FileIndex(Path("/nowhere/index"))).fingerprint(nowhere)


def test_what_only_moved_is_not_named_as_changed():
    old = {"m:f": "1", "m:g": "2", "m:h": "3"}
    assert changed_names(old, {"n:f": "1", "m:g": "5", "m:k": "6"}) == ["m:g", "m:h", "m:k"]
    assert changed_names(old, {}) == changed_names({}, old) == []
