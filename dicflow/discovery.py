"""Members of a registry: the modules of a package of dicflow, and entry points of other packages.

A module is a member under its own name, an entry point under the name that its package gives it. Nothing is imported
before it is used, so a broken plug-in affects only those who use it.
"""

from __future__ import annotations

import ast
import difflib
import importlib
import pkgutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.abc import InspectLoader
from importlib.util import find_spec
from threading import Lock
from typing import Any, NamedTuple

from dicflow.errors import ConfigurationError

__all__ = ["Member", "Registry", "nearest", "syntax_tree"]

_parsing = Lock()


class Member(NamedTuple):
    """Where a member is defined.

    module : full name of its module
    attribute : name of the member in the module; empty for the module itself
    place : the module, or the other package with its version and the entry point, as messages name it
    is_plugin : whether it is an entry point of another package
    """

    name: str
    module: str
    attribute: str
    place: str
    is_plugin: bool


@dataclass(frozen=True)
class Registry:
    """Members of one sort by name.

    what : noun for a member in messages, such as "stage"
    package : package of dicflow whose modules are members, except those whose names start with ``_``; "" for none
    group : group of entry points whose values are ``package.module`` or ``package.module:attribute``
    needs : names that a member must define; a module of ``package`` without the first one is not a member
    """

    what: str
    package: str
    group: str
    needs: tuple[str, ...] = ()

    def members(self) -> tuple[Member, ...]:
        """All members, sorted by name. A name that two packages use occurs twice."""
        return _members(self)

    def names(self) -> tuple[str, ...]:
        """Names of all members, sorted."""
        return tuple(dict.fromkeys(member.name for member in self.members()))

    def find(self, name: str) -> Member:
        """The member of this name.

        Raises ConfigurationError that suggests the nearest name for an unknown one, and names both
        places for a name that exists twice.
        """
        found = [member for member in self.members() if member.name == name]
        if not found:
            names = self.names()
            raise ConfigurationError(f"no {self.what} '{name}'{nearest(name, names)}; {self.what}s: {', '.join(names)}")
        if len(found) > 1:
            places = " and ".join(member.place for member in found)
            raise ConfigurationError(f"two {self.what}s have the name '{name}': {places}; uninstall or rename one")
        return found[0]

    def load(self, name: str) -> Any:
        """Import a member: a module, or the object that the entry point names.

        Raises ConfigurationError as :meth:`find`, and for a plug-in that cannot be imported or lacks what it needs.
        """
        member = self.find(name)
        with self._usable(member):
            loaded = importlib.import_module(member.module)
            if member.attribute:
                loaded = getattr(loaded, member.attribute)
        missing = [need for need in self.needs if not hasattr(loaded, need)]
        if missing:
            raise ConfigurationError(
                f"{self.what} '{name}' of {member.place} has no {' and no '.join(missing)}; "
                f"each {self.what} needs {', '.join(self.needs)}"
            )
        return loaded

    def constant(self, name: str, constant: str, default: Any = None) -> Any:
        """A constant of a member's module, read from its source: the module is not imported.

        default : for a module that does not assign it
        Raises ConfigurationError as :meth:`load`, and for a constant that is not a literal.
        """
        member = self.find(name)
        with self._usable(member):
            value = _assigned(_tree(member.module)).get(constant)
            return default if value is None else ast.literal_eval(value)

    def plugin_code(self) -> list[str]:
        """Place and source text of each plug-in; the text is empty if it cannot be read."""
        return [
            text for member in self.members() if member.is_plugin for text in (member.place, _source_or_empty(member))
        ]

    @contextmanager
    def _usable(self, member: Member) -> Iterator[None]:
        """Turn any error of a plug-in into a message that names it."""
        try:
            yield
        except Exception as error:
            if not member.is_plugin:
                raise
            raise ConfigurationError(
                f"{self.what} '{member.name}' of {member.place} cannot be used: {type(error).__name__}: {error}; "
                "repair or uninstall that package"
            ) from error


def nearest(word: str, words: Iterable[str]) -> str:
    """``", did you mean 'x'?"`` if one of the words is near, else an empty string."""
    near = difflib.get_close_matches(word, list(words), n=1, cutoff=0.6)
    return f", did you mean '{near[0]}'?" if near else ""


@cache
def _members(registry: Registry) -> tuple[Member, ...]:
    return tuple(sorted([*_own_members(registry), *_plugin_members(registry)]))


def _own_members(registry: Registry) -> Iterator[Member]:
    if not registry.package:
        return
    package = importlib.import_module(registry.package)
    for found in pkgutil.iter_modules(package.__path__):
        module = f"{registry.package}.{found.name}"
        if not found.name.startswith("_") and (not registry.needs or _declares(module, registry.needs[0])):
            yield Member(found.name, module, "", module, is_plugin=False)


def _plugin_members(registry: Registry) -> Iterator[Member]:
    from importlib.metadata import entry_points  # costs more than the rest of this module

    for point in entry_points(group=registry.group):
        package = f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown package"
        place = f"{package} (entry point {point.name} = {point.value})"
        yield Member(point.name, point.module, point.attr, place, is_plugin=True)


@cache
def _source(module: str) -> str:
    """Text of a module, which is not imported itself; the packages around it are."""
    spec = find_spec(module)
    if spec is None or not isinstance(spec.loader, InspectLoader):
        raise ModuleNotFoundError(f"No module named '{module}'")
    return spec.loader.get_source(module) or ""


def _source_or_empty(member: Member) -> str:
    try:
        return _source(member.module)
    except Exception:  # the code of others, imported on the way
        return ""


@cache
def _tree(module: str) -> ast.Module:
    return syntax_tree(_source(module), module)


def syntax_tree(source: str | bytes, name: str) -> ast.Module:
    """The syntax tree of Python code. Raises SyntaxError.

    One thread at a time makes one: CPython 3.11 counts the depth of a tree once for all threads, and raises SystemError
    where another one counts meanwhile.

    name : of the file or module, as errors name it
    """
    with _parsing:
        return ast.parse(source, name)


def _declares(module: str, name: str) -> bool:
    """Whether a module assigns a name at its top."""
    return name in _source(module) and name in _assigned(_tree(module))


def _assigned(tree: ast.Module) -> dict[str, ast.expr]:
    """Values of the names that a module assigns at its top."""
    found: dict[str, ast.expr] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            found |= {target.id: node.value for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
            found[node.target.id] = node.value
    return found
