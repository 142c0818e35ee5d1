"""The explorer as part of a page that needs no other file, and as a view in a notebook."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from functools import cache
from html import escape
from importlib import resources
from typing import Any

from dicflow.explorer.content import Keep
from dicflow.explorer.pack import Packed, packed_result
from dicflow.pipeline.result import Result

__all__ = ["NOTEBOOK_PAGE", "Explorer", "explorer_html", "fragment", "script", "style"]

_ENTRANCE = "view.js"
_IMPORT = re.compile(r'^import \{ [^}]* \} from "\./([\w.]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ", re.MULTILINE)
_START = """
for (const place of document.querySelectorAll(".explorer[data-source]")) {
  const data = (part) => JSON.parse(document.getElementById(`${place.dataset.source}-${part}`).textContent);
  mountExplorer(place, inlineSource(data("manifest"), data("blobs")));
}"""
_NEEDS_SCRIPT = """<noscript>
<p>The fields need JavaScript; <code>dicflow export --format png</code> writes them as pictures.</p>
</noscript>"""
NOTEBOOK_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<title>fields</title>
</head>
<body>{body}</body>
</html>"""


def explorer_html(result: Result, title: str, keep: Keep, budget_bytes: float = 8e6) -> str | None:
    """The explorer of a result as HTML with style and script inside; None if no step has fields.

    title : of the pipeline
    keep : keeps pieces from one page to the next
    budget_bytes : of its data; what had to be left out is said on the page
    """
    found = packed_result(result, title, keep, budget_bytes)
    return None if found is None else fragment(found)


def fragment(packed: Packed, key: str = "explorer") -> str:
    """The explorer of packed fields as HTML. key : of its elements, one per page"""
    blobs = {name: b64encode(blob).decode() for name, blob in packed.blobs.items()}
    return (
        f"<style>\n{style()}\n</style>\n"
        f'<div class="explorer" data-source="{escape(key)}">{_NEEDS_SCRIPT}</div>\n'
        f"{_data(f'{key}-manifest', packed.manifest)}{_data(f'{key}-blobs', blobs)}"
        f"<script>\n{script()}\n</script>\n"
    )


class Explorer:
    """The explorer of a result, which a notebook shows. ``html`` is a page that stands alone."""

    def __init__(self, result: Result, budget_bytes: float = 30e6) -> None:
        made = explorer_html(result, "", lambda _sources, make: make(), budget_bytes)
        self.html = NOTEBOOK_PAGE.replace("{body}", made or "<p>No step has a value yet.</p>")

    def _repr_html_(self) -> str:
        return (
            '<iframe title="fields" style="width:100%;height:860px;border:0" allow="fullscreen" '
            'sandbox="allow-scripts allow-downloads" '
            f'srcdoc="{escape(self.html)}"></iframe>'
        )


@cache
def style() -> str:
    """The style sheet."""
    return _text("explorer.css")


@cache
def script() -> str:
    """All modules as one script, which starts each explorer of the page."""
    modules = "\n".join(_EXPORT.sub("", _IMPORT.sub("", _text(name))) for name in _in_order(_ENTRANCE))
    return f'(() => {{\n"use strict";\n{modules}\n{_START}\n}})();'


def _in_order(name: str, before: tuple[str, ...] = ()) -> list[str]:
    """A module behind all that it imports."""
    found: list[str] = list(before)
    for other in _IMPORT.findall(_text(name)):
        found += [one for one in _in_order(other, tuple(found))[len(found) :] if one not in found]
    return found if name in found else [*found, name]


@cache
def _text(name: str) -> str:
    return resources.files("dicflow.explorer").joinpath("static", name).read_text(encoding="utf-8")


def _data(key: str, content: Any) -> str:
    """Data for the script, escaped so that no text can close the element around it."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" id="{escape(key)}">{text}</script>\n'
