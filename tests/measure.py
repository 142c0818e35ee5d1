"""The structure of dicflow in figures, read from its source: arrows between parts, lengths, arguments, types.

Run it with ``make measure``; the exit code is 1 where a bar is missed. An arrow is a pair of parts of which one
imports the other, however often; imports inside functions and for type checkers count.
"""

from __future__ import annotations

import ast
import graphlib
import math
import statistics
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeGuard

from tests.bars import Figure, print_figures

__all__ = [
    "PACKAGE",
    "Function",
    "Module",
    "arrows",
    "attribute_lines",
    "chapter_of",
    "circle",
    "common_ground",
    "functions",
    "import_nodes",
    "imported_modules",
    "imported_names",
    "layer_of",
    "main",
    "percentile",
    "read_package",
    "stage_of",
]

_PRODUCT = "dicflow.engine.product"
PACKAGE = Path(__file__).resolve().parents[1] / "dicflow"
MAX_ARROWS, MAX_MEDIAN, MAX_P90, MAX_LINES, MAX_MODULE_LINES, MAX_ARGUMENTS = 30, 7, 20, 60, 400, 8

_FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef
_ImportNode = ast.Import | ast.ImportFrom
Arrows = Mapping[tuple[str, str], Collection[str]]
"""The imports behind each arrow, as ``importer -> imported``."""


class Module(NamedTuple):
    """A module of the package.

    name : full dotted name; a folder's name is that of its ``__init__``
    lines : length of the file
    """

    name: str
    path: Path
    lines: int
    tree: ast.Module


class Function(NamedTuple):
    """A function, method or nested function.

    place : module and line, as ``dicflow.core.status:12``
    lines : length of the body, from the first statement after the docstring to the end
    arguments : number of all but self and cls
    any_arguments : number of those with the annotation Any
    is_typed : whether the result and all arguments but self and cls have annotations
    is_command : whether typer calls it and makes an option of each argument: the public functions of cli
    is_kernel : whether numba compiles it
    """

    name: str
    place: str
    lines: int
    arguments: int
    any_arguments: int
    is_typed: bool
    is_command: bool
    is_kernel: bool


# reading


def read_package(folder: Path = PACKAGE) -> dict[str, Module]:
    """All modules of a package by their full names. Raises SyntaxError, and ValueError for a relative import."""
    found = [_read_module(folder, path) for path in sorted(folder.rglob("*.py"))]
    return {module.name: module for module in found}


def _read_module(folder: Path, path: Path) -> Module:
    parts = [folder.name, *path.relative_to(folder).with_suffix("").parts]
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text, str(path))
    relative = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level]
    if relative:
        raise ValueError(f"{path}:{relative[0]}: relative import; give the full name")
    return Module(".".join(parts).removesuffix(".__init__"), path, text.count("\n"), tree)


def import_nodes(tree: ast.AST) -> list[_ImportNode]:
    """All import statements of a module, at the top, inside functions and for type checkers."""
    return [node for node in ast.walk(tree) if isinstance(node, _ImportNode)]


def imported_names(node: _ImportNode) -> list[str]:
    """Full names that a statement imports: ``from a.b import c`` gives ``a.b.c``."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [f"{node.module}.{alias.name}" for alias in node.names]


def imported_modules(nodes: Sequence[_ImportNode], modules: Mapping[str, Module]) -> list[str]:
    """The modules of the package behind import statements: the longest known part of each imported name."""
    names = (name for node in nodes for name in imported_names(node))
    found = (next((part for part in _prefixes(name) if part in modules), None) for name in names)
    return [module for module in found if module is not None]


def _prefixes(name: str) -> Iterator[str]:
    while name:
        yield name
        name = name.rpartition(".")[0]


# arrows


def layer_of(name: str) -> str:
    """The layer of a module: ``dicflow.core.status`` is in core; the package itself has the layer ''."""
    return name.split(".")[1] if "." in name else ""


def chapter_of(name: str) -> str | None:
    """The chapter of core that a module is in, or its own name where it is in none; None outside core."""
    return _part_of(name, "core")


def stage_of(name: str) -> str | None:
    """The stage that a module belongs to; None outside stages and for modules that stages share (``_name``)."""
    stage = _part_of(name, "stages")
    return None if stage is None or stage.startswith("_") else stage


def _part_of(name: str, layer: str) -> str | None:
    parts = name.split(".")
    return parts[2] if len(parts) > 2 and parts[1] == layer else None


def common_ground(modules: Mapping[str, Module]) -> set[str]:
    """The single modules of core, which are in no chapter."""
    inside = [module for name, module in modules.items() if chapter_of(name)]
    return {module.path.stem for module in inside if module.path.parent.name == "core"}


def arrows(modules: Mapping[str, Module], part_of: Callable[[str], str | None]) -> dict[tuple[str, str], set[str]]:
    """Arrows between parts, each with its imports; ``part_of`` gives a module's part, None for those left out."""
    found: dict[tuple[str, str], set[str]] = {}
    for name, module in modules.items():
        for target in imported_modules(import_nodes(module.tree), modules):
            start, end = part_of(name), part_of(target)
            if start and end and start != end:
                found.setdefault((start, end), set()).add(f"{name} -> {target}")
    return found


