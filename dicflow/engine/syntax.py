"""What statements bind and names say, read from syntax trees of Python."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

__all__ = [
    "Definition",
    "Globals",
    "Import",
    "Origin",
    "Target",
    "assigned",
    "bound",
    "called",
    "counting",
    "dotted",
    "places",
]

Target = tuple[str, ...]
"""Module, and the names that lead on from it: of a definition, or of what an import binds and its attributes."""

Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
Import = ast.Import | ast.ImportFrom

_ENGINE = "dicflow.engine"
_COVERED = {f"{_ENGINE}.{name}" for name in ("node", "product", "units")}
_LOGGERS = {"log", "logger", "logging"}
_LOG_METHODS = {"debug", "info", "warning", "error", "exception", "critical", "log"}


class Origin(NamedTuple):
    """Where code stands: its module, and whether that is the ``__init__`` of a package."""

    module: str
    package: bool

    def owns(self, module: str) -> bool:
        """Whether a module is dicflow's or of the same package, and can change a result."""
        if module.partition(".")[0] not in ("dicflow", self.module.partition(".")[0]):
            return False
        return module in _COVERED or not f"{module}.".startswith(f"{_ENGINE}.")

    def imported(self, node: ast.stmt) -> Iterator[tuple[str, Target]]:
        """Name and target of everything that an import statement binds; the name ``*`` for all of a module."""
        if isinstance(node, ast.Import):
            for alias in node.names:
                top = alias.name.partition(".")[0]
                yield (alias.asname, (alias.name,)) if alias.asname else (top, (top,))
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield alias.asname or alias.name, (self._base(node), alias.name)

    def loaded(self, node: ast.AST) -> Iterator[tuple[str, Target]]:
        """Name that an import statement binds, and everything that it loads."""
        if isinstance(node, ast.Import):
            yield from ((alias.asname or alias.name.partition(".")[0], (alias.name,)) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield alias.asname or alias.name, (self._base(node),)
                yield alias.asname or alias.name, (self._base(node), alias.name)

    def _base(self, node: ast.ImportFrom) -> str:
        if not node.level:
            return node.module or ""
        parts = [*self.module.split("."), *["__init__"] * self.package]
        return ".".join([*parts[: -node.level], *filter(None, [node.module])])


@dataclass
class Globals:
    """The global names of a module.

    own : those that it defines
    imports : name → targets of the imports that bind it
    """

    origin: Origin
    own: set[str] = field(default_factory=set)
    imports: dict[str, list[Target]] = field(default_factory=dict)

    def targets(self, name: str) -> list[Target]:
        """Where a name leads to; nowhere for builtins and what other packages give."""
        found = [target for target in self.imports.get(name, []) if self.origin.owns(target[0])]
        return [*found, (self.origin.module, name)] if name in self.own else found


def counting(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """The statements of a body that do something, without what only a type checker sees."""
    for node in body:
        if isinstance(node, ast.If) and (dotted(node.test) or ("",))[-1] == "TYPE_CHECKING":
            yield from counting(node.orelse)
        elif not (isinstance(node, ast.Pass) or _is_text(node) or _is_log(node)):
            yield node


def bound(body: Iterable[ast.stmt], origin: Origin, arguments: ast.arguments | None = None) -> dict[str, list[Target]]:
    """Names that statements bind in their scope; with targets where imports do."""
    found: dict[str, list[Target]] = {}
    free: set[str] = set()
    waiting: list[ast.AST] = [*body]
    if arguments is not None:
        found.update((part.arg, []) for part in ast.walk(arguments) if isinstance(part, ast.arg))
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Global | ast.Nonlocal):
            free.update(node.names)
        elif isinstance(node, Import):
            for name, target in origin.imported(node):
                found.setdefault(name, []).append(target)
        else:
            found.update((name, found.get(name, [])) for name in _names_of(node))
            waiting += _same_scope(node)
    return {name: targets for name, targets in found.items() if name not in free}


def _names_of(node: ast.AST) -> list[str]:
    """Names that a node itself binds."""
    if isinstance(node, ast.Name):
        return [] if isinstance(node.ctx, ast.Load) else [node.id]
    if isinstance(node, Definition | ast.ExceptHandler | ast.MatchAs | ast.MatchStar):
        return [node.name] if node.name else []
    return [node.rest] if isinstance(node, ast.MatchMapping) and node.rest else []


def _same_scope(node: ast.AST) -> list[ast.AST]:
    """The parts of a node that bind names in the scope it stands in."""
    if isinstance(node, Definition | ast.Lambda):
        return []
    if isinstance(node, ast.comprehension):
        return [node.iter, *node.ifs]
    return list(ast.iter_child_nodes(node))


def places(node: ast.Assign | ast.AnnAssign) -> list[ast.expr]:
    return node.targets if isinstance(node, ast.Assign) else [node.target]


def assigned(node: ast.stmt) -> list[str]:
    """The names to which a statement assigns, when it does nothing else."""
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
        return []
    parts = [part for place in places(node) for part in ast.walk(place) if not isinstance(part, ast.expr_context)]
    if not all(isinstance(part, ast.Name | ast.Tuple | ast.List | ast.Starred) for part in parts):
        return []
    return [part.id for part in parts if isinstance(part, ast.Name)]


def called(node: ast.expr) -> ast.expr:
    return node.func if isinstance(node, ast.Call) else node


def dotted(node: ast.expr) -> Target:
    """``a.b.c`` as its names; nothing for any other expression."""
    names: list[str] = []
    while isinstance(node, ast.Attribute):
        names.append(node.attr)
        node = node.value
    return (node.id, *reversed(names)) if isinstance(node, ast.Name) else ()


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _is_log(node: ast.stmt) -> bool:
    """Whether a statement only writes to a log or warns."""
    if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Call):
        return False
    names = dotted(node.value.func)
    if names[-2:] in (("warnings", "warn"), ("warn",)):
        return True
    return len(names) > 1 and names[-2].strip("_").lower() in _LOGGERS and names[-1] in _LOG_METHODS
