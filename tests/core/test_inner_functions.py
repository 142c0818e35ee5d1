"""Functions that kernels call are part of each kernel, so that no kernel runs what another one was compiled to."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

from numba.core.registry import CPUDispatcher

import dicflow.core


def kernels() -> Iterator[CPUDispatcher]:
    """All compiled functions of the core that measure; those that render must not change a byte of data_samples."""
    for module in pkgutil.walk_packages(dicflow.core.__path__, "dicflow.core."):
        if module.name.startswith("dicflow.core.synthetic"):
            continue
        for name, found in vars(importlib.import_module(module.name)).items():
            if isinstance(found, CPUDispatcher) and found.py_func.__module__ == module.name and name != "njit":
                yield found


def test_what_a_kernel_calls_is_inlined():
    calls = 0
    for kernel in kernels():
        code, names = kernel.py_func.__code__, kernel.py_func.__globals__
        for name in code.co_names:
            if isinstance(names.get(name), CPUDispatcher):
                calls += 1
                assert names[name].targetoptions.get("forceinline"), f"{kernel.py_func.__name__} calls {name}"
    assert calls > 50


def test_python_does_not_call_what_has_no_entrance():
    package = Path(dicflow.__file__).parent
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in package.rglob("*.py")}
    inner = {_module(path, package): _inner_functions(tree) for path, tree in trees.items()}
    assert sum(len(names) for names in inner.values()) > 80
    for path, tree in trees.items():
        seen = inner[_module(path, package)] | _imported(tree, inner)
        assert not seen & _called_by_python(tree), path


def test_what_counts_no_references_returns_no_array():
    """Its caller would give up an array that it does not hold. The other names are tuples of numbers."""
    numbers = {"None", "bool", "int", "float", "tuple", "np", "float32", "Weights", "Window", "Sums"}
    package, seen = Path(dicflow.__file__).parent, 0
    for path in package.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and _has_options(node, "INNER"):
                seen += 1
                assert set(re.findall(r"\w+", ast.unparse(node.returns))) <= numbers, f"{path}: {node.name}"
    assert seen > 80


def test_a_call_by_python_is_seen():
    tree = ast.parse("""
@njit(error_model="numpy", **INNER)
def inner(): ...
@njit(**MAKER)
def maker(): ...
@njit(**KERNEL)
def kernel(): inner(), maker()
def outer(): kernel()
class One:
    def of_class(self): return [inner() for _ in "ab"]
""")
    assert _inner_functions(tree) == {"inner", "maker"}
    assert _called_by_python(tree) & {"inner", "kernel"} == {"inner", "kernel"}


def _module(path: Path, package: Path) -> str:
    return ".".join(path.relative_to(package.parent).with_suffix("").parts)


def _is_compiled(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(part) for part in node.decorator_list)


def _inner_functions(tree: ast.Module) -> set[str]:
    """Functions of a module without an entrance from Python."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return {node.name for node in functions if _has_options(node, "INNER") or _has_options(node, "MAKER")}


def _has_options(node: ast.FunctionDef, name: str) -> bool:
    return any(name in ast.unparse(part) for part in node.decorator_list)


def _imported(tree: ast.Module, inner: dict[str, set[str]]) -> set[str]:
    """Those of other modules that a module imports, anywhere."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module in inner]
    return {alias.name for node in imports for alias in node.names if alias.name in inner[str(node.module)]}


def _called_by_python(tree: ast.AST) -> set[str]:
    """Names that are called outside compiled functions."""
    found: set[str] = set()
    for node in ast.iter_child_nodes(tree):
        if not _is_compiled(node):
            found |= _called_by_python(node)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            found.add(node.func.id)
    return found
