"""Text that a terminal of any encoding shows as it is, with any names in it."""

from __future__ import annotations

import codecs
import re
from typing import IO

__all__ = ["ascii_signs", "plain", "plain_line"]

_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # control characters, of which ESC begins a terminal's sequences
    "\xad\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"  # invisible, or turn the order
    "\ud800-\udfff"  # bytes of a file name that is not Unicode
    "\U000e0000-\U000e007f]"
)
_ERRORS = "dicflow.signs"
_SIGNS = {"→": "->", "←": "<-", "×": "x", "·": ".", "…": "...", "–": "-", "−": "-", "σ": "sigma", "ε": "e"}
_SIGNS |= {"²": "^2", "°": " deg", "µ": "u", "μ": "u", "γ": "gamma", "’": "'"}


def plain(text: object) -> str:
    """The text with control characters and those that change the order of reading as escapes ``\\u001b``.

    Line ends and tabs stay. In JSON the escapes stand for the same characters.
    """
    return _UNSAFE.sub(_escape, str(text))


def plain_line(text: object) -> str:
    """The same on one line."""
    return plain(text).replace("\n", "\\n").replace("\t", "\\t")


def ascii_signs(stream: IO[str] | None) -> None:
    """Let a stream show signs that its encoding lacks by others: ``->``, ``x``, and ``\\u4e2d`` for a letter."""
    reconfigure = getattr(stream, "reconfigure", None)
    if reconfigure is not None:
        codecs.register_error(_ERRORS, _replaced)
        reconfigure(errors=_ERRORS)


def _escape(match: re.Match[str]) -> str:
    units = match[0].encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[k]:02x}{units[k + 1]:02x}" for k in range(0, len(units), 2))


def _replaced(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    lacking = error.object[error.start : error.end]
    return "".join(_SIGNS.get(sign) or sign.encode("ascii", "backslashreplace").decode() for sign in lacking), error.end
