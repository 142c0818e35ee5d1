"""Numbers of logs: with a decimal point or comma, with or without separators of thousands.

One log has one way of writing numbers. It is found from all of its cells: a number with both signs shows which is the
decimal one, and so does one in which a sign cannot part thousands (``59,95``, ``0,004``), or stands twice
(``1.234.567``). A point alone is decimal. Commas alone that could all part thousands (``1,234``) are refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import NamedTuple

__all__ = ["MISSING", "NUMBER", "NumberStyle", "number_and_unit", "style_of"]

MISSING = re.compile(r"|-+|n/?a|#n/a|[+-]?nan|none|null|ol|of|over(?:load|flow)?|inv(?:alid)?|err(?:or)?|[*?]+", re.I)
"""Words that stand for a value that was not measured."""
NUMBER = re.compile(
    r"(?P<number>[-+\u2212]?\s*"
    r"(?:\d[\d.,]*+(?:[ '\u2019\u00a0\u202f]\d{3}(?!\d)[\d.,]*+)*+|[.,]\d++)(?:[eE][-+]?\d{1,3})?)"
    r"\s*(?P<unit>[^\d\s.,;:+\-][^\d\s;:]{0,7})?\s*"
)
"""A number of any style, and perhaps a unit behind it."""
_SPACES = re.compile(r"[ '\u2019\u00a0\u202f]")
_GROUPS = {sign: re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:\{sign}\d{{3}})+") for sign in ".,"}
_PLAIN = re.compile(r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?", re.ASCII)


class NumberStyle(NamedTuple):
    """decimal : the sign before decimals; the other of point and comma parts thousands."""

    decimal: str = "."

    def read(self, text: str) -> float | None:
        """The number; None for text that is none in this style."""
        plain = _bare(text)
        head, mark, tail = plain.rpartition(self.decimal)
        whole = head if mark else tail
        other = "," if self.decimal == "." else "."
        if other in whole:
            if not _GROUPS[other].fullmatch(whole):
                return None
            whole = whole.replace(other, "")
        number = f"{whole}.{tail}" if mark else whole
        if not _PLAIN.fullmatch(number):
            return None
        value = float(number)
        return value if math.isfinite(value) else None


def number_and_unit(cell: str) -> tuple[str, str] | None:
    """The number in a cell, as text, and the unit behind it, which may be empty; None for other text."""
    match = NUMBER.fullmatch(cell.strip())
    return (match["number"], match["unit"] or "") if match else None


def style_of(numbers: Iterable[tuple[str, str]]) -> NumberStyle | tuple[str, str]:
    """How the numbers of a log are written, or where and what is unclear in them.

    numbers : ``file:line`` and text of each number

    >>> style_of([("", "1.234,5"), ("", "2")])
    NumberStyle(decimal=',')
    """
    proofs: dict[str, tuple[str, str]] = {}
    unclear: tuple[str, str] | None = None
    for where, text in numbers:
        if "," not in text and "." not in text:
            continue
        decimal = _decimal_sign(_bare(text))
        if decimal:
            proofs.setdefault(decimal, (where, text))
        elif "," in text:
            unclear = unclear or (where, text)
    if "," in proofs:
        return proofs["."] if "." in proofs else NumberStyle(",")
    if unclear and "." not in proofs:
        return unclear
    return NumberStyle(".")


def _bare(text: str) -> str:
    return _SPACES.sub("", text.strip()).replace("\u2212", "-")


def _decimal_sign(number: str) -> str:
    """Which sign must be the decimal one; empty if that is open, as in ``1,234`` and ``1.234``."""
    if "," in number and "." in number:
        return "," if number.rindex(",") > number.rindex(".") else "."
    sign = "," if "," in number else "."
    if number.count(sign) > 1:
        return "." if sign == "," else ","
    return "" if _GROUPS[sign].fullmatch(number) else sign
