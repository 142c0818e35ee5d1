"""A package of others, installed into a folder: its modules and the metadata with its entry points."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from small import ROOT


class Site:
    """A folder on ``sys.path``, and processes that see it.

    folder : made where it is missing
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def install(self, name: str, files: Mapping[str, str], entry_points: Mapping[str, Mapping[str, str]]) -> None:
        """Put a package of version 1.0 there.

        files : path below the folder → text
        entry_points : group → name → value
        """
        sections = (
            f"[{group}]\n" + "".join(f"{point} = {value}\n" for point, value in points.items())
            for group, points in entry_points.items()
        )
        metadata = self.folder / f"{name.replace('-', '_')}-1.0.dist-info"
        texts = {
            f"{metadata.name}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n",
            f"{metadata.name}/entry_points.txt": "\n".join(sections),
        }
        for path, text in {**files, **texts}.items():
            (self.folder / path).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / path).write_text(text, encoding="utf-8")

    def python(self, *arguments: Any) -> subprocess.CompletedProcess[str]:
        """Run Python in a process of its own that finds the packages of this folder."""
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(self.folder), str(ROOT)])}
        command = [sys.executable, *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, env=environment)

    def dicflow(self, *arguments: Any) -> str:
        """What the command line prints; it must succeed."""
        done = self.python("-m", "dicflow", *arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout
