"""Marks of the calibration target in one pair of photographs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.core.calibration.board import Board
from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind, Layout, laid_out

if TYPE_CHECKING:
    import numpy as np

__all__ = ["BoardMarks"]

Size = tuple[int, int]

_LAYOUTS = {side: Layout(("corner", "component"), "px", f"{side} corners") for side in ("left", "right")}


class BoardMarks(Kind):
    """Corners of a board's squares, or centres of its circles, in the photographs of one or two cameras."""

    KINDS: ClassVar = ("corners",)

    @classmethod
    def write(
        cls,
        marks: Mapping[str, np.ndarray],
        shown: Mapping[str, Board | None],
        board: Board,
        image_sizes: Mapping[str, Size],
        reasons: Mapping[str, str] | None = None,
    ) -> Product:
        """A product of marks.

        marks : left and right → (n, 2) — empty where the board is not found, NaN for a hidden corner [px]
        shown : left and right → the board that the photograph shows; None if it shows no board that is recognised
        board : the expected one
        image_sizes : left and right → width and height of the photograph [px]
        reasons : left and right → why the board is not found; "" or absent where it is
        """
        attrs = {
            "board": _to_json(board),
            "image_sizes": {side: list(size) for side, size in image_sizes.items()},
            "found": {side: len(xy) > 0 for side, xy in marks.items()},
            "shown": {side: None if other is None else _to_json(other) for side, other in shown.items()},
            "reasons": {side: text for side, text in (reasons or {}).items() if text},
        }
        return Product("corners", laid_out(_LAYOUTS, marks), attrs)

    def is_found(self, side: str) -> bool:
        """Whether one camera saw the board."""
        return bool(self.product.attrs["found"][side])

    @property
    def is_found_by_both(self) -> bool:
        """Whether all cameras saw the board."""
        return all(self.product.attrs["found"].values())

    @property
    def others(self) -> Mapping[str, Board]:
        """left and right → another board that the photograph shows in place of the expected one."""
        shown = {side: _from_json(other) for side, other in self.product.attrs["shown"].items() if other is not None}
        return {side: other for side, other in shown.items() if not self.is_found(side) and other != self.board}

    @property
    def reason(self) -> str:
        """Why a photograph has no marks; "" if all have."""
        return "; ".join(f"{side}: {text}" for side, text in self.product.attrs["reasons"].items())

    @property
    def board(self) -> Board:
        """The expected board."""
        return _from_json(self.product.attrs["board"])

    @property
    def image_sizes(self) -> Mapping[str, Size]:
        """left and right → width and height of the photograph [px]."""
        return {side: (size[0], size[1]) for side, size in self.product.attrs["image_sizes"].items()}


def _to_json(board: Board) -> dict[str, Any]:
    return {**board._asdict(), "size": list(board.size)}


def _from_json(values: Mapping[str, Any]) -> Board:
    columns, rows = values["size"]
    return Board(values["target"], (columns, rows), values["dictionary"], values["marker"])
