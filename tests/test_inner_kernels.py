"""Functions that kernels alone may call: Python that calls one ends without a word."""

import ast
from pathlib import Path

import dicflow

PACKAGE = Path(dicflow.__file__).parent


def functions(tree, decorator):
    """Functions of a module that a decorator with a text makes."""
    found = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
    return [function for function in found if any(decorator in ast.unparse(one) for one in function.decorator_list)]


def inner_functions():
    """Module → names of its functions that kernels alone may call."""
    paths = sorted((PACKAGE / "core").rglob("*.py"))
    names = {path: {one.name for one in functions(ast.parse(path.read_text()), "**INNER")} for path in paths}
    return {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): found for path, found in names.items()}


def calls_from_python(path, inner):
    """Places where Python, which is no kernel, calls such a function."""
    tree = ast.parse(path.read_text())
    imports = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    known = {
        name.asname or name.name for one in imports for name in one.names if name.name in inner.get(one.module, ())
    } | {function.name for function in functions(tree, "**INNER")}
    made = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "njit"]
    in_kernels = {id(node) for kernel in [*functions(tree, "njit"), *made] for node in ast.walk(kernel)}
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call) and id(node) not in in_kernels)
    return [f"{path}:{call.lineno}" for call in calls if isinstance(call.func, ast.Name) and call.func.id in known]


def test_python_calls_no_inner_function():
    inner = inner_functions()
    assert sum(map(len, inner.values())) > 20
    places = [*PACKAGE.rglob("*.py"), *Path(__file__).parent.rglob("*.py")]
    assert [call for path in places for call in calls_from_python(path, inner)] == []
