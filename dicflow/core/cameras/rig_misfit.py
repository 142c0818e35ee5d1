"""Why a rig does not fit photographs, from the distances of matched points from their epipolar lines.

Explanations are tried from the simplest to the most involved: left and right exchanged, photographs scaled or turned by
180°, a camera that was turned and shifted a little, a window of the sensor shifted in one or both cameras. The first
under which the points lie about as near to their lines as under any other, and in front of both cameras, is given. A
small turn and a shifted window look much the same: where both explain the points, both are named, a turn by a fifth of
a degree or less first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Rig, resized
from dicflow.core.cameras.epipolar import signed_epipolar_distance
from dicflow.core.cameras.geometry_check import distance_and_share_in_front
from dicflow.core.cameras.relative_orientation import MIN_POINTS, MatchedPoints, refine_rig

__all__ = ["REFINE", "Matched", "Misfit", "explain_misfit"]

REFINE = (
    "refine the rig from the photographs: add the line 'refined: {stage: refine, images: photos, rig: rig}' to the "
    "stages, with the names that the photographs and the rig have there; a stage that names its rig must name the "
    "refined one"
)
"""How a rig is refined whose cameras have moved."""

Size = tuple[int, int]

_MAX_FITTING_PX = 1.0
"""Median distance up to which an explanation may hold."""
_MAX_RATIO = 2.0
"""The same over that of the best explanation, and a noise of 0.2 px."""
_NOISE_PX = 0.2
_MIN_GAIN = 3.0
"""Least ratio of the distances without and with an explanation."""
_MIN_SHARE_IN_FRONT = 0.5
_MAX_ASPECT_CHANGE = 0.01
_STEPS, _DIFFERENCE_PX, _CONVERGED_PX = 50, 0.01, 1e-3
_OUTLIER_SIGMAS, _MIN_OUTLIER_PX = 3.0, 0.1
_PRIOR_PX, _PRIOR_NOISE_PX = 300.0, 1.0
"""Shifts that the points do not determine stay near the middle, with this standard deviation."""
_MAX_SIGMA_PX = 10.0
_MAX_TURN_DEG, _LIKELY_TURN_DEG = 5.0, 0.2
"""Turn of a camera that may be an explanation, and up to which it is likelier than a shifted window."""
_SIDES = ("left", "right")


class Matched(NamedTuple):
    """Matched points in two photographs.

    left, right : (n, 2) raw pixels; a few may be wrong
    sizes : (width, height) of the left and of the right photograph [px]
    """

    left: Array
    right: Array
    sizes: tuple[Size, Size]


class Misfit(NamedTuple):
    """How far points are from their epipolar lines, and what explains it.

    distance_px : median distance with the rig as it is
    explained_px : the same under the explanation; NaN without one
    cause, remedy : the explanation and what to do, in words
    """

    points: int
    distance_px: float
    explained_px: float
    cause: str
    remedy: str

    @property
    def text(self) -> str:
        """The result as a sentence."""
        fits = f", with which they lie {_length(self.explained_px)} from them" if np.isfinite(self.explained_px) else ""
        return (
            f"the rig does not fit the photographs: {self.points} matched features lie {_length(self.distance_px)} "
            f"from their epipolar lines (median); {self.cause}{fits}; {self.remedy}"
        )


class _Explanation(NamedTuple):
    """A rig and points that would fit each other, if the cause holds.

    moves : what was moved
    """

    cause: str
    remedy: str
    rig: Rig
    left: Array
    right: Array
    moves: Literal["", "camera", "window"] = ""


def explain_misfit(rig: Rig, matched: Matched, limit_px: float) -> Misfit | None:
    """The best explanation of a rig that does not fit; None if it fits, or if there are no points.

    limit_px : median distance from the epipolar lines above which the rig does not fit photographs of its own size
    """
    known = np.isfinite(matched.left).all(axis=-1) & np.isfinite(matched.right).all(axis=-1)
    matched = matched._replace(left=matched.left[known], right=matched.right[known])
    distance, in_front = distance_and_share_in_front(rig, matched.left, matched.right)
    of_size = matched.sizes == (rig.left.size, rig.right.size)
    if not known.any() or (of_size and distance <= limit_px and in_front > _MIN_SHARE_IN_FRONT):
        return None
    bound = distance / _MIN_GAIN if of_size and in_front > _MIN_SHARE_IN_FRONT else np.inf
    fitting = _fitting(list(_explanations(rig, matched)), min(bound, max(_MAX_FITTING_PX, limit_px)))
    if not fitting:
        cause = "neither exchanged nor scaled, turned or shifted photographs explain this"
        remedy = "use the calibration of these cameras as they stood; calibrate anew if they were moved or refocused"
        return Misfit(int(known.sum()), distance, np.nan, cause, remedy)
    chosen, explained = fitting[0]
    others = [one for one, _ in fitting if {one.moves, chosen.moves} == {"camera", "window"}][:1]
    cause = ", or ".join(one.cause for one in (chosen, *others))
    remedy = "; or ".join(one.remedy for one in (chosen, *others))
    return Misfit(int(known.sum()), distance, explained, cause, remedy)


def _fitting(explanations: list[_Explanation], bound_px: float) -> list[tuple[_Explanation, float]]:
    """The explanations that are about as good as the best one, with their distances."""
    figures = [distance_and_share_in_front(one.rig, one.left, one.right) for one in explanations]
    distances = [distance if share > _MIN_SHARE_IN_FRONT else np.inf for distance, share in figures]
    limit = max(_MAX_RATIO * min(distances, default=np.inf), _NOISE_PX)
    pairs = zip(explanations, distances, strict=True)
    return [(one, distance) for one, distance in pairs if distance <= min(limit, bound_px)]


def _explanations(rig: Rig, matched: Matched) -> Iterator[_Explanation]:
    """All explanations, the simplest first."""
    sizes = rig.left.size, rig.right.size
    left, right, photographed = matched
    if photographed[::-1] == sizes:
        yield _Explanation("left and right photographs look swapped", "exchange left and right", rig, right, left)
    if photographed == sizes:
        yield from _turned(rig, matched)
    for swapped in (False, True):
        order = Matched(right, left, (photographed[1], photographed[0])) if swapped else matched
        yield from _scaled(rig, order, swapped)
    moved, turn_deg = _moved(rig, matched)
    shifted = list(_shifted(rig, matched))
    yield from (*moved, *shifted) if turn_deg <= _LIKELY_TURN_DEG else (*shifted, *moved)


def _moved(rig: Rig, matched: Matched) -> tuple[list[_Explanation], float]:
    """A camera that was turned and shifted since the calibration, and the angle [deg]; no explanation above 5°."""
    if matched.sizes != (rig.left.size, rig.right.size) or len(matched.left) < MIN_POINTS:
        return [], 0.0
    equal = np.tile([1.0, 0.0, 1.0], (len(matched.left), 1))
    try:
        refined = refine_rig(rig, None, MatchedPoints(matched.left, matched.right, equal, equal))
    except ValueError:
        return [], 0.0
    turn_deg = refined.apparent_turn_deg
    if turn_deg > _MAX_TURN_DEG:
        return [], turn_deg
    cause = f"a turn of the right camera by {turn_deg:.2g}° since the calibration, as after a bump, explains this"
    explanation = _Explanation(cause, REFINE, refined.rig, matched.left, matched.right, "camera")
    return [explanation], turn_deg


def _scaled(rig: Rig, matched: Matched, swapped: bool) -> Iterator[_Explanation]:
    """Photographs of another resolution, whose sizes have the proportions of the calibration's."""
    scales = [np.divide(size, one.size) for size, one in zip(matched.sizes, (rig.left, rig.right), strict=True)]
    if all(abs(scale[0] / scale[1] - 1.0) < _MAX_ASPECT_CHANGE for scale in scales) and any(s[0] != 1 for s in scales):
        cameras = [resized(one, size) for one, size in zip((rig.left, rig.right), matched.sizes, strict=True)]
        factors = dict(zip(_SIDES, (f"{scale[0]:.4g}" for scale in scales), strict=True))
        alike = len(set(factors.values())) == 1
        factor = factors["left"] if alike else f"{factors['left']} (left) and {factors['right']} (right)"
        exchanged = "left and right photographs look swapped, and " if swapped else ""
        yield _Explanation(
            f"{exchanged}the photographs look scaled by {factor}",
            ("exchange left and right, and " if swapped else "")
            + "take or scale the photographs of the board in the same resolution",
            rig._replace(left=cameras[0], right=cameras[1]),
            matched.left,
            matched.right,
        )


