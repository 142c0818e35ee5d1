"""The calibrated rig, from the corners of all board photographs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.node import At, Joined, Millimetres, Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.rig import CalibratedRig
from dicflow.stages._parameters import unknown_steps
from dicflow.stages._target import target_of
from dicflow.stages._window import OFFSET, Offset, with_windows

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.calibration.calibrate import Calibration
    from dicflow.core.calibration.targets import Target

__all__ = ["Calibrate", "sentence"]

Side = Literal["left", "right"]
Place = tuple[float, float]

_GRID_ADVICE = "check its size, and show the whole grid with white around it to both cameras, evenly lit and sharp"
_ADVICE = {
    "checkerboard": "show the whole board to both cameras, evenly lit and sharp",
    "charuco": "check its dictionary and marker, and show a good part of it, evenly lit and sharp",
    "circles": _GRID_ADVICE,
    "asymmetric_circles": _GRID_ADVICE,
}
"""What to do if no pair shows the board."""
_NEAR_PX = 5.0
"""Distance from a place that is to be left out to its corner."""
_MOST_NAMED = 5
_DECIMALS = 3
_SIDES: tuple[Side, Side] = ("left", "right")


class Calibrate(Node):
    """Calibrate both cameras and their relative pose.

    With ``offset``, the photographs of the specimen (``images``) say how large the windows of the sensors are.

    Pairs above ``max_error_px`` are dropped one at a time, the worst first, and the rig is solved again. Left and
    right orders of the corners of a board that looks the same turned by 180° are reconciled.

    Single corners that lie far off while the others of their photograph fit are left out: by more than 8 standard
    deviations of the noise and more than ``max_error_px``, at most a tenth of a photograph. A warning names them.
    """

    title: ClassVar = "calibrate the rig"
    scope: ClassVar = Scope.RIG
    takes: ClassVar = {
        "corners": Port("corners", at=At.ALL),
        "images": Port("images", at=At.FIRST, optional=True),
    }
    gives: ClassVar = "rig"
    impl_version: ClassVar = 3

    stage: Literal["calibrate"] = "calibrate"
    square: Millimetres = parameter(
        ..., "side of one square of the board; of circles the distance of neighbouring rows", unit="mm", gt=0
    )
    radial: Literal[2, 3] = parameter(2, "coefficients of radial distortion; 3 for wide angles")
    tangential: bool = parameter(False, "estimate the tangential distortion of a lens that is not centred, too")
    max_error_px: Pixels = parameter(0.5, "limit of a pair's mean reprojection error", unit="px", gt=0)
    leave_out: dict[str, dict[Side, list[Place]]] = parameter(
        {}, "single corners not to use, by their places in the photographs [px]; name of a pair: {left: [[x, y]]}"
    )
    loss: Literal["squares", "huber", "cauchy"] = parameter(
        "squares", "how residuals count; huber and cauchy let single bad corners count less"
    )
    offset: Offset | None = parameter(None, OFFSET, unit="px")
    min_pairs: int = parameter(8, "no pair is dropped when only this many remain, and none is solved with fewer", ge=3)

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        return unknown_steps("leave_out", self.leave_out, joined["corners"])

    def joins(self, port: str) -> bool:
        return port != "images" or self.offset is not None

    def run(self, corners: Sequence[Product], images: Product | None = None) -> Product:
        import numpy as np

        from dicflow.core.calibration.bundle import LensModel
        from dicflow.core.calibration.calibrate import calibrate_rig

        boards = [BoardMarks.read(product) for product in corners]
        _check_sizes(boards)
        target, names = target_of(boards[0].board, self.square), _names(corners)
        marks = self._marks(boards, names)
        seen = [k for k, board in enumerate(boards) if board.is_found_by_both and _show_enough(marks[k], target)]
        if len(seen) < self.min_pairs:
            raise StageError(_too_few(boards, seen, self.min_pairs))
        left, right = (np.stack([marks[k][side] for k in seen]) for side in ("left", "right"))
        model, sizes = LensModel(self.radial, self.tangential), boards[0].image_sizes
        calibration = calibrate_rig(
            left, right, target, (sizes["left"], sizes["right"]), model, self.max_error_px, self.min_pairs, self.loss
        )
        pairs = _pairs(calibration, seen, names, [board.reason for board in boards])
        for pair, board, own in zip(pairs, boards, marks, strict=True):
            if left_out := _left_out(board, own):
                pair["left_out"] = left_out
        for k, off in zip(seen, calibration.gross_px, strict=True):
            if gross := _gross(marks[k], off):
                pairs[k]["gross"] = gross
        out = np.isfinite(calibration.gross_px)[..., None].swapaxes(0, 1)
        kept = [np.where(gone, np.nan, xy) for gone, xy in zip(out, (left, right), strict=True)]
        return with_windows(self._product(calibration, pairs, kept), self.offset, images)

    def _marks(self, boards: Sequence[BoardMarks], names: Sequence[str]) -> list[dict[str, np.ndarray]]:
        """Marks (m, 2) of each pair by side, NaN where they are not seen or not to be used."""
        import numpy as np

        if unknown := [name for name in self.leave_out if name not in names]:
            raise StageError(f"leave_out names {', '.join(unknown)}, which is no pair; pairs: {', '.join(names)}")
        marks: list[dict[str, np.ndarray]] = []
        for name, board in zip(names, boards, strict=True):
            marks.append({side: np.array(board[side]) for side in _SIDES})
            for side, places in self.leave_out.get(name, {}).items():
                out = [_nearest(board[side], place, f"{name}, {side}") for place in places]
                marks[-1][side][out] = np.nan
        return marks

    def _product(self, calibration: Calibration, pairs: list[dict[str, Any]], corners: Sequence[np.ndarray]) -> Product:
        """The rig, its covariance, the errors of each pair, and the verdict. corners : (n, m, 2) left and right"""
        from dicflow.core.calibration.coverage import covered_area, verdict

        cameras = calibration.rig.left, calibration.rig.right
        areas = [covered_area(xy[calibration.used], one.size) for xy, one in zip(corners, cameras, strict=True)]
        coverage = {side: float(area.mean()) for side, area in zip(("left", "right"), areas, strict=True)}
        return CalibratedRig.write(
            calibration.rig,
            verdict(calibration, areas, self.max_error_px, len(pairs)),
            _residuals(calibration, coverage) | _figures(calibration) | _known_distance(calibration, self.square),
            covariance=calibration.widened_covariance,
            pairs=pairs,
            coverage=coverage,
            warnings=_gross_warnings(pairs),
        )


def _check_sizes(boards: Sequence[BoardMarks]) -> None:
    """Raise StageError if the photographs differ in size, or are of one camera."""
    if any("right" not in board for board in boards):
        raise StageError("a rig needs board photographs of two cameras, found only left ones; add 'right' to them")
    first = boards[0].image_sizes
    for k, board in enumerate(boards):
        for side, size in board.image_sizes.items():
            if size != first[side]:
                raise StageError(
                    "all board photographs of a camera must have one size, but the {} one of pair 1 has {} × {} px and "
                    "that of pair {} has {} × {}; remove those of another size".format(side, *first[side], k + 1, *size)
                )


def _show_enough(marks: Mapping[str, np.ndarray], target: Target) -> bool:
    """Whether the marks of both photographs determine the pose of the board."""
    import numpy as np

    from dicflow.core.calibration.targets import determines_pose

    return all(determines_pose(target.points, np.isfinite(xy[:, 0])) for xy in marks.values())


def _nearest(marks: np.ndarray, place: tuple[float, float], where: str) -> int:
    """Number of the mark at a place. Raises StageError where no mark is near. where : pair and side"""
    import numpy as np

    off = np.hypot(*(marks.reshape(-1, 2) - place).T)
    if not (np.nan_to_num(off, nan=np.inf) <= _NEAR_PX).any():
        raise StageError(f"leave_out: {where} has no corner within {_NEAR_PX:g} px of {list(place)}; give its place")
    return int(np.nanargmin(off))


def _left_out(board: BoardMarks, marks: Mapping[str, np.ndarray]) -> dict[str, list[list[float]]]:
    """Left and right → places [px] of the marks that were seen and are not used."""
    import numpy as np

    out = {side: board[side][np.isfinite(board[side][:, 0]) & np.isnan(xy[:, 0])] for side, xy in marks.items()}
    return {side: xy.round(_DECIMALS).tolist() for side, xy in out.items() if len(xy)}


def _gross(marks: Mapping[str, np.ndarray], off_px: np.ndarray) -> dict[str, list[list[float]]]:
    """Left and right → place and distance [px] of each gross mark. marks : (m, 2) each; off_px : (2, m)"""
    import numpy as np

    rows = {side: np.column_stack([marks[side], off]) for side, off in zip(_SIDES, off_px, strict=True)}
    out = {side: found[np.isfinite(found[:, 2])] for side, found in rows.items()}
    return {side: found.round(_DECIMALS).tolist() for side, found in out.items() if len(found)}


def _gross_warnings(pairs: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence on gross corners, if there are any."""
    named = list(_named(pairs))
    if not named:
        return []
    more = f"; and {len(named) - _MOST_NAMED} more" if len(named) > _MOST_NAMED else ""
    corners, are = ("1 corner", "is") if len(named) == 1 else (f"{len(named)} corners", "are")
    return [
        f"{corners} far off all others {are} left out: {'; '.join(named[:_MOST_NAMED])}{more}; look at the photographs"
        " and name what is wrong under leave_out"
    ]


