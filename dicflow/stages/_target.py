"""The marks of a board in its plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dicflow.core.calibration.board import Board

if TYPE_CHECKING:
    from dicflow.core.calibration.targets import Target

__all__ = ["target_of"]


def target_of(board: Board, square_mm: float) -> Target:
    """The target of a board with squares, or rows of circles, of a size [mm]."""
    from dicflow.core.calibration.charuco import charuco_target
    from dicflow.core.calibration.circles import circle_target
    from dicflow.core.calibration.targets import checkerboard_target

    if board.target in ("circles", "asymmetric_circles"):
        return circle_target(board.size, square_mm, asymmetric=board.target == "asymmetric_circles")
    return (charuco_target if board.target == "charuco" else checkerboard_target)(board.size, square_mm)
