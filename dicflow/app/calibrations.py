"""The calibration as a person judges it: errors of pairs, residuals on photographs, where boards are missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dicflow.app.drawing import photographs_of, stages_of
from dicflow.app.previews import Maker
from dicflow.app.project import Project
from dicflow.core.calibration.bundle import residuals
from dicflow.core.calibration.charuco import charuco_target
from dicflow.core.calibration.circles import circle_target
from dicflow.core.calibration.coverage import covered_area, empty_parts
from dicflow.core.calibration.poses import fitted_boards
from dicflow.core.calibration.targets import Target, checkerboard_target
from dicflow.engine.node import At
from dicflow.errors import ConfigurationError
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Pipeline
from dicflow.pipeline.rig_answer import rig_answer

__all__ = ["calibration_of"]

_DIGITS = 3
_SIDES = ("left", "right")


def calibration_of(project: Project, name: str, text: str) -> dict[str, Any]:
    """The rig of a pipeline file with a text that may not be saved; solved here where the store has it not.

    ``stage``, ``boards`` (the stage of the boards' photographs, None for a rig from a file), ``verdict``, ``summary``;
    ``pairs``: each with ``name``, ``used``, errors [px] or ``reason``, and for left and right the ``marks`` [px],
    their ``residuals``, reprojected minus observed [px], and ``gross``: which of them the stage has left out by itself;
    ``left_out``: the corners that the file leaves out; ``empty``: left and right → ninths of the frame where the board
    must still be shown; ``limit_px``: the error above which a pair is dropped; ``answer``: whether the photographs of
    the specimen still fit the rig, as a sentence, and whether they do, None before their points are computed;
    ``matches``: whether a stage computes them.
    Raises the error with which the stage would fail.
    """
    pipeline = project.candidate(name, text)
    graph = pipeline.graph
    names = pipeline.instances[0]
    rigs = [stage for stage, instance in names.items() if graph.stages[instance].node.gives == "rig"]
    if not rigs:
        raise ConfigurationError(
            "this pipeline has no calibration: it measures with one camera, in pixels; a stage 'scale' in the file "
            "gives millimetres (dicflow stages scale)"
        )
    stage = next((name for name in rigs if "corners" in graph.stages[names[name]].node.takes), rigs[-1])
    maker = Maker(graph, pipeline.plan("ignore"), pipeline.store)
    rig = CalibratedRig.read(maker.product(names[stage]))
    known: dict[str, Any] = {
        "stage": stage,
        "verdict": rig.verdict,
        "summary": dict(rig.summary),
        "answer": _answer(pipeline),
        "matches": bool(stages_of(pipeline, "stereo")),
        "refines": _refines(pipeline, stage),
    }
    spec = graph.stages[names[stage]]
    if "corners" not in spec.node.takes or spec.node.takes["corners"].at is not At.ALL:
        return {**known, "boards": None, "pairs": []}
    corners = spec.inputs["corners"]
    back = {instance: other for other, instance in names.items()}
    boards = [BoardMarks.read(maker.product(f"{corners}/{step}")) for step in graph.steps[corners]]
    node: Any = spec.node
    return {
        **known,
        "boards": back[graph.stages[corners].inputs["images"]],
        "limit_px": node.max_error_px,
        "left_out": node.leave_out,
        "pairs": _pairs(rig, boards, _target(boards[0], node.square)),
        "empty": _empty(rig, boards),
    }


def _answer(pipeline: Pipeline) -> dict[str, Any] | None:
    found = rig_answer(pipeline.result())
    return None if found is None else {"fits": found.fits, "sentence": found.sentence}


def _refines(pipeline: Pipeline, rig: str) -> dict[str, str] | None:
    """The stage that would refine a rig from the photographs of the specimen; None where there is one already."""
    regions = stages_of(pipeline, "region")
    if stages_of(pipeline, "refine") or not regions:
        return None
    return {"stage": "refine", "images": photographs_of(pipeline, regions[0]), "rig": rig}


def _target(marks: BoardMarks, square_mm: float) -> Target:
    board = marks.board
    if "circles" in board.target:
        return circle_target(board.size, square_mm, asymmetric=board.target == "asymmetric_circles")
    return (charuco_target if board.target == "charuco" else checkerboard_target)(board.size, square_mm)


def _pairs(rig: CalibratedRig, boards: Sequence[BoardMarks], target: Target) -> list[dict[str, Any]]:
    """The pairs in their order, with marks and residuals where both cameras see the board."""
    pairs = [dict(pair) for pair in rig.pairs]
    seen = [k for k, board in enumerate(boards) if all(len(board[side]) for side in _SIDES) and "left_px" in pairs[k]]
    if not seen:
        return pairs
    marks = {side: np.stack([boards[k][side] for k in seen]) for side in _SIDES}
    out = {side: np.stack([_at(marks[side][n], _out(pairs[k], side)) for n, k in enumerate(seen)]) for side in _SIDES}
    errors = _residuals(rig, target, marks, out, np.array([bool(pairs[k].get("turned")) for k in seen]))
    for number, k in enumerate(seen):
        for camera, side in enumerate(_SIDES):
            shown = np.isfinite(marks[side][number, :, 0])
            gross = _at(marks[side][number], [place[:2] for place in pairs[k].get("gross", {}).get(side, ())])
            pairs[k][side] = {
                "marks": marks[side][number][shown].round(_DIGITS).tolist(),
                "residuals": errors[number][camera][shown].round(_DIGITS).tolist(),
                "gross": gross[shown].tolist(),
            }
    return pairs


def _out(pair: Mapping[str, Any], side: str) -> list[Sequence[float]]:
    """Places [px] of the corners of a photograph that the rig was solved without."""
    return [place[:2] for key in ("left_out", "gross") for place in pair.get(key, {}).get(side, ())]


def _at(marks: np.ndarray, places: Sequence[Sequence[float]]) -> np.ndarray:
    """Which marks (m, 2) lie at some places [px]."""
    found = np.zeros(len(marks), dtype=bool)
    found[[int(np.nanargmin(np.hypot(*(marks - place).T))) for place in places]] = True
    return found


def _residuals(
    rig: CalibratedRig,
    target: Target,
    marks: Mapping[str, np.ndarray],
    out: Mapping[str, np.ndarray],
    turned: np.ndarray,
) -> list[np.ndarray]:
    """Residuals (2, m, 2) of each pair, left and right [px].

    marks : (n, m, 2) by side; out : (n, m), those that have no part in where the boards stood
    turned : pairs whose right marks were detected in the order of the board turned in its plane; of these orders the
        one that fits best counts
    """
    found: list[np.ndarray] = [np.full((2, *target.points[:, :2].shape), np.inf)] * len(turned)
    kept = {side: np.where(out[side][..., None], np.nan, marks[side]) for side in _SIDES}
    for number, order in enumerate(target.orders):
        chosen = np.flatnonzero(turned | (number == 0))
        boards = fitted_boards(rig.cameras, target.points, kept["left"][chosen], kept["right"][chosen][:, order])
        errors = residuals(boards, target.points, marks["left"][chosen], marks["right"][chosen][:, order])
        errors[:, 1] = errors[:, 1][:, np.argsort(order)]
        for k, error in zip(chosen, errors, strict=True):
            if np.nanmedian(np.abs(error)) < np.nanmedian(np.abs(found[k])):
                found[k] = error
    return found


def _empty(rig: CalibratedRig, boards: Sequence[BoardMarks]) -> dict[str, list[str]]:
    """Left and right → names of the ninths of the photographs that the boards of used pairs leave empty."""
    used = [board for board, pair in zip(boards, rig.pairs, strict=True) if pair["used"]]
    cameras = rig.cameras
    return {
        side: empty_parts(covered_area(np.stack([board[side] for board in used]), getattr(cameras, side).size))
        for side in _SIDES
        if used
    }
