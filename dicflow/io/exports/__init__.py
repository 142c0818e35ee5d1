"""Products as files that other programs read, one module per format.

A module of this package, or an entry point of the group ``dicflow.exports``, is a format if it has

- ``DESCRIPTION``: what it is, in a few words;
- ``KINDS``: a tuple of the kinds of products that it can hold, None for any;
- ``write(items, folder, name)``: writes products, :class:`~dicflow.io.exports.items.Item`, into a folder of their own,
  one after the other;
- ``BESIDE``, if need be: kinds that an export of a whole test writes in this format beside the totals, which
  may have any format.
- ``ONE_STEP``, if need be: True where an export of a whole test has the points of one step alone; the items of the
  others are not ``whole``.

``DESCRIPTION``, ``BESIDE`` and ``ONE_STEP`` are literals: they are read from the source, without importing the module.
"""

from __future__ import annotations

from typing import Any

from dicflow.discovery import Registry
from dicflow.errors import ConfigurationError

__all__ = ["FORMATS", "beside", "descriptions", "has_one_step", "kinds_of"]

FORMATS = Registry("export format", __name__, "dicflow.exports", ("DESCRIPTION", "KINDS", "write"))
_UNREADABLE = "a plug-in that cannot be used, or whose DESCRIPTION is not one text"


def descriptions() -> dict[str, str]:
    """What each format is, by its name."""
    return {name: _read(name, "DESCRIPTION", _UNREADABLE) for name in FORMATS.names()}


def kinds_of(name: str) -> tuple[str, ...] | None:
    """The kinds of products that a format can hold, None for any. Raises ConfigurationError for an unusable format."""
    kinds = FORMATS.load(name).KINDS
    if kinds is not None and not isinstance(kinds, tuple):
        raise ConfigurationError(
            f"export format '{name}' of {FORMATS.find(name).place}: KINDS is {kinds!r}; write a tuple, such as "
            '("total",), or None for products of any kind'
        )
    return kinds


def beside() -> dict[str, tuple[str, ...]]:
    """Format → kinds of products that an export of a whole test writes in it beside the totals."""
    return {name: kinds for name in FORMATS.names() if (kinds := tuple(_read(name, "BESIDE", ())))}


def has_one_step(name: str) -> bool:
    """Whether an export of a whole test in this format has the points of one step alone."""
    return bool(_read(name, "ONE_STEP", False))


def _read(name: str, constant: str, default: Any) -> Any:
    """A constant of a format; the default for a plug-in that cannot be used, which is reported at its use."""
    try:
        return FORMATS.constant(name, constant, default)
    except ConfigurationError:
        return default
