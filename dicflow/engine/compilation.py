"""Code that is compiled before the first task of a stage, piece by piece, while other stages' tasks go on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

__all__ = ["Compilation", "Pieces", "Uncompiled"]

Pieces = Mapping[str, Mapping[str, Callable[[], None]]]
"""Stage → name of each piece of code that it needs → function of a module that compiles it, early stages first."""


def _always() -> bool:
    return True


def _ignore(*_: object) -> None:
    pass


@dataclass(frozen=True)
class Compilation:
    """What is to compile, and who listens.

    pieces : several stages may share one; it is compiled once, for the first of them
    is_wanted : whether to go on with the next piece
    began, ended : called with a stage, and with the processor time that a piece took [s], in the thread of the run
    """

    pieces: Pieces = field(default_factory=dict)
    is_wanted: Callable[[], bool] = _always
    began: Callable[[str], None] = _ignore
    ended: Callable[[str, float], None] = _ignore


class Uncompiled:
    """Pieces in the order in which they are compiled, and the stages that wait for them: ``stage in uncompiled``."""

    def __init__(self, pieces: Pieces) -> None:
        self._waiting = {stage: set(calls) for stage, calls in pieces.items() if calls}
        self._left: dict[str, tuple[str, Callable[[], None]]] = {}
        for stage, calls in pieces.items():
            for piece, call in calls.items():
                self._left.setdefault(piece, (stage, call))

    def __contains__(self, stage: object) -> bool:
        return stage in self._waiting

    def take(self, stage: str | None = None) -> tuple[str, str, Callable[[], None]] | None:
        """Name, stage and call of the next piece, of a stage or of any; None where none is left."""
        wanted = self._left if stage is None else self._waiting.get(stage, ())
        piece = next((piece for piece in self._left if piece in wanted), None)
        return None if piece is None else (piece, *self._left.pop(piece))

    def done(self, piece: str) -> list[str]:
        """Note that a piece is compiled; returns the stages that waited for it alone."""
        for pieces in self._waiting.values():
            pieces.discard(piece)
        return self._without_pieces()

    def give_up(self) -> list[str]:
        """Leave out what is not begun; returns the stages that wait for nothing then."""
        for pieces in self._waiting.values():
            pieces.difference_update(self._left)
        self._left.clear()
        return self._without_pieces()

    def _without_pieces(self) -> list[str]:
        free = [stage for stage, pieces in self._waiting.items() if not pieces]
        for stage in free:
            del self._waiting[stage]
        return free
