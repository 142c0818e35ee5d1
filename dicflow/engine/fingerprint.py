"""Fingerprint of the code that a stage uses, so that an edited helper never passes unnoticed.

The fingerprint covers the stage's module and every module of the same package that it imports, at the top or inside a
function, directly or through others. It is taken from the syntax tree: comments, docstrings, line breaks, titles and
descriptions of parameters do not count. Of :mod:`dicflow.engine` only the modules that a stage computes with (products,
nodes, units) are covered: the rest decides when and where a stage runs, never what it gives.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from dicflow.engine.files import FileIndex
from dicflow.engine.hashing import digest_json
from dicflow.errors import ConfigurationError

__all__ = ["Fingerprint", "code_of", "fingerprint"]

Fingerprint = dict[str, str]
"""Module → digest of its code."""

_ENGINE = "dicflow.engine"
_COVERED = {f"{_ENGINE}.{name}" for name in ("node", "product", "units")}


def fingerprint(cls: type, index: FileIndex) -> Fingerprint:
    """Digests of all modules that a class uses, by name.

    cls : class of a stage
    index : remembers the syntax of unchanged source files
    Raises ConfigurationError for a class whose source is not in a file.
    """
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    if file is None:
        raise ConfigurationError(f"{cls.__qualname__}: its source is in no file; put the stage into a module")
    source = Path(file)
    root = source.parents[cls.__module__.count(".") + (source.name == "__init__.py")]
    packages = {cls.__module__.partition(".")[0], "dicflow"}
    roots = {"dicflow": Path(__file__).parents[2], cls.__module__.partition(".")[0]: root}
    found: Fingerprint = {}
    waiting = [(cls.__module__, source)]
    while waiting:
        module, path = waiting.pop()
        if module in found:
            continue
        code = index.fact(path, f"code:{module}", partial(code_of, module=module))
        found[module] = code["digest"]
        names = [pair for pair in code["imports"] if pair[0].partition(".")[0] in packages]
        waiting += [(name, file) for pair in names for name, file in _files(roots, *pair) if _counts(name)]
    return dict(sorted(found.items()))


def code_of(path: Path, module: str) -> dict[str, Any]:
    """Digest of a source file's meaning, and the names that it imports: [module, name or ""]."""
    tree = ast.parse(path.read_bytes(), str(path))
    imports = sorted({pair for node in _running(tree) for pair in _imports(node, module, path)})
    text = ast.dump(_Bare().visit(tree), annotate_fields=False)
    return {"digest": digest_json(text), "imports": [list(pair) for pair in imports]}


def _counts(module: str) -> bool:
    return module in _COVERED or not (module == _ENGINE or module.startswith(f"{_ENGINE}."))


def _files(roots: dict[str, Path], module: str, name: str) -> Iterator[tuple[str, Path]]:
    """The source files behind ``import module`` or ``from module import name``."""
    root = roots[module.partition(".")[0]]
    inner = f"{module}.{name}" if name else module
    for candidate in (inner, module):
        base = root.joinpath(*candidate.split("."))
        for path in (base.with_suffix(".py"), base / "__init__.py"):
            if path.is_file():
                yield candidate, path
                return


def _running(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes of a tree but those that only a type checker sees."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            waiting += node.orelse
            continue
        yield node
        waiting += ast.iter_child_nodes(node)


def _imports(node: ast.AST, module: str, path: Path) -> Iterator[tuple[str, str]]:
    if isinstance(node, ast.Import):
        yield from ((alias.name, "") for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            parts = module.split(".") + ["__init__"] * (path.name == "__init__.py")
            base = ".".join([*parts[: -node.level], *filter(None, [node.module])])
        yield from ((base, alias.name) for alias in node.names)


class _Bare(ast.NodeTransformer):
    """Takes out of a tree what changes no result."""

    def generic_visit(self, node: ast.AST) -> ast.AST:
        body = getattr(node, "body", None)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and body:
            node.body = [part for part in body if not _is_text(part) and not _is_title(part)] or [ast.Pass()]
        return super().generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if isinstance(node.func, ast.Name) and node.func.id == "parameter":
            node.args = node.args[:1]
            node.keywords = [word for word in node.keywords if word.arg != "description"]
        return self.generic_visit(node)


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _is_title(node: ast.stmt) -> bool:
    return isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == "title"
