"""Section: how good the calibration is."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from dicflow.core.threads import at_once
from dicflow.engine.product import Product
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Result
from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.report.words import number, percent

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Camera, Rig
    from dicflow.report.drawing import Drawing, Shape

__all__ = ["PLACE", "TITLE", "calibrated_stage", "calibration"]

PLACE = 10
TITLE = "Calibration"

_FIGURES = (
    ("focal length of the left camera, x", "left_fx_px", "px"),
    ("focal length of the left camera, y", "left_fy_px", "px"),
    ("focal length of the right camera, x", "right_fx_px", "px"),
    ("focal length of the right camera, y", "right_fy_px", "px"),
    ("baseline", "baseline_mm", "mm"),
    ("angle between the cameras", "angle_deg", "°"),
)
_SIDES = ("left", "right")
_PAIR_PX = 480
_LINES = 10
_MOST_CORNERS = 4000


def calibration(context: Context) -> Section | None:
    """The section, None for a pipeline without a rig."""
    result = context.result
    rigs = result.stages_of("rig")
    if not rigs:
        return None
    stage = rigs[-1]
    if not result.has(stage):
        return Section("calibration", TITLE, Markup("<p>The cameras are not calibrated yet.</p>"))
    calibrated = calibrated_stage(context, stage)
    rig, used = (CalibratedRig.read(result.product(name)) for name in (calibrated, stage))
    limit: float | None = getattr(_node(context, calibrated), "max_error_px", None)
    body = render(
        "calibration.html",
        verdict=rig.verdict,
        refined="" if calibrated == stage else used.verdict,
        facts=_facts(rig, used.summary, getattr(_node(context, calibrated), "square", None)),
        pairs=_pairs(rig.pairs),
        limit=limit,
        figures=_figures(used.summary),
        drawings=_drawings(context, calibrated),
        rectified=_rectified(context, stage),
    )
    shown = {calibrated: rig, stage: used}
    warnings = tuple(warning for one in shown.values() for warning in _warnings(one))
    return Section("calibration", TITLE, body, warnings, tuple(context.pipeline.instances[0][name] for name in shown))


def calibrated_stage(context: Context, stage: str) -> str:
    """The stage of the rig as it was calibrated, before it was refined."""
    while "rig" in _node(context, stage).takes:
        stage = context.result.source(stage, "rig")
    return stage


def _node(context: Context, stage: str) -> Any:
    return context.result.graph.stages[context.pipeline.instances[0][stage]].node


def _warnings(rig: CalibratedRig) -> tuple[str, ...]:
    doubtful = [f"The calibration is {rig.verdict}."] if rig.is_doubtful else []
    return (*doubtful, *(f"Calibration: {one}." for one in rig.warnings if one != f"the calibration is {rig.verdict}"))


def _facts(rig: CalibratedRig, used: Mapping[str, float], square_mm: float | None) -> list[tuple[str, str, str]]:
    """Name, value and remark of the key figures.

    rig : as calibrated; used : figures of the rig that the other stages take
    """
    found = rig.summary
    facts = [
        ("Baseline", f"{number(used['baseline_mm'], 5)} mm", _more_or_less(used, "baseline_mm", "mm")),
        ("Angle", f"{number(used['angle_deg'])}°", _more_or_less(used, "angle_deg", "°")),
    ]
    if "apparent_turn_deg" in used:
        before = (
            f"before {number(used['distance_before_px'], 2)} px, as after a turn by {used['apparent_turn_deg']:.2g}°"
        )
        facts.append(("Points off their epipolar lines", f"{number(used['distance_px'], 2)} px", before))
    if "rms_px" not in found:
        return facts
    sides = f"left {number(found['left_rms_px'], 2)} px, right {number(found['right_rms_px'], 2)} px"
    facts.insert(0, ("Reprojection error (RMS)", f"{number(found['rms_px'], 2)} px", sides))
    epipolar = f"{number(found['epipolar_px'], 2)} px"
    facts.insert(1, ("Epipolar error (mean)", epipolar, "distance of a corner from the line of its partner"))
    facts.append(("Pairs used", f"{found['pairs_used']} of {len(rig.pairs)}", ""))
    covered = rig.coverage
    frames = f"{percent(covered['left'])} · {percent(covered['right'])}"
    facts.append(("Frame covered by boards", frames, "left · right camera"))
    if "square_mm" in found:
        off = f"{number(found['square_error_pct'], 2)} % off {square_mm:g} mm" if square_mm else ""
        facts.append(("Square in pairs left out", f"{number(found['square_mm'], 5)} mm", off))
    return facts


def _more_or_less(found: Mapping[str, float], name: str, unit: str) -> str:
    key = f"sigma_{name}"
    return f"σ {number(found[key], 2)} {unit}".replace(" °", "°") if key in found else ""


def _figures(found: Mapping[str, float]) -> list[list[str]]:
    """Rows: name, value, σ, and how much it changes as pairs are left out."""
    return [
        [
            f"{title} [{unit}]",
            number(found[key], 6),
            number(found[f"sigma_{key}"], 2),
            number(found[f"spread_{key}"], 2) if f"spread_{key}" in found else "",
        ]
        for title, key, unit in _FIGURES
        if f"sigma_{key}" in found
    ]


def _pairs(pairs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One row per pair: its errors, the lengths of their bars, and whether it was used."""
    longest = max((pair[f"{side}_px"] for pair in pairs for side in _SIDES if "left_px" in pair), default=0.0) or 1.0
    return [
        {
            "name": pair["name"],
            "used": pair["used"],
            "bars": [(side, 100 * pair[f"{side}_px"] / longest) for side in _SIDES if "left_px" in pair],
            "errors": [number(pair.get(key), 2) for key in ("left_px", "right_px", "epipolar_px")],
            "fate": "" if pair["used"] else "dropped" if "left_px" in pair else pair["reason"],
        }
        for pair in pairs
    ]


