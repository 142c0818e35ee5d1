"""The gallery: scripts of ``docs/gallery``, each run, with the picture that it makes."""

from __future__ import annotations

import ast
import io
import os
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["SCRIPTS", "gallery_page", "picture_of"]

_ROOT = Path(__file__).parents[2]
SCRIPTS = tuple(sorted((_ROOT / "docs" / "gallery").glob("*.py")))
_HEAD = """# Gallery

Each picture is made by the script below it while this page is built, from a pipeline of `pipelines/` and the
photographs of `data_samples`; the scripts run at the top of a clone.
"""


def gallery_page() -> tuple[str, dict[str, bytes]]:
    """The page, and its pictures: path below ``docs`` → PNG."""
    parts = [_HEAD]
    for script in SCRIPTS:
        text = script.read_text(encoding="utf-8")
        title, _, file = (ast.get_docstring(ast.parse(text)) or "").rpartition(": pipelines/")
        code = text.split('"""', 2)[2].strip()
        heading = title or file
        parts.append(f"## {heading}\n\n![{heading}](pictures/gallery_{script.stem}.png)\n\n```python\n{code}\n```\n")
    return "\n".join(parts), {f"pictures/gallery_{script.stem}.png": picture_of(script) for script in SCRIPTS}


@cache
def picture_of(script: Path) -> bytes:
    """What a script draws, as PNG; it leaves its picture as ``figure``."""
    import matplotlib
    import matplotlib.pyplot as plt

    matplotlib.use("Agg")
    names: dict[str, Any] = {"__name__": "__gallery__"}
    before = Path.cwd()
    os.chdir(_ROOT)
    try:
        exec(compile(script.read_text(encoding="utf-8"), str(script), "exec"), names)
    finally:
        os.chdir(before)
    stream = io.BytesIO()
    names["figure"].savefig(stream, format="png", dpi=100, bbox_inches="tight")
    plt.close("all")
    return stream.getvalue()