def _turned(rig: Rig, matched: Matched) -> Iterator[_Explanation]:
    """Photographs turned by 180°, of one or both cameras."""
    for sides in (("left",), ("right",), _SIDES):
        left, right = (
            np.subtract(size, 1.0) - xy if side in sides else xy
            for side, xy, size in zip(_SIDES, (matched.left, matched.right), matched.sizes, strict=True)
        )
        named = " and ".join(sides)
        yield _Explanation(
            f"the {named} photographs look turned by 180°",
            f"turn the {named} photographs, or those of the board, by 180°",
            rig,
            left,
            right,
        )


def _shifted(rig: Rig, matched: Matched) -> Iterator[_Explanation]:
    """Windows of the sensor at another place than at the calibration, in one or both cameras."""
    cameras = rig.left, rig.right
    other = [tuple(size) != tuple(one.size) for size, one in zip(matched.sizes, cameras, strict=True)]
    models: list[tuple[tuple[str, ...], Callable[[Array], Array]]] = []
    if not other[0]:
        models.append((("right",), lambda p: np.array([[0.0, 0.0], p])))
    if not other[1]:
        models.append((("left",), lambda p: np.array([p, [0.0, 0.0]])))
    if other[0] == other[1]:
        models.append((_SIDES, lambda p: np.array([p, p])))
        models.append((_SIDES, lambda p: p.reshape(2, 2)))
    spare = np.array([np.subtract(one.size, size) for size, one in zip(matched.sizes, cameras, strict=True)]) / 2.0
    for k, (sides, model) in enumerate(models):
        apart = sides == _SIDES and k == len(models) - 1
        start = spare.ravel() if apart else spare[_SIDES.index(sides[-1])]
        yield _shift(rig, matched, sides, model, *_fitted_shift(rig, matched, model, start))


