"""Docstrings as Markdown: the entries of arguments as a list, names as code."""

from __future__ import annotations

import re

__all__ = ["with_entries"]

_ENTRY = re.compile(r"^(\w[\w, ]*) : ", re.MULTILINE)
_ROLE = re.compile(r":\w+:`~?([^`]+)`")


def with_entries(text: str) -> str:
    """A docstring as Markdown.

    >>> print(with_entries("Add.\\n\\na, b : numbers\\n    or texts\\nReturns the sum, see :func:`add`."))
    Add.
    <BLANKLINE>
    - **a, b**: numbers
      or texts
    <BLANKLINE>
    Returns the sum, see `add`.
    """
    found: list[str] = []
    for line in text.replace("::\n\n", "").splitlines():
        inside = bool(found) and found[-1].startswith(("- **", "  "))
        if _ENTRY.match(line):
            found += ([] if inside or not found or not found[-1] else [""]) + [_ENTRY.sub(r"- **\1**: ", line)]
        elif inside and line.startswith("    "):
            found.append(f"  {line.strip()}")
        else:
            found += ([""] if inside and line else []) + [line]
    return _ROLE.sub(r"`\1`", "\n".join(found)).replace("``", "`")
