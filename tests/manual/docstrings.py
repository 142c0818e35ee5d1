"""The extension by which mkdocstrings reads docstrings."""

from __future__ import annotations

from typing import Any

import griffe

from tests.manual.entries import with_entries

__all__ = ["Entries"]


class Entries(griffe.Extension):
    """Gives every docstring that is shown this form."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = with_entries(obj.docstring.value)