def _drawings(context: Context, stage: str) -> list[Any]:
    """The corners in the frames, and the cameras with the boards from above and from the side."""
    result = context.result
    boards = result.source(stage, "corners") if CalibratedRig.read(result.product(stage)).pairs else None
    steps = [step for step in result.steps(boards) if result.has(boards, step)] if boards is not None else []
    sources = ["cameras and boards", result.digest(stage), *(result.digest(str(boards), step) for step in steps)]
    square = getattr(_node(context, stage), "square", 1.0)

    def make() -> bytes:
        corners = {step: BoardMarks.read(result.product(str(boards), step)) for step in steps}
        return json.dumps(_drawn(CalibratedRig.read(result.product(stage)), corners, square)).encode()

    found: list[Any] = json.loads(context.pieces.get([*sources, str(square)], make))
    return found


def _drawn(calibrated: CalibratedRig, corners: Mapping[str, BoardMarks], square_mm: float) -> list[Drawing]:
    rig = calibrated.cameras
    used = {pair["name"]: pair["used"] for pair in calibrated.pairs}
    measured = {pair["name"] for pair in calibrated.pairs if "left_px" in pair}
    seen = {name: board for name, board in corners.items() if name in measured}
    marks = {side: {name: board[side] - calibrated.offset(side) for name, board in seen.items()} for side in _SIDES}
    coverage = [_coverage(side, getattr(rig, side), marks[side], used) for side in _SIDES] if seen else []
    outlines = {name: _outline(_board(board, square_mm), marks["left"][name], rig.left) for name, board in seen.items()}
    return [*coverage, *_views(rig, outlines, used)]


def _coverage(side: str, camera: Camera, marks: Mapping[str, np.ndarray], used: Mapping[str, bool]) -> Drawing:
    """Places of the corners of all pairs in the frame of one camera."""
    import numpy as np

    from dicflow.report.drawing import Shape, drawing

    seen = {name: xy[np.isfinite(xy[:, 0])] for name, xy in marks.items()}
    stride = 1 + sum(map(len, seen.values())) // _MOST_CORNERS
    shapes = [Shape(_kind("dots", used, name), name, xy[::stride], False) for name, xy in seen.items()]
    width, height = camera.size
    return drawing(f"Corners, {side} camera", ("x [px]", "y [px]"), (0, 0, width, height), shapes)


def _outline(board: np.ndarray, marks: np.ndarray, camera: Camera) -> np.ndarray:
    """The corners of a board's outline (4, 3) in the left camera's frame [mm], from its left photograph alone.

    board : (m, 3) — its marks [mm]; marks : (m, 2) [px], NaN where not seen
    """
    import cv2
    import numpy as np

    seen = np.isfinite(marks[:, 0])
    _found, turn, place = cv2.solvePnP(board[seen], marks[seen], camera.matrix, camera.distortion)
    (x0, y0, _), (x1, y1, _) = board.min(axis=0), board.max(axis=0)
    outline = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
    return np.asarray(outline @ cv2.Rodrigues(turn)[0].T + place.T)


