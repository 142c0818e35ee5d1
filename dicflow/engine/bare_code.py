"""Bare code: a definition as text, without what changes no result and without the names of other code.

Left out are comments, docstrings, annotations of functions and variables (those of class bodies stay), titles,
descriptions of parameters, arguments of a raised exception, log lines, and what only a type checker sees. In the place
of a name that leads to other code stands a mark; its target is listed beside the text.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from dicflow.engine.syntax import Definition, Globals, Import, Target, assigned, bound, called, counting, dotted, places

__all__ = ["BareCode"]

_ERRORS = ("Error", "Exception", "Warning")
_OWN_NAMESPACE = {"globals", "vars", "eval", "exec"}
"""Functions that reach all names of the module they are called in."""
_READ_ANNOTATIONS = {"register", "validate_call"}
"""Decorators to which the annotations of a function are code."""


class BareCode:
    """Writes bare code as text, with the targets of the names in it.

    own : name of the definition, which its code does not hold

    A mark is ``@`` and a number, a local name ``$`` and itself, a name of another package ``!`` and its full name.
    """

    def __init__(self, names: Globals, own: str = "") -> None:
        self.names = names
        self.own = own
        self._text: list[str] = []
        self._targets: dict[Target, int] = {}
        self._scopes: list[Mapping[str, list[Target]]] = []
        self._named = False
        self._in_class = False
        self._annotated = False

    @property
    def text(self) -> str:
        """The bare code."""
        return "".join(self._text)

    @property
    def targets(self) -> list[list[str]]:
        """Targets in the order of their marks."""
        return [list(target) for target in self._targets]

    def mark(self, target: Target) -> None:
        """Stand in for code elsewhere."""
        self._text.append(f"@{self._targets.setdefault(target, len(self._targets))}")

    def add(self, node: ast.stmt) -> None:
        """A statement from the top of a module."""
        if isinstance(node, Definition):
            self._define(node, "")
        elif isinstance(node, ast.Assign | ast.AnnAssign) and assigned(node):
            for place in places(node):
                shape = [getattr(part, "id", "") == self.own or type(part).__name__ for part in ast.walk(place)]
                self._text.append(f"{shape}")
            self._value(node.value)
        else:
            self._statements([node])

    def _statements(self, body: Iterable[ast.stmt]) -> None:
        self._text.append("{")
        for node in counting(body):
            if not isinstance(node, Import):
                self._value(node)
                self._text.append(";")
        self._text.append("}")

    def _value(self, value: Any) -> None:
        """Any part of a syntax tree."""
        if isinstance(value, ast.AST):
            write: Callable[[Any], None] = getattr(self, f"_{type(value).__name__}", self._generic)
            write(value)
        elif not isinstance(value, list):
            self._text.append(repr(value))
        elif value and isinstance(value[0], ast.stmt):
            self._statements(value)
        else:
            for part in value:
                self._value(part)
                self._text.append(",")

    def _generic(self, node: ast.AST, *without: str) -> None:
        self._text.append(f"({type(node).__name__}")
        for name in node._fields:
            value = getattr(node, name, None)
            if value is None or value == [] or name in ("ctx", "type_comment") or name in without:
                continue
            self._text.append(f" {name}=")
            self._value(value)
        self._text.append(")")

    def _within(self, scope: Mapping[str, list[Target]], write: Callable[..., None], *values: Any) -> None:
        self._scopes.append(scope)
        write(*values)
        self._scopes.pop()

    # names

    def _Name(self, node: ast.Name) -> None:
        if self._in_class and isinstance(node.ctx, ast.Store):
            self._text.append(f"${node.id}")
        else:
            self._use(node.id, ())

    def _Attribute(self, node: ast.Attribute) -> None:
        name, *attributes = dotted(node) or ("",)
        module = self.names.origin.module
        if any(len(target) == 1 or target[0] != module for target in self._lookup(name) or ()):
            self._use(name, tuple(attributes))
        else:
            self._generic(node)

    def _Constant(self, node: ast.Constant) -> None:
        self._text.append(repr(node.value))

    def _use(self, name: str, attributes: Target) -> None:
        """A name, and its attributes where it is imported."""
        targets, foreign = self._lookup(name), self._foreign(name)
        if targets is None or foreign:
            self._text.append(f"!{foreign or name}")
        if targets is None and name in _OWN_NAMESPACE:
            self.mark((self.names.origin.module,))
        for target in targets or ():
            self.mark((*target, *attributes))
        if targets is not None and (self._named or not targets):
            self._text.append(f"${(*targets[0], *attributes)[-1] if targets else name}")

    def _lookup(self, name: str) -> list[Target] | None:
        """Where a name leads to; an empty list for local names, None for builtins and what other packages give."""
        scope = next((scope for scope in reversed(self._scopes) if name in scope), None)
        if scope is None:
            return self.names.targets(name) or None
        found = [target for target in scope[name] if self.names.origin.owns(target[0])]
        return found if found or not scope[name] else None

    def _foreign(self, name: str) -> str:
        """Full name of what another package gives under a name."""
        scope = next((scope for scope in reversed(self._scopes) if name in scope), self.names.imports)
        return "|".join(".".join(target) for target in scope.get(name, ()) if not self.names.origin.owns(target[0]))

    # definitions and scopes

    def _FunctionDef(self, node: Definition) -> None:
        self._define(node, node.name)

    _AsyncFunctionDef = _ClassDef = _FunctionDef

    def _define(self, node: Definition, name: str) -> None:
        self._text.append(f"({type(node).__name__} {name!r}")
        self._value(node.decorator_list)
        self._value(getattr(node, "type_params", []))
        before = self._in_class, self._annotated
        self._in_class = isinstance(node, ast.ClassDef)
        self._class(node) if isinstance(node, ast.ClassDef) else self._function(node)
        self._in_class, self._annotated = before
        self._text.append(")")

    def _class(self, node: ast.ClassDef) -> None:
        """The names of a class's body are names to nothing in its methods; its imports pass for such, to be safe."""
        self._value([*node.bases, *node.keywords])
        body = [part for part in node.body if not _is_title(part)]
        imports = {name: found for name, found in bound(body, self.names.origin).items() if found}
        self._within(imports, self._statements, body)

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        self._annotated = any((dotted(called(one)) or ("",))[-1] in _READ_ANNOTATIONS for one in node.decorator_list)
        self._value(node.args)
        if self._annotated:
            self._value(node.returns)
        self._within(bound(node.body, self.names.origin, node.args), self._statements, node.body)

    def _Lambda(self, node: ast.Lambda) -> None:
        self._value(node.args)
        self._within(bound([], self.names.origin, node.args), self._generic, node, "args")

    def _arg(self, node: ast.arg) -> None:
        self._generic(node, *() if self._annotated else ("annotation",))

    def _ListComp(self, node: ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp) -> None:
        """Its first iterable stands outside of its scope."""
        self._value(node.generators[0].iter)
        places = [part for one in node.generators for part in ast.walk(one.target)]
        self._within({part.id: [] for part in places if isinstance(part, ast.Name)}, self._generic, node)

    _SetComp = _DictComp = _GeneratorExp = _ListComp

    # what counts in part

    def _AnnAssign(self, node: ast.AnnAssign) -> None:
        if self._in_class:
            self._generic(node)
            for part in ast.walk(node.annotation):
                if isinstance(part, ast.Constant) and isinstance(part.value, str) and self._lookup(part.value):
                    self._use(part.value, ())
        elif node.value is not None:
            self._generic(ast.Assign([node.target], node.value))

    def _Raise(self, node: ast.Raise) -> None:
        error = node.exc
        if isinstance(error, ast.Call) and (dotted(error.func) or ("",))[-1].endswith(_ERRORS):
            error = error.func
        self._text.append("raise ")
        self._by_name(error)

    def _ExceptHandler(self, node: ast.ExceptHandler) -> None:
        self._text.append("except ")
        self._by_name(node.type)
        self._generic(node, "type")

    def _by_name(self, error: ast.expr | None) -> None:
        """A class of errors: code of the same form makes two of them no less different."""
        self._named = True
        self._value(error)
        self._named = False

    def _Call(self, node: ast.Call) -> None:
        if (dotted(node.func) or ("",))[-1] == "parameter":
            words = [word for word in node.keywords if word.arg != "description"]
            node = ast.Call(node.func, node.args[:1], words)
        self._generic(node)


def _is_title(node: ast.stmt) -> bool:
    titled = isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == "title"
    return titled and isinstance(getattr(node, "value", None), ast.Constant)
