"""Fingerprint of the code that a stage uses, so that an edited helper never passes unnoticed.

What counts: the stage's class, every function, class and constant that it uses, those that these use, and so on,
through imports at the top or inside functions; and of each module met on the way the statements that are more than
definitions. Where a name leads to no definition (a module passed around, ``from m import *``, an attribute made while
it runs), the whole module counts. Code that a stage finds in another way, it names in :meth:`Node.uses`.

What does not count: other packages than dicflow and the stage's own; of :mod:`dicflow.engine` all but products, nodes
and units, for the rest decides when and where a stage runs, never what it gives; and within a definition what its bare
code leaves out (:mod:`dicflow.engine.source_code`): comments, docstrings, annotations, descriptions, messages.

Names do not count either. The digest of a definition is made of its bare code and of the digests of what it uses, so
that renaming or moving functions and modules changes nothing. For the explanation of a difference the fingerprint also
lists the digest of the bare code of each definition, by name.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from dicflow.engine.components import components
from dicflow.engine.files import FileIndex
from dicflow.engine.hashing import digest_bytes, digest_json
from dicflow.engine.kernel_cache import account_folder
from dicflow.engine.source_code import code_of
from dicflow.errors import ConfigurationError

__all__ = ["Fingerprint", "Sources", "changed_names", "kept_sources"]

_PACKAGES = Path(__file__).parents[2]
_FORM = 1
"""Of what :func:`code_of` gives, since it is remembered by file."""
_STATEMENTS, _WHOLE = "", "*"
"""In the place of a definition's name: the statements of its module, or all of the module."""

Place = tuple[str, str]
"""Module and name of a definition."""


@dataclass(frozen=True)
class Fingerprint:
    """The code that a stage uses.

    root : digest of all of it; equal roots, equal fingerprints
    parts : "module:definition" → digest of its own bare code
    """

    root: str
    parts: Mapping[str, str] = field(default_factory=dict, compare=False)


