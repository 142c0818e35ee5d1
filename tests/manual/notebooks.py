"""Notebooks of ``docs/notebooks``, run without Jupyter: cells in order, and what each of them shows."""

from __future__ import annotations

import ast
import base64
import io
import json
from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["NOTEBOOKS", "notebook_page"]

NOTEBOOKS = tuple(sorted((Path(__file__).parents[2] / "docs" / "notebooks").glob("*.ipynb")))


@cache
def notebook_page(notebook: Path) -> str:
    """Run a notebook and set it as a page: text, code, and what the code prints or shows."""
    import matplotlib

    matplotlib.use("Agg")
    names: dict[str, Any] = {"__name__": "__notebook__"}
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return "\n\n".join(part for cell in cells for part in _set_cell(cell, names)) + "\n"


def _set_cell(cell: dict[str, Any], names: dict[str, Any]) -> Iterator[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield source
        return
    yield f"```python\n{source}\n```"
    printed, shown = _run(source, names)
    if printed:
        yield f"```text\n{printed}```"
    if shown is not None:
        yield _rich(shown)


def _run(source: str, names: dict[str, Any]) -> tuple[str, Any]:
    """What a cell prints, and the value of its last expression."""
    body = ast.parse(source).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    stream = io.StringIO()
    with redirect_stdout(stream):
        exec(compile(ast.Module(body, []), "<cell>", "exec"), names)
        shown = None if last is None else eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
    return stream.getvalue(), shown


def _rich(shown: Any) -> str:
    """A value as HTML or Markdown."""
    if hasattr(shown, "savefig"):
        stream = io.BytesIO()
        shown.savefig(stream, format="png", dpi=100, bbox_inches="tight")
        return f'<img alt="the figure" src="data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}">'
    if hasattr(shown, "_repr_html_") and not hasattr(shown, "dims"):  # arrays bring styles that the manual's undo
        return "".join(line.strip() for line in shown._repr_html_().splitlines())
    return f"```text\n{shown!r}\n```"
