"""A whole experiment that is measured in seconds, and the command line as a function."""

from __future__ import annotations

import io
import json
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from dicflow.cli import main
from dicflow.synth import latex_experiment, write_experiment

ROOT = Path(__file__).resolve().parents[1]
BOARDS, STEPS = 8, 3
TASKS = 2 * BOARDS + 8 * STEPS + 5 * (STEPS - 1) + 4
"""Of the quick start: boards and corners, 8 stages per step, 5 per pair; rig, region, comparison and maps."""


class Answer(NamedTuple):
    """Output of a command, and its exit code."""

    code: int
    out: str
    err: str

    @property
    def line(self) -> dict[str, Any]:
        """The line that ``--json`` ends with."""
        return json.loads(self.out.splitlines()[-1])

    def refuses(self, code: int, *words: str) -> None:
        """Check that it ended with this code and one message that holds all these words, perhaps twice."""
        assert "Traceback" not in self.out + self.err
        assert self.code == code, self.err
        lines = {line.removeprefix("failed: ") for line in self.err.splitlines()}
        matching = [line for line in lines if all(word in line for word in words)]
        assert len(matching) == 1, self.err


def dicflow(*arguments: object) -> Answer:
    """Call the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    words = ["dicflow", *map(str, arguments)]
    with patch.object(sys, "argv", words), redirect_stdout(out), redirect_stderr(err):
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
    return Answer(code, out.getvalue(), err.getvalue())


def photograph_experiment(folder: Path) -> Path:
    """Photograph three steps of a strip, up to a stretch of 1.5, and eight boards.

    Returns the quick start's pipeline file beside the photographs, which draws one quantity only and keeps no
    photograph, however long it took to read.
    """
    experiment = latex_experiment(3, scale=0.3, steps=(0, 5, 8), boards=BOARDS)._replace(noise=1.0)
    write_experiment(folder, experiment)
    pipeline = folder / "quickstart.yaml"
    text = (ROOT / "pipelines" / "thesis_quickstart.yaml").read_text()
    assert "{stage: maps}" in text
    text = text.replace("{stage: maps}", "{stage: maps, quantities: [eyy]}")
    pipeline.write_text(text.replace('"photos/right/*.png"}', '"photos/right/*.png", keep: never}'))
    for path in folder.rglob("*"):
        os.utime(path, (1e9, 1e9))  # what is younger than two seconds may still change, and is looked at each time
    return pipeline
