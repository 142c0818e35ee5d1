"""The hook of MkDocs that adds generated pages and pictures to the manual."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from mkdocs.structure.files import File, Files

from dicflow.engine.kernel_cache import keep_kernels
from tests.manual.advice import advice_table
from tests.manual.commands import commands_page
from tests.manual.gallery import gallery_page
from tests.manual.messages import messages_page
from tests.manual.sizes import sizes_table
from tests.manual.stages import stage_pages

_FILL = re.compile(r"<!-- (\w+)(?:: (\w+))? -->")
"""Where a page asks for a generated part."""
_OVERVIEW = "reference/stages.md"

keep_kernels()


def on_config(config: Any) -> Any:
    """Put a page per stage below the reference."""
    (reference,) = (entry["Reference"] for entry in config.nav if "Reference" in entry)
    place = next(k for k, entry in enumerate(reference) if "Stages" in entry)
    reference[place] = {"Stages": [{"All stages": _OVERVIEW}, *(path for path in stage_pages() if path != _OVERVIEW)]}
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add generated pages and pictures."""
    gallery, pictures = gallery_page()
    pages: Mapping[str, str | bytes] = {
        **stage_pages(),
        "reference/commands.md": commands_page(),
        "reference/messages.md": messages_page(),
        "gallery.md": gallery,
        **pictures,
        **{name: data for subject in ("pattern", "light", "camera") for name, data in _advice(subject)[1].items()},
    }
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in generated parts of written pages."""
    return _FILL.sub(lambda found: _part(found[1], found[2]), markdown)


def _part(name: str, subject: str) -> str:
    return _advice(subject)[0] if name == "advice" else sizes_table()


@cache
def _advice(subject: str) -> tuple[str, dict[str, bytes]]:
    return advice_table(subject)
