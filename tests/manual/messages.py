"""The register of messages: every error and warning that the source can print, by its section of troubleshooting."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from dicflow.views.topics import topic_of

__all__ = ["Message", "messages_page", "register", "sections"]

_ROOT = Path(__file__).parents[2]
_ERRORS = {
    *("ConfigurationError", "DamagedError", "DicflowError", "InputError", "NotKeptError", "StageError"),
    *("StoreError", "WorkerError", "Conflict", "Refused"),
}
_SHORTEST = 12
"""Characters of what counts as a message; shorter texts are parts of one."""
_NO_WARNINGS = {"cli.measure", "explorer.curves", "pipeline.warm", "report.reporting", "start.doctor"}
"""Modules whose generators yield no messages."""
_FEWEST_BLANKS = 4
"""Of a warning; shorter texts beside it are names."""


class Message(NamedTuple):
    """A message in the source; ``…`` stands for what is filled in."""

    topic: str
    module: str
    sort: str
    text: str


@cache
def register() -> tuple[Message, ...]:
    """All messages, by section, module and text."""
    files = sorted((_ROOT / "dicflow").rglob("*.py"))
    return tuple(sorted({message for file in files for message in _messages(file)}))


def sections() -> dict[str, str]:
    """Anchor → title of each section of the page on troubleshooting, as MkDocs makes them."""
    from markdown.extensions.toc import slugify

    lines = (_ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8").splitlines()
    titles = [line.removeprefix("## ") for line in lines if line.startswith("## ")]
    return {slugify(title, "-"): title for title in titles}


def messages_page() -> str:
    """The register as a page."""
    lines = [
        "# All messages",
        "",
        "Every error and warning in the source of dicflow, by the section of [troubleshooting](../troubleshooting.md)",
        "that deals with it. `…` stands for names and numbers.",
        "",
    ]
    for topic, title in sections().items():
        found = [message for message in register() if message.topic == topic]
        lines += [f"## {title}", "", f"[What to do](../troubleshooting.md#{topic})", ""] if found else []
        lines += [f"- {message.sort}: `{message.text}` ({message.module})" for message in found]
        lines += [""]
    return "\n".join(lines)


def _messages(file: Path) -> Iterator[Message]:
    module = ".".join(file.relative_to(_ROOT).with_suffix("").parts).removesuffix(".__init__")
    for sort, text in _texts(ast.parse(file.read_text(encoding="utf-8"))):
        words = " ".join(text.split()).replace("`", "'")
        name = module.removeprefix("dicflow.")
        if len(words.replace("…", "")) >= _SHORTEST and (sort == "error" or name not in _NO_WARNINGS):
            yield Message(topic_of(module), name, sort, words)


def _texts(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Sort and text of the messages in a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _name(node.func) in _ERRORS:
            parts = [": ".join(map(_template, node.args[:2])), *map(_template, node.args[2:])]
            yield "error", "; ".join(filter(None, parts))
        yield from (("warning", text) for value in _warning_values(node) for text in _sentences(value))


def _warning_values(node: ast.AST) -> Iterator[ast.AST]:
    """What holds texts of warnings: arguments, values and functions with that name, and what is yielded."""
    if isinstance(node, ast.Call) and _name(node.func) == "warn":
        yield from node.args
    elif isinstance(node, ast.keyword) and node.arg == "warnings":
        yield node.value
    elif isinstance(node, ast.Dict):
        named = zip(node.keys, node.values, strict=True)
        yield from (value for key, value in named if isinstance(key, ast.Constant) and key.value == "warnings")
    elif isinstance(node, ast.Assign) and any("warn" in ast.unparse(target) for target in node.targets):
        yield node.value
    elif isinstance(node, ast.FunctionDef):
        docstring = ast.get_docstring(node) or ""
        if "warn" in node.name or node.name == "left_out" or "warning" in docstring.partition("\n")[0]:
            yield from node.body[bool(docstring) :]
    elif isinstance(node, ast.Yield) and node.value is not None:
        yield node.value


def _name(node: ast.expr) -> str:
    return getattr(node, "attr", getattr(node, "id", ""))


def _sentences(node: ast.AST) -> Iterator[str]:
    """Texts below a node that are sentences, each once."""
    if isinstance(node, ast.JoinedStr | ast.Constant):
        text = _template(node)
        if text.count(" ") >= _FEWEST_BLANKS:
            yield text
        return
    for child in ast.iter_child_nodes(node):
        yield from _sentences(child)


def _template(node: ast.expr | ast.AST) -> str:
    """The text of an expression, with ``…`` for what is filled in."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(_template(part) if isinstance(part, ast.Constant) else "…" for part in node.values)
    if isinstance(node, ast.BinOp):
        return _template(node.left) + _template(node.right)
    return "…"
