"""The table of faults: how often each was tried, and what went wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from dicflow.errors import DicflowError

__all__ = ["Tally", "print_tallies"]

Wrong = Literal["wrong product", "traceback", "ends badly", "not found"]
_COLUMNS: tuple[Wrong, ...] = ("wrong product", "traceback", "ends badly", "not found")


@dataclass
class Tally:
    """One kind of fault.

    wrong : what went wrong, with its number; notes : the first few as text
    """

    fault: str
    tried: int = 0
    wrong: Counter[Wrong] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def add(self, wrong: Wrong, note: str) -> None:
        """Count something that went wrong."""
        self.wrong[wrong] += 1
        self.notes.append(f"{self.fault} {self.tried}: {wrong}: {note[:2000]}")

    def attempt(self, act: Callable[[], Sequence[str]], wrong: Wrong, note: str = "") -> None:
        """Do something that must return nothing wrong; a message for the user counts as a bad end."""
        try:
            found = act()
        except DicflowError as error:
            self.add("ends badly", f"{note} {error}")
        except Exception as error:
            self.add("traceback", f"{note} {error!r}")
        else:
            for one in found:
                self.add(wrong, f"{note} {one}")

    @property
    def ok(self) -> bool:
        """Whether it was tried and nothing went wrong."""
        return self.tried > 0 and not self.wrong


def print_tallies(tallies: Sequence[Tally]) -> int:
    """Print the table; returns the exit code."""
    width = max(len(tally.fault) for tally in tallies)
    print(f"{'fault':<{width}}  {'tried':>6}  " + "  ".join(f"{name:>13}" for name in _COLUMNS))
    for tally in tallies:
        counts = "  ".join(f"{tally.wrong[name]:>13}" for name in _COLUMNS)
        print(f"{tally.fault:<{width}}  {tally.tried:>6}  {counts}  {'ok' if tally.ok else 'FAILED'}")
    for note in [note for tally in tallies for note in tally.notes[:3]]:
        print(note)
    return int(not all(tally.ok for tally in tallies))
