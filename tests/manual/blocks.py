"""The blocks of code in the manual, and the checks of those that are not run."""

from __future__ import annotations

import re
import shlex
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import typer
import yaml

from dicflow.cli.commands import app
from dicflow.io.configuration import parse
from dicflow.pipeline.registry import node_class
from dicflow.pipeline.report_facts import report_facts
from dicflow.pipeline.wiring import wire

__all__ = ["Block", "blocks", "check_javascript", "check_shell", "check_yaml", "parse_command", "prose_commands"]

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_SECTIONS = ("dicflow", "title", "report", "sweep")
_OTHERS = {"docker", "pip", "pipx", "rattler-build", "ss", "uvx"}
"""Programs of others, whose lines are not checked."""
_ELLIPSIS = "..."


class Block(NamedTuple):
    """A fenced block of a page: its language, its text, and the line that it starts in."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def name(self) -> str:
        return f"{self.page.name}:{self.line}"


def blocks(language: str) -> list[Block]:
    """All blocks in a language."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in _BLOCK.finditer(text):
            if match[1] == language:
                found.append(Block(page, text.count("\n", 0, match.start()) + 1, language, match[2]))
    return found


def prose_commands() -> Iterator[tuple[str, str]]:
    """Page and text of each command line of dicflow that stands in backticks."""
    for page in PAGES:
        prose = _BLOCK.sub("", page.read_text(encoding="utf-8"))
        yield from ((page.name, found[1]) for found in re.finditer(r"`(dicflow(?: [^`\n]+)?)`", prose))


def check_yaml(block: Block) -> None:
    """Wire a whole pipeline; of a part, validate each stage and section. Raises ConfigurationError."""
    text = textwrap.dedent(block.text)
    whole = "dicflow: 1" in text and _ELLIPSIS not in map(str.strip, text.splitlines())
    if whole:
        wire(parse(text, block.name))
        return
    data = yaml.safe_load("\n".join(line for line in text.splitlines() if line.strip() != _ELLIPSIS))
    for name, entry in {**data, **data.get("stages", {})}.items():
        if name == "report":
            report_facts(parse(yaml.safe_dump({"dicflow": 1, "stages": {}, "report": entry}), block.name))
        elif name not in (*_SECTIONS, "stages"):
            _check_stage(name, entry)


def _check_stage(name: str, entry: dict[str, Any]) -> None:
    """Validate the parameters of a stage; what it takes is joined elsewhere."""
    assert "stage" in entry, name
    kind = node_class(entry["stage"])
    kind.model_validate({key: value for key, value in entry.items() if key not in kind.takes})


def check_shell(block: Block) -> None:
    """Parse the lines of dicflow; look up the targets of make and the modules of Python."""
    for line in block.text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        program = words[0].rpartition("/")[2] if words else ""
        if program == "dicflow":
            parse_command(words[1:])
        elif program == "make":
            _check_make(words[1:])
        elif program.startswith("python"):
            _check_module(words[1:])
        else:
            assert not words or program in _OTHERS, line


def parse_command(words: list[str]) -> None:
    """Parse a command line without doing it. Raises click's UsageError."""
    command: Any = typer.main.get_command(app)
    context = None
    while hasattr(command, "resolve_command"):
        context = command.make_context("dicflow", list(words), parent=context)
        if not words or words[0].startswith("--"):
            return
        _, command, words = command.resolve_command(context, list(words))
    command.make_context(command.name, list(words), parent=context)


def check_javascript(block: Block) -> None:
    """Look up the names that a block imports."""
    for names, module in re.findall(r'import \{ ([\w, ]+) \} from "\./(\w+\.js)"', block.text):
        text = (ROOT / "dicflow" / "explorer" / "static" / module).read_text(encoding="utf-8")
        for name in names.split(", "):
            assert re.search(rf"export (async )?(function|class|const) {name}\b", text), f"{module}: {name}"


def _check_make(words: list[str]) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert {word for word in words if "=" not in word} <= targets, words


def _check_module(words: list[str]) -> None:
    assert words[0] == "-m", words
    name = words[1]
    if name.startswith("tests"):
        place = ROOT / name.replace(".", "/")
        assert place.with_suffix(".py").is_file() or (place / "__main__.py").is_file(), name
    for file in (word for word in words[2:] if word.startswith("tests/")):
        assert (ROOT / file).exists(), file
