"""The figures of the structure, on packages of a few lines."""

from __future__ import annotations

import itertools
from textwrap import dedent

import pytest

from tests import measure

SOURCES = {
    "__init__.py": '"""A package."""\n',
    "core/__init__.py": '"""Core."""\n',
    "core/status.py": "OK = 0\n",
    "core/lens/__init__.py": '"""Lens."""\n',
    "core/lens/model.py": "from pkg.core.status import OK\nfrom pkg.core.lens import fit\n",
    "core/lens/fit.py": "import pkg.core.status\n",
    "core/strain/__init__.py": '"""Strain."""\n',
    "core/strain/plane.py": "def plane():\n    from pkg.core.lens import model\n\n    return model\n",
    "stages/_shared.py": "SIDE = 1\n",
    "stages/smooth.py": "from pkg.stages._shared import SIDE\n",
    "stages/fit.py": "from pkg.stages.smooth import SIDE\nfrom pkg.stages._shared import SIDE as same\n",
}


def package(folder, sources):
    for name, text in sources.items():
        path = folder / "pkg" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return measure.read_package(folder / "pkg")


def functions(folder, text, name="module.py"):
    modules = package(folder, {name: text})
    return {one.name: one for module in modules.values() for one in measure.functions(module)}


def test_arrows_between_chapters_are_pairs_with_their_imports(tmp_path):
    modules = package(tmp_path, SOURCES)
    assert measure.arrows(modules, measure.chapter_of) == {
        ("lens", "status"): {"pkg.core.lens.model -> pkg.core.status", "pkg.core.lens.fit -> pkg.core.status"},
        ("strain", "lens"): {"pkg.core.strain.plane -> pkg.core.lens.model"},
    }
    assert measure.common_ground(modules) == {"status"}


def test_arrows_between_stages_leave_out_shared_modules(tmp_path):
    modules = package(tmp_path, SOURCES)
    assert set(measure.arrows(modules, measure.stage_of)) == {("fit", "smooth")}


@pytest.mark.parametrize(("pairs", "length"), [("ab bc ac", 0), ("ab bc ca cd", 4), ("ab ba", 3)])
def test_a_circle_begins_and_ends_with_the_same_part(pairs, length):
    pairs = {tuple(pair) for pair in pairs.split()}
    found = measure.circle(pairs)
    assert len(found) == length
    assert found[:1] == found[-1:]
    assert set(itertools.pairwise(found)) <= pairs


def test_a_relative_import_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"deep\.py:2: relative import"):
        package(tmp_path, {"deep.py": "import math\nfrom . import other\n"})


def test_a_name_imported_from_a_package_is_its_module_or_the_package(tmp_path):
    modules = package(
        tmp_path, {**SOURCES, "use.py": "from pkg.core import status, lens, OTHER\nimport numpy.linalg\n"}
    )
    nodes = measure.import_nodes(modules["pkg.use"].tree)
    assert measure.imported_modules(nodes, modules) == ["pkg.core.status", "pkg.core.lens", "pkg.core"]


def test_attributes_are_found_where_they_are_read_or_set_in_a_mapping(tmp_path):
    text = """
        def read(product, attrs, file, name):
            product.attrs["a"]
            attrs.get("b")
            product.attrs.items()
            file.attrs["d"] = 1
            attrs["e"] = product.attrs.get("f")
            other["attrs"]
        """
    module = package(tmp_path, {"module.py": dedent(text)})["pkg.module"]
    assert measure.attribute_lines(module) == [3, 4, 7, 7]


def test_a_body_is_measured_without_its_docstring(tmp_path):
    text = '''
        def one(): return 1
        def two():
            """Says

            much."""
            a = 1

            # why
            return a
        def none():
            """Says all."""
        class A:
            def method(self):
                def inner():
                    pass
                return inner
        '''
    found = functions(tmp_path, dedent(text))
    lines = {name: one.lines for name, one in found.items()}
    assert lines == {"one": 1, "two": 4, "none": 0, "method": 3, "inner": 1}
    assert found["two"].place == "pkg.module:3"


def test_arguments_are_all_but_self_and_cls(tmp_path):
    found = functions(
        tmp_path,
        "class A:\n    def method(self, a, /, b, *c, d, **e): ...\n    @classmethod\n    def make(cls, a): ...\n",
    )
    assert {name: one.arguments for name, one in found.items()} == {"method": 5, "make": 1}


@pytest.mark.parametrize(
    ("head", "typed"),
    [
        ("(a: int, *b: int, **c: int) -> int", True),
        ("(self, a: int) -> None", True),
        ("(a: int)", False),
        ("(a: int, *b) -> int", False),
    ],
)
def test_a_typed_function_has_annotations_on_all_arguments_and_the_result(tmp_path, head, typed):
    assert functions(tmp_path, f"def function{head}: ...\n")["function"].is_typed is typed


def test_kernels_are_decorated_or_compiled_by_a_call(tmp_path):
    text = """
        import numba
        from numba import njit
        @njit
        def a(x: Any, y: Array): ...
        @numba.njit(cache=True)
        def b(x: Any): ...
        def c(x: Any): ...
        def d(x: Any): ...
        kernel = njit(cache=True)(c)
        """
    found = functions(tmp_path, dedent(text))
    assert {name for name, one in found.items() if one.is_kernel} == {"a", "b", "c"}
    assert found["a"].any_arguments == 1


def test_commands_are_the_public_functions_of_cli(tmp_path):
    found = functions(tmp_path, "def run(): ...\ndef _line(): ...\n", "cli/run.py")
    assert {name: one.is_command for name, one in found.items()} == {"run": True, "_line": False}


def test_imports_inside_functions_count_once_each(tmp_path):
    text = "import a\ndef f():\n    import b\n    def g():\n        import c, d\n"
    assert measure.in_function_imports(package(tmp_path, {"m.py": text})["pkg.m"]) == 2


@pytest.mark.parametrize(("percent", "value"), [(10, 1), (50, 5), (90, 9), (91, 10), (100, 10)])
def test_a_percentile_is_one_of_the_values(percent, value):
    assert measure.percentile(range(10, 0, -1), percent) == value


def test_the_exit_code_is_1_where_a_bar_is_missed(tmp_path, capsys):
    package(tmp_path, {"core/long.py": "def f(" + ", ".join("abcdefgh") + "): ...\n"})
    assert measure.main(tmp_path / "pkg") == 0
    package(tmp_path, {"core/wide.py": "def wide(" + ", ".join("abcdefghi") + "): ...\n"})
    assert measure.main(tmp_path / "pkg") == 1
    assert "pkg.core.wide:1 wide, 9 arguments" in capsys.readouterr().out
