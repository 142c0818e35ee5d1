"""Figures of matplotlib as files."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import matplotlib
from matplotlib.figure import Figure

__all__ = ["saved"]

_STYLE: dict[Any, Any] = {"svg.hashsalt": "dicflow", "svg.fonttype": "none"}
_UNDATED: dict[str, dict[str, Any]] = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


def saved(figure: Figure, form: str) -> bytes:
    """A figure as "png", "pdf" or "svg" on white; equal figures give equal bytes."""
    buffer = BytesIO()
    with matplotlib.rc_context(_STYLE):
        figure.savefig(
            buffer, format=form, metadata=_UNDATED[form], bbox_inches="tight", pad_inches=0.1, facecolor="white"
        )
    return buffer.getvalue()
