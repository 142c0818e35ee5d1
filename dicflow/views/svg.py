"""Elements of drawings that stand inside a page, as text."""

from __future__ import annotations

from html import escape

__all__ = ["element", "text_element"]


def element(name: str, content: str = "", **attributes: str | float) -> str:
    """An element; numbers are rounded to a tenth, and ``_`` in the name of an attribute stands for ``-``."""
    written = "".join(f' {key.replace("_", "-")}="{_shown(value)}"' for key, value in attributes.items())
    return f"<{name}{written}>{content}</{name}>" if content else f"<{name}{written}/>"


def text_element(x: float, y: float, text: str, anchor: str = "", upwards: bool = False) -> str:
    """A line of text; none for an empty one.

    x, y : of the point on its base line that ``anchor`` names: start, middle or end, by default that of its group
    upwards : whether it is turned about this point, to be read from below
    """
    if not text:
        return ""
    given = {"text_anchor": anchor} if anchor else {}
    turned = {"transform": f"rotate(-90 {_shown(x)} {_shown(y)})"} if upwards else {}
    return element("text", escape(text), x=x, y=y, **given, **turned)


def _shown(value: str | float) -> str:
    return escape(value) if isinstance(value, str) else f"{value:.1f}".removesuffix(".0")