def _named(pairs: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for pair in pairs:
        for side, marks in pair.get("gross", {}).items():
            for x, y, off in marks:
                yield f"{pair['name']}, {side}, at ({x:.0f}, {y:.0f}) by {off:.1f} px"


def _too_few(boards: Sequence[BoardMarks], seen: list[int], needed: int) -> str:
    """The message for too few pairs with the board; it names another board that they show."""
    from dicflow.core.calibration.board import common_board

    expected = boards[0].board
    others = [other for board in boards for other in board.others.values()]
    hint = _ADVICE[expected.target]
    if others:
        other, count = common_board(others)
        photographs = "1 photograph shows" if count == 1 else f"{count} photographs show"
        hint = f"{photographs} {other.text}: set {other.settings(expected)}"
    elif len(seen) == len(boards):
        hint = f"take {needed - len(seen)} more, with the board at other places and angles"
    if not seen:
        return f"{expected.text} is seen in none of {len(boards)} pairs; {hint}"
    return (
        f"{expected.text} is seen by both cameras in {len(seen)} of {len(boards)} pairs, and {needed} are needed; "
        f"{hint}"
    )


def _names(corners: Sequence[Product]) -> Sequence[str]:
    """Names of the pairs; "pair 1", "pair 2", … if the series has none."""
    return getattr(corners, "steps", None) or [f"pair {k + 1}" for k in range(len(corners))]


def _pairs(
    calibration: Calibration, seen: list[int], names: Sequence[str], reasons: Sequence[str]
) -> list[dict[str, Any]]:
    """One entry per board pair, in order; a reason in place of errors if a camera does not see the board.

    The epipolar distance is None if the cameras see different parts of a board.
    """
    pairs: list[dict[str, Any]] = [{"name": name, "used": False} for name in names]
    for k in set(range(len(names))) - set(seen):
        pairs[k]["reason"] = reasons[k] or "too few corners"
    for k, used, turned, (left, right), epipolar in zip(
        seen, calibration.used, calibration.turned, calibration.error_px, calibration.epipolar_px, strict=True
    ):
        pairs[k] |= {"used": bool(used), "turned": bool(turned)}
        pairs[k] |= {"left_px": float(left), "right_px": float(right)}
        pairs[k]["epipolar_px"] = float(epipolar) if epipolar == epipolar else None
    return pairs


def _residuals(calibration: Calibration, coverage: dict[str, float]) -> dict[str, float]:
    """Residuals of the corners in the pairs used, and the share of each frame that these pairs cover."""
    import numpy as np

    left, right, both = calibration.rms_px.tolist()
    return {
        "rms_px": both,
        "left_rms_px": left,
        "right_rms_px": right,
        "mean_px": float(calibration.error_px[calibration.used].mean()),
        "epipolar_px": float(np.nanmean(calibration.epipolar_px[calibration.used])),
        "noise_px": calibration.noise_px,
        "pairs_used": int(calibration.used.sum()),
        "coverage_left": coverage["left"],
        "coverage_right": coverage["right"],
    }


def _figures(calibration: Calibration) -> dict[str, float]:
    """Focal lengths, baseline and angle, with σ of each and its spread as pairs are left out."""
    from dicflow.core.cameras.rig_parameters import KEY_FIGURES, key_figure_sigmas, key_figures

    sigmas = key_figure_sigmas(calibration.rig, calibration.widened_covariance)
    columns = {"": key_figures(calibration.rig), "sigma_": sigmas, "spread_": calibration.leave_out.spread}
    table = {sign + name: float(value) for sign, values in columns.items()
             for name, value in zip(KEY_FIGURES, values, strict=True)}  # fmt: skip
    return {**table, "disagreement": calibration.disagreement}


def _known_distance(calibration: Calibration, square_mm: float) -> dict[str, float]:
    """Side of the square, reconstructed in pairs left out of the rig: mean and standard deviation over the boards."""
    import numpy as np

    scale = calibration.leave_out.scale[np.isfinite(calibration.leave_out.scale)]
    if not len(scale):
        return {}
    return {
        "square_mm": square_mm * float(scale.mean()),
        "square_spread_mm": square_mm * float(scale.std(ddof=1)) if len(scale) > 1 else 0.0,
        "square_error_pct": 100.0 * float(scale.mean() - 1.0),
    }


def sentence(stage: Calibrate, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    tangential = " and two of tangential" if stage.tangential else ""
    robust = {"huber": ", with Huber's loss [huber1981]", "cauchy": ", with Cauchy's loss [huber1981]"}
    text = (
        f"Both cameras and their relative pose were calibrated with a board of {stage.square:g} mm spacing "
        f"[zhang2000] by bundle adjustment [triggs2000]{robust.get(stage.loss, '')}; the camera model is a pinhole "
        f"with {_COUNTS[stage.radial]} coefficients of radial{tangential} distortion [brown1971]"
    )
    if product is None:
        return text + "."
    rig = CalibratedRig.read(product)
    used = sum(pair["used"] for pair in rig.pairs)
    return f"{text}. With {used} pairs of photographs the root mean square reprojection error was " + (
        f"{rig.summary['rms_px']:.2g} px."
    )


_COUNTS = {2: "two", 3: "three"}