def circle(pairs: Collection[tuple[str, str]]) -> list[str]:
    """The parts along one circle of arrows, the first one again at the end; empty without a circle."""
    sorter: graphlib.TopologicalSorter[str] = graphlib.TopologicalSorter()
    for start, end in pairs:
        sorter.add(start, end)
    try:
        sorter.prepare()
    except graphlib.CycleError as error:
        return list(reversed(error.args[1]))
    return []


# attributes


def attribute_lines(module: Module) -> list[int]:
    """Lines that read ``attrs[...]`` or ``attrs.get(...)``, or write ``attrs[...]`` of a local mapping.

    ``x.attrs[...] = ...`` does not count: a product cannot be changed, so x is an object of an HDF5 file.
    """
    return sorted(node.lineno for node in ast.walk(module.tree) if _takes_attribute(node))


def _takes_attribute(node: ast.AST) -> TypeGuard[ast.expr]:
    if isinstance(node, ast.Subscript):
        is_file = isinstance(node.value, ast.Attribute) and isinstance(node.ctx, ast.Store)
        return _is_named(node.value, "attrs") and not is_file
    is_get = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "get"
    return is_get and _is_named(node.func.value, "attrs")


def _is_named(node: ast.AST, name: str) -> bool:
    """Whether an expression is a name or an attribute of that name."""
    return (isinstance(node, ast.Name) and node.id == name) or (isinstance(node, ast.Attribute) and node.attr == name)


# functions


def functions(module: Module) -> list[Function]:
    """All functions of a module, methods and nested ones too."""
    top = {id(node) for node in module.tree.body}
    compiled = _compiled_names(module.tree)
    nodes = [node for node in ast.walk(module.tree) if isinstance(node, _FunctionNode)]
    return [_function(node, module.name, id(node) in top, node.name in compiled) for node in nodes]


def _function(node: _FunctionNode, module: str, is_top: bool, is_compiled: bool) -> Function:
    arguments = _arguments(node)
    return Function(
        name=node.name,
        place=f"{module}:{node.lineno}",
        lines=_body_lines(node),
        arguments=len(arguments),
        any_arguments=sum(_is_named(argument.annotation, "Any") for argument in arguments if argument.annotation),
        is_typed=node.returns is not None and all(argument.annotation for argument in arguments),
        is_command=is_top and layer_of(module) == "cli" and not node.name.startswith("_"),
        is_kernel=is_compiled or any(_is_njit(decorator) for decorator in node.decorator_list),
    )


def _body_lines(node: _FunctionNode) -> int:
    body = node.body[1:] if ast.get_docstring(node, clean=False) is not None else node.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def _arguments(node: _FunctionNode) -> list[ast.arg]:
    given = node.args
    stars = [star for star in (given.vararg, given.kwarg) if star is not None]
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs, *stars]
    return [argument for argument in every if argument.arg not in ("self", "cls")]


def _is_njit(node: ast.expr) -> bool:
    """Whether an expression is ``njit`` or ``njit(...)``."""
    return _is_named(node.func if isinstance(node, ast.Call) else node, "njit")


