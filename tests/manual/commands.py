"""The page of the commands, made from the command line itself."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import typer

from dicflow.cli.commands import app

__all__ = ["command_tree", "commands_page", "metavar_of"]


@cache
def command_tree() -> dict[str, Any]:
    """Full name of each command, as ``synth latex`` → the command."""
    root: Any = typer.main.get_command(app)
    found: dict[str, Any] = {}
    for name, command in root.commands.items():
        inner = getattr(command, "commands", None)
        found |= {name: command} if inner is None else {f"{name} {one}": part for one, part in inner.items()}
    return found


def commands_page() -> str:
    """Each command with its examples, arguments and options."""
    head = ["# Commands", "", "Made from the program itself, as `dicflow COMMAND --help` prints it.", ""]
    return "\n".join([*head, *(line for name, command in command_tree().items() for line in _command(name, command))])


def _command(name: str, command: Any) -> Iterator[str]:
    yield from (f"## {name}", "")
    for paragraph in (command.help or "").split("\n\n"):
        is_example = paragraph.startswith("\b")
        lines = [line.strip() for line in paragraph.strip("\b\n ").splitlines()]
        yield from ("```sh", *lines, "```", "") if is_example else (" ".join(lines), "")
    rows = [_row(parameter) for parameter in command.params if parameter.name != "help"]
    if rows:
        yield from ("| argument or option | default | |", "|---|---|---|", *rows, "")


def _row(parameter: Any) -> str:
    is_argument = parameter.param_type_name == "argument"
    names = [metavar_of(parameter)] if is_argument else parameter.opts
    default = parameter.default
    shown = "" if default is None or callable(default) or default in (False, [], (), "") else f"`{default}`"
    text = (parameter.help or "").replace("|", "\\|")
    return f"| {', '.join(f'`{name}`' for name in names)} | {'required' if parameter.required else shown} | {text} |"


def metavar_of(argument: Any) -> str:
    """How the help calls an argument."""
    return str(argument.metavar or argument.name.upper())
