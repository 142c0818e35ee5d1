"""Everything that may befall a store, many times: ``python -m tests.faults``, or ``make faults``.

In every case no wrong product is ever used, no traceback is shown, the next run ends well, and ``verify`` finds
every damage. The seeds are fixed, though not the moments of kills. A part of the whole is run by naming it:
``python -m tests.faults damage kills experiment limits``.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from tests.faults import damage, kills, limits
from tests.faults.tally import Tally, print_tallies


def _kills(folder: Path) -> Iterator[Tally]:
    yield kills.run_kills(_new(folder), 60)
    yield kills.group_kills(_new(folder), 20)
    yield kills.worker_kills(_new(folder), 20)
    yield kills.gc_kills(_new(folder), 40)
    yield kills.verify_kills(_new(folder), 30)


def _limits(folder: Path) -> Iterator[Tally]:
    yield limits.at_once(_new(folder), 3, 10.0)
    yield limits.full_disks(_new(folder), range(40, 400, 20))
    yield limits.read_only(_new(folder))


def _damages(folder: Path) -> Iterator[Tally]:
    yield from damage.flips(_new(folder), 40)
    yield damage.power_failures(_new(folder), 100)


PARTS: Mapping[str, Callable[[Path], Iterator[Tally]]] = {
    "damage": _damages,
    "kills": _kills,
    "experiment": lambda folder: kills.experiment_kills(_new(folder), 20),
    "limits": _limits,
}


def _new(folder: Path) -> Path:
    """A new folder in another one."""
    return Path(tempfile.mkdtemp(dir=folder))


def main(names: Sequence[str]) -> int:
    """Try the faults of the parts named, or of all; print the table and return the exit code."""
    tallies = []
    with tempfile.TemporaryDirectory() as folder:
        for name in names or PARTS:
            start = time.monotonic()
            for tally in PARTS[name](Path(folder)):
                tallies.append(tally)
                print(f"{time.monotonic() - start:6.0f} s  {tally.fault}: {tally.tried} tried", file=sys.stderr)
    return print_tallies(tallies)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