def changed_names(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Names of the definitions whose own code differs, without those that only have another name.

    old, new : parts of two fingerprints; where one is empty, nothing is known
    """
    if not old or not new:
        return []
    common = [name for name in sorted(old.keys() & new.keys()) if old[name] != new[name]]
    gone, come = ({name: one[name] for name in one.keys() - other.keys()} for one, other in ((old, new), (new, old)))
    moved = set(gone.values()) & set(come.values())
    return sorted([*common, *(name for name, digest in {**gone, **come}.items() if digest not in moved)])


class _Parts(Mapping[str, str]):
    """Parts of a fingerprint, whose digests are made when they are asked for: of stages that run, few of many.

    places : of the definitions, by name
    """

    def __init__(self, places: Mapping[str, Place], digest: Callable[[Place], str]) -> None:
        self._places = places
        self._digest = digest

    def __getitem__(self, name: str) -> str:
        return self._digest(self._places[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class _Definition(NamedTuple):
    """A definition, linked. links : what its marks stand for: definitions, and attributes or names of these"""

    digest: str
    links: tuple[tuple[tuple[Place, ...], str], ...]

    def places(self) -> Iterator[Place]:
        """All definitions that it uses."""
        return (place for places, _ in self.links for place in places)


def kept_sources() -> FileIndex | None:
    """What is remembered of source files on this account, for all stores; None where it has no place for it."""
    folder = account_folder()
    if folder is None:
        return None
    return FileIndex(folder / f"sources-{digest_bytes(str(_PACKAGES).encode())[7:23]}.index")


class Sources:
    """The source files of dicflow and of plug-in packages, each looked at once for all fingerprints.

    index : remembers what is in unchanged source files
    """

    def __init__(self, index: FileIndex) -> None:
        self._index = index
        self._roots = {"dicflow": _PACKAGES}
        self._paths: dict[str, Path | None] = {}
        self._codes: dict[str, dict[str, Any] | None] = {}
        self._definitions: dict[Place, _Definition] = {}
        self._resolved: dict[tuple[str, ...], tuple[tuple[Place, ...], str]] = {}
        self._digests: dict[Place, str] = {}
        self._known: dict[tuple[type, tuple[str, ...]], Fingerprint] = {}

    def fingerprint(self, cls: type, uses: tuple[str, ...] = ()) -> Fingerprint:
        """Fingerprint of the class of a stage.

        uses : further code, as ``Node.uses`` names it
        Raises ConfigurationError for a class whose source is in no file.
        """
        found = self._known.get((cls, uses))
        if found is None:
            self._locate(cls)
            further = [self._named(name) for name in sorted(set(uses))]
            found = self._known[cls, uses] = self._taken([self._own(cls), *further])
        return found

    def save(self) -> None:
        """Keep what was found in source files."""
        self._index.save()

    def _taken(self, starts: list[tuple[tuple[Place, ...], str]]) -> Fingerprint:
        covered = self._covered(place for places, _ in starts for place in places)
        for members in components(covered, lambda place: self._definition(place).places(), self._digests):
            self._digest(members)
        root = digest_json([[[self._digests[place] for place in places], rest] for places, rest in starts])
        named = {":".join(filter(None, place)): place for place in covered if place[1] != _WHOLE}
        return Fingerprint(root, _Parts(dict(sorted(named.items())), self._own_digest))

    def _covered(self, starts: Iterable[Place]) -> list[Place]:
        """Everything that is used from some definitions on, these included."""
        waiting = list(starts)
        found = dict.fromkeys(waiting)
        while waiting:
            for place in self._definition(waiting.pop()).places():
                if place not in found:
                    found[place] = None
                    waiting.append(place)
        return list(found)

    # digests

    def _own_digest(self, place: Place) -> str:
        """Digest of bare code and the names used in it, without their modules."""
        found = self._definition(place)
        return digest_json([found.digest, [[[name for _, name in places], rest] for places, rest in found.links]])

    def _digest(self, members: list[Place]) -> None:
        """Digests of definitions that use one another in a circle, or of a single one.

        They are distinguished by what they use, as deep as it takes, so that no names and no order enter.
        """
        shades = {place: self._definition(place).digest for place in members}
        count = 0
        while len(set(shades.values())) > count:
            count = len(set(shades.values()))
            known = {**shades}
            shades = {place: self._shade(place, known) for place in members}
        alike = sorted(set(shades.values()))
        for place in members:
            circle = alike if len(members) > 1 else []
            self._digests[place] = digest_json([shades[place], circle])

    def _shade(self, place: Place, shades: Mapping[Place, str]) -> str:
        found = self._definition(place)
        used = [[[shades.get(one) or self._digests[one] for one in places], rest] for places, rest in found.links]
        return digest_json([shades[place], used])

    # from names to definitions

    def _definition(self, place: Place) -> _Definition:
        found = self._definitions.get(place)
        if found is None:
            found = self._definitions[place] = self._linked(*place)
        return found

    def _linked(self, module: str, name: str) -> _Definition:
        code = self._code(module)
        assert code is not None, "only modules that are there are linked"
        if name == _WHOLE:
            names = sorted([*code["definitions"], *code["imports"]])
            everything = [(module, one) for one in (*names, *[_STATEMENTS] * (code["statements"] is not None))]
            return _Definition(digest_json(names), tuple(self._resolve(target) for target in everything))
        digest, targets = code["statements"] if name == _STATEMENTS else code["definitions"][name]
        links = [self._resolve(tuple(target)) for target in targets]
        if name != _STATEMENTS and code["statements"] is not None:
            links.append((((module, _STATEMENTS),), ""))
        return _Definition(digest, tuple(links))

    def _resolve(self, target: tuple[str, ...]) -> tuple[tuple[Place, ...], str]:
        """The definitions that a module and names lead to, and the names that lead further."""
        found = self._resolved.get(target)
        if found is None:
            self._resolved[target] = ((), "in a circle")
            found = self._resolved[target] = self._followed(*target)
        return found

    def _followed(self, module: str, *names: str) -> tuple[tuple[Place, ...], str]:
        code = self._code(module)
        if code is None:
            return (), ".".join([module, *names])
        if not names:
            return ((module, _WHOLE),), ""
        first, rest = names[0], names[1:]
        if first in code["definitions"]:
            return ((module, first),), ".".join(rest)
        if first in code["bound"] or first == _STATEMENTS:
            return ((module, _STATEMENTS),), ".".join(names)
        if first in code["imports"]:
            return self._through(module, code, first, rest)
        if self._code(f"{module}.{first}") is not None:
            return self._resolve((f"{module}.{first}", *rest))
        return ((module, _WHOLE),), ".".join(names)

    def _through(
        self, module: str, code: dict[str, Any], name: str, rest: tuple[str, ...]
    ) -> tuple[tuple[Place, ...], str]:
        """Through the imports of a module, whose statements count then."""
        found = [self._resolve((*target, *rest)) for target in code["imports"][name]]
        places = [place for places, _ in found for place in places]
        if code["statements"] is not None:
            places.append((module, _STATEMENTS))
        return tuple(places), "|".join(rest for _, rest in found)

    # files

    def _code(self, module: str) -> dict[str, Any] | None:
        """What is in a module; None where there is no such source file, or none that Python could run."""
        if module not in self._codes:
            path, self._codes[module] = self._path(module), None
            with suppress(SyntaxError, ValueError):
                if path is not None:
                    read = partial(code_of, module=module)
                    self._codes[module] = self._index.fact(path, f"code {_FORM}:{module}", read)
        return self._codes[module]

    def _path(self, module: str) -> Path | None:
        if module not in self._paths:
            root = self._roots.get(module.partition(".")[0])
            base = root.joinpath(*module.split(".")) if root is not None else None
            files = [] if base is None else [base.with_suffix(".py"), base / "__init__.py"]
            self._paths[module] = next((file for file in files if file.is_file()), None)
        return self._paths[module]

    def _locate(self, cls: type) -> None:
        """Note where the package of a class is."""
        module = cls.__module__
        file = getattr(sys.modules.get(module), "__file__", None)
        if file is None:
            raise ConfigurationError(f"{cls.__qualname__}: its source is in no file; put the stage into a module")
        source = Path(file)
        self._paths[module] = source
        depth = module.count(".") + (source.name == "__init__.py")
        self._roots.setdefault(module.partition(".")[0], source.parents[depth])

    def _own(self, cls: type) -> tuple[tuple[Place, ...], str]:
        return self._resolve((cls.__module__, *cls.__qualname__.split(".")))

    def _named(self, name: str) -> tuple[tuple[Place, ...], str]:
        """What ``package.module:definition`` or ``package.module`` stands for, with nothing of it imported.

        A module without a source file counts by its name.
        """
        module, _, definition = name.partition(":")
        top = module.partition(".")[0]
        if top not in self._roots:
            spec = importlib.util.find_spec(top) if top else None
            places = [] if spec is None else spec.submodule_search_locations or [spec.origin or ""]
            self._roots.update((top, Path(place).parent) for place in places[:1])
        return self._resolve((module, *filter(None, definition.split("."))))
