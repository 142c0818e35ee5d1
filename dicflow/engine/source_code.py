"""One source file as definitions: the bare code of each, and what the global names in it lead to.

A definition is what binds a name at the top of a module: functions, classes, assignments to plain names. Imports bind
names too, but are followed instead of counted. Every other statement at the top (a call, an assignment to an item, an
``if`` or ``try`` with what it binds) belongs to the module's statements, which count for each of its definitions. So do
definitions that code of the same packages decorates, which may register them, and imports of what is used nowhere.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from dicflow.discovery import syntax_tree
from dicflow.engine.bare_code import BareCode
from dicflow.engine.hashing import digest_json
from dicflow.engine.syntax import Definition, Globals, Import, Origin, Target, assigned, bound, called, counting, dotted

__all__ = ["code_of"]

_REGISTERING = ("overload", "register")
"""How names of decorators of other packages start that note down what they decorate."""


def code_of(path: Path, module: str) -> dict[str, Any]:
    """The definitions of a source file, as a JSON value.

    definitions : name → [digest of its bare code, targets of the names that it uses]
    statements : the same of the module's statements; None without any
    bound : names that the statements bind
    imports : name → targets of the imports that bind it

    Raises SyntaxError for what is no Python.
    """
    tree = syntax_tree(path.read_bytes(), str(path))
    source = _Module(tree.body, Origin(module, path.name == "__init__.py"))
    return {
        "definitions": {name: source.definition(name) for name in source.definitions},
        "statements": source.statements(_only_loaded(tree, source.globals.origin)),
        "bound": sorted(source.bound),
        "imports": source.imports(),
    }


def _only_loaded(tree: ast.Module, origin: Origin) -> list[Target]:
    """Targets of the imports of names that occur nowhere in a file."""
    waiting: list[ast.AST] = [tree]
    used: set[object] = set()
    loaded: list[tuple[str, Target]] = []
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Name):
            used.add(node.id)
        elif isinstance(node, Import):
            loaded += origin.loaded(node)
        elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            used |= {part.value for part in ast.walk(node.value) if isinstance(part, ast.Constant)}
        for value in ast.iter_child_nodes(node):
            waiting += counting([value]) if isinstance(value, ast.If) else [value]
    return sorted({target for name, target in loaded if name not in used and origin.owns(target[0])})


class _Module:
    """The statements of a module, by what they bind."""

    def __init__(self, body: list[ast.stmt], origin: Origin) -> None:
        self.globals = Globals(origin)
        self.definitions: dict[str, list[ast.stmt]] = {}
        self.loose: list[ast.stmt] = []
        for node in counting(body):
            self._sort_in(node)
        names = bound(self.loose, origin)
        self.bound = {name for name, targets in names.items() if not targets}
        for name in names.keys() - self.bound:
            self.globals.imports.setdefault(name, []).extend(names[name])
        self.globals.own = {*self.definitions, *self.bound}

    def definition(self, name: str) -> list[Any]:
        """Digest and targets of one definition."""
        bare = BareCode(self.globals, own=name)
        for node in self.definitions[name]:
            bare.add(node)
        return [digest_json(bare.text), bare.targets]

    def statements(self, loaded: Iterable[Target]) -> list[Any] | None:
        """Digest and targets of what counts for every definition. loaded : imports for what loading them does"""
        bare = BareCode(self.globals)
        for node in self.loose:
            bare.add(node)
        for target in loaded:
            bare.mark(target)
        for name, nodes in self.definitions.items():
            if any(self._registers(node) for node in nodes):
                bare.mark((self.globals.origin.module, name))
        return [digest_json(bare.text), bare.targets] if bare.text else None

    def imports(self) -> dict[str, list[list[str]]]:
        """Targets by name; of what is not followed, its full name behind no module."""
        owns = self.globals.origin.owns
        return {
            name: [list(target) if owns(target[0]) else ["", ".".join(target)] for target in targets]
            for name, targets in self.globals.imports.items()
        }

    def _sort_in(self, node: ast.stmt) -> None:
        names = [node.name] if isinstance(node, Definition) else assigned(node)
        for name in names:
            self.definitions.setdefault(name, []).append(node)
        if isinstance(node, Import):
            for name, target in self.globals.origin.imported(node):
                self.globals.imports.setdefault(name, []).append(target)
        elif not names and (not isinstance(node, ast.AnnAssign) or node.value is not None):
            self.loose.append(node)

    def _registers(self, node: ast.stmt) -> bool:
        """Whether a decorator may note a definition down somewhere: one of these packages, or one called so."""
        parts = [node, *node.body] if isinstance(node, ast.ClassDef) else [node]
        decorators = [called(one) for part in parts if isinstance(part, Definition) for one in part.decorator_list]
        if any((dotted(one) or ("",))[-1].startswith(_REGISTERING) for one in decorators):
            return True
        names = [part.id for one in decorators for part in ast.walk(one) if isinstance(part, ast.Name)]
        return any(self.globals.targets(name) for name in names)
