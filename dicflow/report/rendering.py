"""Templates. Every value is escaped, unless it is Markup already."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

__all__ = ["assets", "render"]


def render(template: str, **values: Any) -> Markup:
    """A template of the folder ``templates`` with these values, as HTML. A missing value raises UndefinedError."""
    return Markup(_environment().get_template(template).render(values))


def assets(suffix: str) -> Markup:
    """All style sheets (``.css``) or scripts (``.js``) of the folder ``static``, in the order of their names."""
    files = [file for file in resources.files("dicflow.report").joinpath("static").iterdir()]
    chosen = sorted((file for file in files if file.name.endswith(suffix)), key=lambda file: file.name)
    return Markup("\n".join(file.read_text(encoding="utf-8") for file in chosen))


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("dicflow.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
