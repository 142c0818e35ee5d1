"""Templates. Every value is escaped, unless it is Markup already."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import BytecodeCache, Environment, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup

from dicflow.engine.kernel_cache import account_folder
from dicflow.engine.whole_file import read_file, write_file
from dicflow.views.source_digest import source_digest

__all__ = ["assets", "render"]


def render(template: str, **values: Any) -> Markup:
    """A template of the folder ``templates`` with these values, as HTML. A missing value raises UndefinedError."""
    return Markup(_environment().get_template(template).render(values))


def assets(suffix: str) -> Markup:
    """All style sheets (``.css``) or scripts (``.js``) of the folder ``static``, in the order of their names."""
    files = [file for file in resources.files("dicflow.report").joinpath("static").iterdir()]
    chosen = sorted((file for file in files if file.name.endswith(suffix)), key=lambda file: file.name)
    return Markup("\n".join(file.read_text(encoding="utf-8") for file in chosen))


class KeptTemplates(BytecodeCache):
    """Compiled templates in a folder, which only this account may write, since they run as code.

    What is damaged, or was compiled by other code of dicflow, counts as missing.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def load_bytecode(self, bucket: Bucket) -> None:
        """Take the template from its file, if that is whole."""
        with suppress(OSError):
            kept = read_file(self._path(bucket))
            if kept.startswith(_digest(content := kept[hashlib.sha256().digest_size :])):
                bucket.bytecode_from_string(content)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep the template; a full disk is ignored, since it only saves time."""
        content = bucket.bytecode_to_string()
        with suppress(OSError):
            write_file(self._path(bucket), _digest(content) + content)

    def _path(self, bucket: Bucket) -> Path:
        return self._folder / f"template-{bucket.key}"


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(source_digest("views", "report").encode() + content).digest()


@cache
def _environment() -> Environment:
    folder = account_folder()
    return Environment(
        loader=PackageLoader("dicflow.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=None if folder is None else KeptTemplates(folder),
    )