def _compiled_names(tree: ast.Module) -> set[str]:
    """Names of functions that are compiled by a call, as in ``kernel = njit(cache=True)(_function)``."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and _is_njit(node.func)]
    return {argument.id for call in calls for argument in call.args if isinstance(argument, ast.Name)}


def in_function_imports(module: Module) -> int:
    """Number of import statements inside functions."""
    inside = [node for node in ast.walk(module.tree) if isinstance(node, _FunctionNode)]
    return len({id(node) for function in inside for node in import_nodes(function)})


def percentile(values: Sequence[int], percent: float) -> int:
    """The smallest value that at least so many per cent of the values do not exceed."""
    return sorted(values)[max(0, math.ceil(len(values) * percent / 100) - 1)]


# the table


def _arrow_figures(modules: Mapping[str, Module]) -> list[Figure]:
    every, stages = arrows(modules, chapter_of), arrows(modules, stage_of)
    common = common_ground(modules)
    between = [pair for pair in every if not common & set(pair)]
    return [
        Figure("arrows between chapters of core", len(between), MAX_ARROWS),
        Figure("... and their common modules", len(every)),
        Figure("chapters and modules in a circle", len(set(circle(every))), 0),
        Figure("arrows between stages", len(stages), 0),
    ]


def _function_figures(found: Sequence[Function]) -> list[Figure]:
    lines = [function.lines for function in found]
    kernels = [function for function in found if function.is_kernel]
    return [
        Figure("functions", len(found)),
        Figure("median length", statistics.median(lines), MAX_MEDIAN, unit="lines"),
        Figure("90th percentile of length", percentile(lines, 90), MAX_P90, unit="lines"),
        Figure("largest length", max(lines), MAX_LINES, unit="lines"),
        Figure(f"functions above {MAX_ARGUMENTS} arguments", len(_wide(found)), 0),
        Figure("typed functions", 100 * statistics.mean(function.is_typed for function in found), unit="%"),
        Figure("arguments of numba kernels", sum(function.arguments for function in kernels)),
        Figure("... of type Any", sum(function.any_arguments for function in kernels)),
    ]


def _module_figures(modules: Mapping[str, Module]) -> list[Figure]:
    inside = {name: in_function_imports(module) for name, module in modules.items()}
    return [
        Figure("modules", len(modules)),
        Figure("largest module", max(module.lines for module in modules.values()), MAX_MODULE_LINES, unit="lines"),
        Figure("attributes of products outside kinds", sum(map(len, _attributes(modules).values())), 0),
        Figure("imports inside functions", sum(inside.values())),
        Figure("... of stages", sum(number for name, number in inside.items() if layer_of(name) == "stages")),
    ]


def _wide(found: Sequence[Function]) -> list[Function]:
    return [function for function in found if function.arguments > MAX_ARGUMENTS and not function.is_command]


def _attributes(modules: Mapping[str, Module]) -> dict[str, list[int]]:
    """Lines that take attributes, by the modules outside kinds that have some; the product's own reads its warnings."""
    others = {name: one for name, one in modules.items() if layer_of(name) != "kinds" and name != _PRODUCT}
    lines = {name: attribute_lines(module) for name, module in others.items()}
    return {name: found for name, found in lines.items() if found}


def _lists(modules: Mapping[str, Module], found: Sequence[Function]) -> dict[str, list[str]]:
    """What the figures count, by title."""
    longest = sorted(found, key=lambda function: -function.lines)[:5]
    large = [module for module in modules.values() if module.lines > MAX_MODULE_LINES]
    return {
        "circle": circle(arrows(modules, chapter_of)),
        "arrows between stages": sorted(" -> ".join(pair) for pair in arrows(modules, stage_of)),
        "longest functions": [f"{one.place} {one.name}, {one.lines} lines" for one in longest],
        f"modules above {MAX_MODULE_LINES} lines": [f"{module.name}, {module.lines} lines" for module in large],
        f"functions above {MAX_ARGUMENTS} arguments, without self and cls": [
            f"{one.place} {one.name}, {one.arguments} arguments" for one in _wide(found)
        ],
        "modules that take attributes of products": [
            f"{name}: {', '.join(map(str, lines))}" for name, lines in _attributes(modules).items()
        ],
    }


def main(folder: Path = PACKAGE) -> int:
    """Print the figures and what they count; returns the exit code, 1 where a bar is missed."""
    modules = read_package(folder)
    found = [function for module in modules.values() for function in functions(module)]
    code = print_figures([*_arrow_figures(modules), *_function_figures(found), *_module_figures(modules)])
    for title, lines in _lists(modules, found).items():
        print(f"\n{title}: {len(lines) or 'none'}", *lines, sep="\n  ")
    return code


if __name__ == "__main__":
    sys.exit(main())