def _fitted_shift(rig: Rig, matched: Matched, model: Callable[[Array], Array], start: Array) -> tuple[Array, Array]:
    """Parameters (p,) of a model of the shifts that bring the points to their lines, and their σ [px].

    model : parameters → shifts (2, 2) of the left and the right window. Gauss–Newton with the weights of Geman
    and McClure (1987), whose scale follows the residuals.
    """

    def residual(parameters: Array) -> Array:
        shift = model(parameters)
        return np.nan_to_num(signed_epipolar_distance(rig, matched.left + shift[0], matched.right + shift[1]))

    parameters, prior = start.astype(float), (_PRIOR_NOISE_PX / _PRIOR_PX) ** 2
    for _ in range(_STEPS):
        error = residual(parameters)
        steps = _DIFFERENCE_PX * np.eye(len(parameters))
        slope = np.stack([(residual(parameters + step) - error) / _DIFFERENCE_PX for step in steps], axis=-1)
        scale = max(_OUTLIER_SIGMAS * _sigma(error), _MIN_OUTLIER_PX)
        weight = 1.0 / (1.0 + (error / scale) ** 2) ** 2
        normal = slope.T @ (weight[:, None] * slope) + prior * np.eye(len(parameters))
        step = np.linalg.solve(normal, slope.T @ (weight * error) + prior * (parameters - start))
        parameters = parameters - step
        if np.abs(step).max() < _CONVERGED_PX:
            break
    return parameters, _sigma(residual(parameters)) * np.sqrt(np.diag(np.linalg.inv(normal)))


def _sigma(error: Array) -> float:
    """Standard deviation of normal errors (n,) from their median length."""
    return 1.4826 * float(np.median(np.abs(error)))


def _shift(
    rig: Rig,
    matched: Matched,
    sides: tuple[str, ...],
    model: Callable[[Array], Array],
    parameters: Array,
    sigma: Array,
) -> _Explanation:
    """The explanation by windows that are shifted as a model says."""
    shift, error = model(parameters), model(sigma)
    by = {side: _pixels(shift[_SIDES.index(side)], error[_SIDES.index(side)]) for side in sides}
    alike = len(set(by.values())) == 1
    named = " and ".join(sides)
    places = f"{by[sides[0]]} in the {named}" if alike else " and ".join(f"{by[side]} in the {side}" for side in sides)
    rounded = {side: [round(float(v)) for v in shift[_SIDES.index(side)]] for side in sides}
    offset = ", ".join(f"{side}: {place}" for side, place in rounded.items())
    return _Explanation(
        f"a window of the sensor shifted by {places} photographs explains this",
        f"set offset: {{{offset}}} where the rig is calibrated or read, from the settings of the camera, or calibrate "
        "with the window used for the specimen",
        rig,
        matched.left + shift[0],
        matched.right + shift[1],
        "window",
    )


def _length(px: float) -> str:
    return f"{px:.0f} px" if px >= 10.0 else f"{px:.2g} px"


def _pixels(shift: Array, sigma: Array) -> str:
    """Both components in px, with σ where that is not small."""
    parts = [
        "an unknown amount" if s > _MAX_SIGMA_PX else f"{v:.1f}" + (f" ± {s:.1f}" if s > 0.5 else "")
        for v, s in zip(shift, sigma, strict=True)
    ]
    return f"({', '.join(parts)}) px"