def _board(corners: BoardMarks, square_mm: float) -> np.ndarray:
    """Places of the marks on a board [mm]."""
    from dicflow.core.calibration.circles import circle_target
    from dicflow.core.calibration.targets import board_points

    target, (columns, rows), *_markers = corners.board
    if target in ("circles", "asymmetric_circles"):
        return circle_target((columns, rows), square_mm, asymmetric=target == "asymmetric_circles").points
    return board_points((columns, rows), square_mm)


def _views(rig: Rig, outlines: Mapping[str, np.ndarray], used: Mapping[str, bool]) -> list[Drawing]:
    """Both cameras and the boards in the left camera's frame, from above and from the side."""
    import numpy as np

    from dicflow.report.drawing import Shape, drawing

    far = np.median([outline[:, 2].mean() for outline in outlines.values()]) if outlines else 0.0
    depth = max(0.15 * float(far), 0.3 * float(np.linalg.norm(rig.translation)))
    solids = [(_kind("board", used, name), name, outline) for name, outline in outlines.items()]
    for side, turn, shift in (("left", np.eye(3), np.zeros(3)), ("right", rig.rotation, rig.translation)):
        solids += [
            (f"camera {side}", f"{side} camera", part) for part in _pyramid(getattr(rig, side), depth, turn, shift)
        ]
    everything = np.concatenate([points for *_rest, points in solids])
    margin = 0.05 * float(np.ptp(everything, axis=0).max())
    low, high = everything.min(axis=0) - margin, everything.max(axis=0) + margin

    def seen(title: str, axes: list[int], upwards: bool) -> Drawing:
        shapes: list[Shape] = [Shape(kind, name, points[:, axes]) for kind, name, points in solids]
        labels = ("XYZ"[axes[0]] + " [mm]", "XYZ"[axes[1]] + " [mm]")
        return drawing(title, labels, (*low[axes].tolist(), *high[axes].tolist()), shapes, upwards)

    return [seen("From above", [0, 2], True), seen("From the side", [2, 1], False)]


def _kind(shape: str, used: Mapping[str, bool], name: str) -> str:
    return shape if used.get(name) else f"{shape} dropped"


def _pyramid(camera: Camera, depth: float, turn: np.ndarray, shift: np.ndarray) -> list[np.ndarray]:
    """The field of view of a camera down to a depth [mm], as the five faces of a pyramid in the left camera's frame."""
    import numpy as np

    width, height = camera.size
    pixels = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]], dtype=float)
    base = (depth * pixels @ np.linalg.inv(camera.matrix).T - shift) @ turn
    top = -shift @ turn
    return [base, *(np.stack([top, base[k], base[(k + 1) % 4]]) for k in range(4))]


def _rectified(context: Context, stage: str) -> dict[str, Any] | None:
    """Both photographs of the first step with common rows; None without photographs."""
    result = context.result
    photographs = _photographs(result)
    if photographs is None or not result.has(photographs, 0):
        return None
    product = result.product(photographs, 0)
    if "right" not in product:
        return None
    sources = ["row-aligned pair", result.digest(stage), result.digest(photographs, 0)]
    found: dict[str, Any] = json.loads(
        context.pieces.get(sources, lambda: _pair(result.product(stage), product, context.workers))
    )
    return found


def _photographs(result: Result) -> str | None:
    """The photographs of the specimen, as the cameras took them."""
    for stage in result.stages_of("region"):
        images = result.source(stage, "images")
        return images if result.kind(images) == "images" else result.source(images, "images")
    return None


def _pair(rig_product: Product, images: Product, threads: int) -> bytes:
    """Both photographs with common rows, shrunk, and where lines are drawn across them."""
    from dicflow.core.cameras.rectification import rectification, rectify
    from dicflow.views.crops import crop_around, photo_jpeg

    rig = CalibratedRig.read(rig_product).cameras
    aligned = rectification(rig)
    part = crop_around([], aligned.size, _PAIR_PX)
    rough, size = partial(rectify, is_rough=True), aligned.size
    left = partial(rough, images["left"], rig.left, aligned.rotation_left, aligned.matrix_left, size)
    right = partial(rough, images["right"], rig.right, aligned.rotation_right, aligned.matrix_right, size)
    width, height = part.size
    content = {
        "size": [width, height],
        "pictures": [b64encode(photo_jpeg(picture, part)).decode() for picture in at_once(threads, left, right)],
        "lines": [round((k + 0.5) * height / _LINES, 1) for k in range(_LINES)],
    }
    return json.dumps(content).encode()
