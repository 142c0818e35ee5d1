"""The recommended settings in the pipeline's file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dicflow.core.strain.gauge_kernel import GaugeSetting
from dicflow.io.configuration import MAX_BYTES, parse
from dicflow.io.edited_yaml import Edit, edited
from dicflow.io.files import write_whole
from dicflow.io.text import read_text
from dicflow.pipeline.wiring import wire
from dicflow.tuning.stages import Tuned

__all__ = ["write_settings"]


def write_settings(path: Path, tuned: Tuned, setting: GaugeSetting) -> dict[str, Any]:
    """Write a setting to a pipeline's file; comments and all else stay. Returns the changed values.

    Raises ConfigurationError if the file cannot be edited; it is left untouched then.
    """
    present, source = tuned.values(tuned.present), str(path)
    changed = {name: value for name, value in tuned.values(setting).items() if value != present[name]}
    text = read_text(path, "a pipeline file", MAX_BYTES)
    new = edited(text, source, [Edit(("stages", *name.split(".")), value) for name, value in changed.items()])
    wire(parse(new, source))
    write_whole(path, new.encode())
    return changed
