"""Photographs that come into a folder: which ones are whole, and the steps that they make so far."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from dicflow.engine.file_stamps import file_facts
from dicflow.engine.files import FilePart, Stamp, stamp
from dicflow.engine.graph import StageSpec
from dicflow.engine.node import Steps
from dicflow.engine.store import Store
from dicflow.errors import InputError

__all__ = ["Arrivals"]

_QUIET_S = 0.2
"""A file that has not changed for so long is not being written, unless it cannot be read."""
_LATE_S = 5.0
"""So long a photograph waits for its partner before it is named."""

_File = Path | FilePart


class Arrivals:
    """Looks at the files of stages that start a series.

    A file is whole once it has rested for a moment and the stage can read it. What is not whole, has no partner or does
    not fit the others is in no step; of what rests but cannot be read or does not fit, :attr:`waiting` says why.

    waiting : file → what keeps it out of the steps, after each look
    replaced : files of steps that have just changed, so that nothing should read them
    alone : sentences about files that have been in no step for some seconds, while nothing changes
    resting : whether nothing has changed for so long that the last look holds until a file changes
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._seen: dict[Path, tuple[Stamp, float]] = {}
        self._whole: dict[Path, Stamp] = {}
        self._asked: set[Path] = set()
        self._fitting: dict[str, set[str]] = {}
        self._facts: dict[_File, tuple[Stamp, Any]] = {}
        self.waiting: dict[str, str] = {}
        self.replaced: list[Path] = []
        self.alone: list[str] = []
        self.resting = True

    def look(self, stages: Mapping[str, StageSpec]) -> dict[str, Steps]:
        """The steps so far of each stage that starts a series. Raises InputError where there can be none yet."""
        self.waiting, self.replaced, self.alone, self.resting, self._asked = {}, [], [], True, set()
        found = {name: self._steps(name, spec) for name, spec in stages.items()}
        self._whole = {path: known for path, known in self._whole.items() if path in self._asked}
        self._store.files.save()
        return found

    def stamps(self, found: Mapping[str, Steps]) -> dict[Path, Stamp]:
        """The files of some steps, each with its stamp when it became whole."""
        files = (Path(file) for steps in found.values() for own in steps.values() for file in own.values())
        return {path: self._whole[path] for path in files}

    def age(self, files: Iterable[_File]) -> float:
        """How long ago the last of some files took its present form [s]."""
        return time.monotonic() - max(self._seen[Path(file)][1] for file in files)

    def _steps(self, name: str, spec: StageSpec) -> Steps:
        steps = spec.node.steps_so_far(spec.folder, self._rests) or {}
        files = dict.fromkeys(file for own in steps.values() for file in own.values())
        if self.resting and not self._asked <= set(map(Path, files)):
            self.alone += spec.node.left_out(spec.folder, {**steps, "": self._recent()})
        new = [file for file in files if self._facts.get(file, (None,))[0] != self._whole[Path(file)]]
        with ThreadPoolExecutor() as threads:
            for file, found in zip(new, threads.map(partial(self._found_in, spec), new), strict=True):
                self._facts[file] = self._whole[Path(file)], found
        facts = {file: self._facts[file][1] for file in files}
        self.waiting |= {str(file): str(found) for file, found in facts.items() if isinstance(found, InputError)}
        facts = {file: found for file, found in facts.items() if not isinstance(found, InputError)}
        readable = {step: own for step, own in steps.items() if all(file in facts for file in own.values())}
        return self._agreeing(name, spec, readable, facts)

    def _rests(self, path: Path) -> bool:
        """Whether a file has not changed for a moment. One that is just replaced is the old one until it rests."""
        self._asked.add(path)
        try:
            now = stamp(path)
        except InputError:  # gone since its folder was listed
            self.resting = False
            return False
        known, since = self._seen.get(path, (None, 0.0))
        if known != now:
            self._seen[path] = now, time.monotonic()
            since = time.monotonic()
        if time.monotonic() - since < _QUIET_S:
            self.resting = False
            if path in self._whole:
                self.replaced.append(path)
            return path in self._whole
        self._whole[path] = now
        return True

    def _recent(self) -> dict[str, Path]:
        """Files that came so lately that their partners may be on the way."""
        oldest = time.monotonic() - _LATE_S
        return {str(path): path for path in self._asked if self._seen[path][1] > oldest}

    def _found_in(self, spec: StageSpec, file: _File) -> Any:
        """What the stage finds in a file, or the error of one that it cannot read, perhaps not yet."""
        try:
            return file_facts(self._store, spec.node, file)
        except InputError as error:
            return error

    def _agreeing(self, name: str, spec: StageSpec, steps: Steps, facts: Mapping[_File, Any]) -> Steps:
        """The steps whose files fit those of the last look, or else those before them."""
        agree = partial(_agree, spec, facts)
        if not steps or agree(list(steps), steps) is None:
            self._fitting[name] = set(steps)
            return steps
        known = [step for step in steps if step in self._fitting.get(name, ())]
        fitting = dict.fromkeys(known if known and agree(known, steps) is None else ())
        for step in [step for step in steps if step not in fitting]:
            problem = agree([*fitting, step], steps)
            if problem is None:
                fitting[step] = None
            else:
                self.waiting[str(next(iter(steps[step].values())))] = problem
        self._fitting[name] = set(fitting)
        return {step: files for step, files in steps.items() if step in fitting}


def _agree(spec: StageSpec, facts: Mapping[_File, Any], names: Sequence[str], steps: Steps) -> str | None:
    """What is wrong with some steps together; None if they fit."""
    chosen = {name: steps[name] for name in names}
    try:
        spec.node.agree({file: facts[file] for own in chosen.values() for file in own.values()}, chosen, {})
    except InputError as error:
        return str(error)
    return None
