"""The relative orientation of two cameras, refined from points that both photographs show.

A matched point has four coordinates and three unknowns, its place X. One combination of its reprojection errors e does
not depend on the place: r = nᵀe with nᵀ ∂(pixels)/∂X = 0. It is the distance from the epipolar line, with distortion
and to first order, has the variance nᵀCn by the pixels' covariance C, and changes with the rig's parameters by
−nᵀ ∂(pixels)/∂θ. The rig of maximum posterior probability has the least

    Σ ρ(r / σ) / κ + (θ − θ₀)ᵀ P⁻¹ (θ − θ₀),

where θ₀ is the rig as calibrated, ρ Cauchy's loss, and κ the variance of the residuals summed over blocks of the
photograph, per point: what neighbours have in common counts once. The covariance P is that of the calibration, and that
of a motion of the cameras since then: a turn about any axis by τ, and a shift in any direction that moves the picture
as far. τ is averaged over its evidence (MacKay 1992, "Bayesian interpolation"), and is at least what a bump may do
without notice: a motion that the points do not show leaves no trace in the rest. What they do not show stays as
calibrated, with this uncertainty. The length of the baseline is always of that kind: with twice as long a one, all
points are as near to their lines. Coefficients of the distortion that were not estimated are as uncertain as real
lenses make them, since decentring by a tenth of a pixel in the corners looks as a turn does. They stay as they are:
what they do along the lines the points do not show (the consider parameters of Schmidt 1966).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Index
from dicflow.core.cameras.camera import Rig, project, rotation_vector, to_right
from dicflow.core.cameras.epipolar import cross_matrix
from dicflow.core.cameras.rig_parameters import (
    PARAMETERS,
    PARAMETERS_PER_CAMERA,
    error_modes,
    reprojection_slopes,
    rig_after_step,
)
from dicflow.core.cameras.triangulate import triangulate

__all__ = [
    "MIN_POINTS",
    "POSSIBLE_TURN_DEG",
    "MatchedPoints",
    "Motion",
    "Refined",
    "motion_since",
    "refine_rig",
    "residuals_and_slopes",
    "unmodelled_lenses",
    "unseen_motions",
]

MIN_POINTS = 20
"""With fewer points, nothing is estimated."""
POSSIBLE_TURN_DEG = 0.1
"""How far a bumped camera may have turned without notice [deg]."""
_POSE = slice(2 * PARAMETERS_PER_CAMERA, len(PARAMETERS))
_TURN = slice(_POSE.start, _POSE.start + 3)
_FREED = {"focal_length": ((0, 1),), "principal_point": ((2,), (3,))}
"""Parameters of each camera that change together."""
_DISTORTION_POWERS = {4: 3, 5: 5, 6: 2, 7: 2, 8: 7}
"""Coefficient of the distortion → power of the distance from the middle with which it moves a point."""
_UNMODELLED_PX = 0.1
"""Standard deviation of the shift in the corner of a photograph by a coefficient that was not estimated."""
_FREED_SHARE = 0.02
"""Standard deviation of a change of what is freed, over the focal length."""
_CAUCHY = 2.385
"""Scale of the loss in standard deviations, at which 95 % of the efficiency remains (Holland and Welsch 1977)."""
_SIGMA_PER_MAD = 1.4826
_FIRST_TURN = 0.01
_TURNS = np.geomspace(1e-6, 0.2, 80)
_SAME_MOTION = 0.02
_MIN_SCALE, _MIN_STIFFNESS = 1e-12, 0.1
_ROUNDS, _STEPS, _SETTLED = 6, 30, 1e-6
_POINTS_PER_BLOCK, _MAX_BLOCKS_ACROSS = 4, 8
_UNSEEN_SHARE = 0.5
"""Share of its prior standard deviation that the points leave a motion that they do not show."""
_FITTED = 5
"""Parameters that the points determine, by which the sums over the blocks are smaller."""


class MatchedPoints(NamedTuple):
    """Points in both photographs.

    left, right : (n, 2) — raw pixels
    covariance_left, covariance_right : (n, 3) — xx, xy, yy of their errors, up to a common factor [px²]
    """

    left: Array
    right: Array
    covariance_left: Array
    covariance_right: Array


class Refined(NamedTuple):
    """A refined rig.

    rig : the refined one
    covariance : (24, 24) — of its :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`
    prior : (24, 24) — the same without the points
    motion : τ, the standard deviation of the turns [rad]
    gain : logarithm of the evidence for this motion over that for none
    noise : √κ, standard deviation of the residuals over that predicted by the pixels' covariance
    residual : (n,) — r / σ of the points
    apparent_turn_deg : angle of the turn of the right camera alone that moves the points most alike across their
        epipolar lines
    """

    rig: Rig
    covariance: Array
    prior: Array
    motion: float
    gain: float
    noise: float
    residual: Array
    apparent_turn_deg: float


class Motion(NamedTuple):
    """How far the right camera stands from where it stood, seen from the left one, with standard deviations."""

    turn_deg: float
    sigma_turn_deg: float
    shift_mm: float
    sigma_shift_mm: float


class _Fit(NamedTuple):
    """A rig near which the points' share in the probability of its parameters is known to second order.

    With the step d from the calibrated rig, minus its logarithm is |R d − y|² / 2 and a constant.

    root, target : (24, 24) R and (24,) y
    residual, variance : (n,) r / σ, and κ
    """

    rig: Rig
    root: Array
    target: Array
    residual: Array
    variance: float


class _Modes(NamedTuple):
    """R M = U diag(s) Vᵀ of the modes M (24, m) of a prior covariance, and the target in the columns of U.

    modes : M; strengths : (k,) s; directions : (k, m) Vᵀ; target : (k,) Uᵀ y
    """

    modes: Array
    strengths: Array
    directions: Array
    target: Array


def refine_rig(
    rig: Rig,
    covariance: Array | None,
    points: MatchedPoints,
    turn_deg: float = POSSIBLE_TURN_DEG,
    freed: Sequence[str] = (),
) -> Refined:
    """Refine a rig.

    covariance : (24, 24) — of its parameters; None where unknown, then focal lengths and principal points are exact
    turn_deg : least τ, how far a camera may have turned where the points do not show it [deg]
    freed : of "focal_length" and "principal_point", what has changed besides

    Raises ValueError for fewer than MIN_POINTS points, and where most are not in front of both cameras.
    """
    if len(points.left) < MIN_POINTS:
        raise ValueError(f"a rig needs {MIN_POINTS} matched points, found {len(points.left)}")
    size = len(PARAMETERS)
    calibration = np.zeros((size, size)) if covariance is None else covariance
    lenses = unmodelled_lenses(rig, calibration)
    known = np.hstack([error_modes(calibration), lenses, _freed(rig, freed)])
    moved, blocks = _unit_motion(rig, points), _blocks(points.left)
    motion, step = _FIRST_TURN, np.zeros(size)
    for _ in range(_ROUNDS):
        fit, step = _fitted(rig, points, blocks, np.hstack([known, motion * moved]), step)
        evidence = np.array([_evidence(_decomposed(fit, np.hstack([known, turn * moved]))) for turn in _TURNS])
        before, motion = motion, max(_mean_square_root(evidence), np.radians(turn_deg))
        if abs(motion - before) < _SAME_MOTION * before:
            break
    modes = np.hstack([known, motion * moved])
    fit, step = _fitted(rig, points, blocks, modes, step)
    apparent_turn = _apparent_turn(fit, step, motion)
    kept = np.flatnonzero(lenses.any(axis=1))
    prior, covariance = modes @ modes.T, _posterior(_decomposed(fit, modes))
    step[kept], covariance[np.ix_(kept, kept)] = 0.0, prior[np.ix_(kept, kept)]
    return Refined(
        rig_after_step(rig, step),
        covariance,
        prior,
        motion,
        float(evidence.max() - evidence[0]),
        float(np.sqrt(fit.variance)),
        fit.residual,
        float(np.degrees(np.linalg.norm(apparent_turn))),
    )


def motion_since(calibrated: Rig, refined: Refined) -> Motion:
    """The motion from a calibrated rig to a refined one, to first order of its errors."""
    rig, pose = refined.rig, refined.covariance[_POSE, _POSE]
    turn = rotation_vector(rig.rotation @ calibrated.rotation.T)
    centres = [-one.rotation.T @ one.translation for one in (rig, calibrated)]
    shift = centres[0] - centres[1]
    by_turn = np.hstack([np.eye(3), np.zeros((3, 3))])
    by_shift = -rig.rotation.T @ np.hstack([cross_matrix(rig.translation), np.eye(3)])
    sizes = [
        (float(np.linalg.norm(vector)), float(np.sqrt(axis @ slopes @ pose @ slopes.T @ axis)))
        for vector, slopes in ((turn, by_turn), (shift, by_shift))
        for axis in [vector / max(float(np.linalg.norm(vector)), 1e-12)]
    ]
    (angle, sigma_angle), (length, sigma_length) = sizes
    return Motion(float(np.degrees(angle)), float(np.degrees(sigma_angle)), length, sigma_length)


def unseen_motions(refined: Refined) -> list[str]:
    """Motions of the right camera that the points do not show, as words, each with its standard deviation.

    Turns about its axes, and shifts along the baseline and along the two axes most normal to it, of which the points
    leave more than half of the standard deviation that they had before. Of two of them the sum may be well known.
    """
    along = refined.rig.translation / np.linalg.norm(refined.rig.translation)
    across = np.sort(np.argsort(np.abs(along))[:2])
    shifts = np.linalg.qr(np.column_stack([along, np.eye(3)[:, across]]))[0]
    directions = np.zeros((6, 6))
    directions[:3, :3], directions[3:, 3:] = np.eye(3), shifts
    before, after = (
        np.sqrt(np.diag(directions.T @ covariance[_POSE, _POSE] @ directions))
        for covariance in (refined.prior, refined.covariance)
    )
    names = [f"a turn about {axis} (± {np.degrees(sigma):.2g}°)" for axis, sigma in zip("XYZ", after, strict=False)]
    names += [
        f"a shift along {direction} (± {sigma:.2g} mm)"
        for direction, sigma in zip(("the baseline", *("XYZ"[k] for k in across)), after[3:], strict=True)
    ]
    return [name for name, old, new in zip(names, before, after, strict=True) if new > _UNSEEN_SHARE * old]


def _fitted(rig: Rig, points: MatchedPoints, blocks: Index, modes: Array, step: Array) -> tuple[_Fit, Array]:
    """The most probable rig at a prior covariance M Mᵀ, and the step (24,) to it, by Gauss–Newton.

    modes : M (24, m); step : (24,) — from the calibrated rig to where the search starts
    """
    for _ in range(_STEPS):
        fit = _linearised(rig, step, points, blocks)
        found = _most_probable(_decomposed(fit, modes))
        change, step = found - step, found
        if np.sum((fit.root @ change) ** 2) < _SETTLED:
            break
    return _linearised(rig, step, points, blocks), step


def _linearised(rig: Rig, step: Array, points: MatchedPoints, blocks: Index) -> _Fit:
    """The share of the points at a step (24,) from the calibrated rig."""
    moved = rig_after_step(rig, step)
    residual, slopes = residuals_and_slopes(moved, points)
    slopes[:, _TURN] = slopes[:, _TURN] @ _turn_slopes(step[_TURN])
    scale = _CAUCHY * max(_SIGMA_PER_MAD * float(np.median(np.abs(residual))), _MIN_SCALE)
    weight = 1.0 / (1.0 + (residual / scale) ** 2)
    stiffness = max(float(np.mean(weight * (2.0 * weight - 1.0))), _MIN_STIFFNESS)
    variance = _variance(weight * residual, blocks) / stiffness**2
    directions, root = np.linalg.qr(slopes / np.sqrt(variance))
    target = root @ step - directions.T @ (weight * residual) / (stiffness * np.sqrt(variance))
    return _Fit(moved, root, target, residual, variance)


def _turn_slopes(turn: Array) -> Array:
    """Small rotation (3, 3) that follows exp([δ]×), by a change of δ, to third order of it."""
    cross = cross_matrix(turn)
    return np.asarray(np.eye(3) + cross / 2.0 + cross @ cross / 6.0)


def _decomposed(fit: _Fit, modes: Array) -> _Modes:
    left, strengths, directions = np.linalg.svd(fit.root @ modes, full_matrices=False)
    return _Modes(modes, strengths, directions, left.T @ fit.target)


def _most_probable(found: _Modes) -> Array:
    """The step (24,) of greatest probability, M z with the least |R M z − y|² + |z|²."""
    s = found.strengths
    return np.asarray(found.modes @ (found.directions.T @ (s / (1.0 + s**2) * found.target)))


def _posterior(found: _Modes) -> Array:
    """Covariance (24, 24) of the parameters, M (Mᵀ Rᵀ R M + 1)⁻¹ Mᵀ."""
    s, known = found.strengths, found.modes @ found.directions.T
    return np.asarray(found.modes @ found.modes.T - (known * (s**2 / (1.0 + s**2))) @ known.T)


def _apparent_turn(fit: _Fit, step: Array, motion: float) -> Array:
    """The turn (3,) about the axes of the right camera whose effect on the points is nearest to that of a step (24,).

    motion : its standard deviation before [rad]
    """
    effects = np.vstack([fit.root[:, _TURN], np.eye(3) / max(motion, _TURNS[0])])
    return np.asarray(np.linalg.lstsq(effects, np.append(fit.root @ step, np.zeros(3)), rcond=None)[0])


def _evidence(found: _Modes) -> float:
    """Logarithm of the probability of the points at a prior covariance M Mᵀ, up to a constant."""
    squares = found.strengths**2
    return float(0.5 * np.sum(squares / (1.0 + squares) * found.target**2 - np.log1p(squares)))


def residuals_and_slopes(rig: Rig, points: MatchedPoints) -> tuple[Array, Array]:
    """r / σ (n,) and its derivatives by the rig's parameters (n, 24); 0 for a point that cannot be behind both."""
    found = triangulate(rig, *points).xyz
    measured = np.concatenate([points.left, points.right], axis=-1)
    error = measured - np.concatenate([project(rig.left, found), project(rig.right, to_right(rig, found))], axis=-1)
    known = np.isfinite(error).all(axis=-1)
    if 2 * np.count_nonzero(known) < len(known):
        raise ValueError("fewer than half of the matched points lie in front of both cameras; check left and right")
    by_point, by_rig = reprojection_slopes(rig, np.where(known[:, None], found, [0.0, 0.0, 1.0]))
    normal = np.linalg.svd(by_point)[0][..., 3]
    sigma = np.sqrt(variance_along(normal, points))
    residual = np.einsum("ni,ni->n", normal, np.where(known[:, None], error, 0.0)) / sigma
    slopes = -np.einsum("ni,nip->np", normal, by_rig) / sigma[:, None]
    return residual, np.where(known[:, None], slopes, 0.0)


def variance_along(normal: Array, points: MatchedPoints) -> Array:
    """nᵀCn (n,) of normals (n, 4) [px²]."""
    parts = (normal[:, :2], points.covariance_left), (normal[:, 2:], points.covariance_right)
    return np.asarray(
        sum(n[:, 0] ** 2 * c[:, 0] + 2.0 * n[:, 0] * n[:, 1] * c[:, 1] + n[:, 1] ** 2 * c[:, 2] for n, c in parts)
    )


def _variance(score: Array, blocks: Index) -> float:
    """Variance of sums of the scores (n,) over blocks, per point, or of single ones where that is larger."""
    sums = np.bincount(blocks, score)
    filled = np.bincount(blocks) > 0
    free = max(1.0 - _FITTED / max(int(filled.sum()), 1), 0.1)
    return float(max(np.sum(sums**2) / free, np.sum(score**2)) / len(score))


def _mean_square_root(evidence: Array) -> float:
    """Root mean square of τ over its probability, for the logarithms of the evidence at _TURNS (n,)."""
    weight = np.exp(evidence - evidence.max())
    return float(np.sqrt(weight @ _TURNS**2 / weight.sum()))


def _unit_motion(rig: Rig, points: MatchedPoints) -> Array:
    """Modes (24, 6) of a motion by 1 rad: turns about the axes of the right camera, and shifts along them."""
    distance = float(np.nanmedian(np.linalg.norm(triangulate(rig, points.left, points.right).xyz, axis=-1)))
    modes = np.zeros((len(PARAMETERS), 6))
    modes[_POSE] = np.diag([1.0, 1.0, 1.0, distance, distance, distance])
    return modes


def unmodelled_lenses(rig: Rig, covariance: Array) -> Array:
    """Modes (24, m) of the distortion of real lenses by coefficients that a calibration takes as exact."""
    modes = []
    for k, camera in enumerate((rig.left, rig.right)):
        corner = np.hypot(*camera.size) / 2.0 / camera.matrix[0, 0]
        for place, power in _DISTORTION_POWERS.items():
            if covariance[k * PARAMETERS_PER_CAMERA + place, k * PARAMETERS_PER_CAMERA + place] == 0.0:
                mode = np.zeros(len(PARAMETERS))
                mode[k * PARAMETERS_PER_CAMERA + place] = _UNMODELLED_PX / camera.matrix[0, 0] / corner**power
                modes.append(mode)
    return _columns(modes)


def _freed(rig: Rig, freed: Sequence[str]) -> Array:
    """Modes (24, m) of the changes of what is freed."""
    modes = []
    for k, camera in enumerate((rig.left, rig.right)):
        for group in (group for name in freed for group in _FREED[name]):
            mode = np.zeros(len(PARAMETERS))
            mode[[k * PARAMETERS_PER_CAMERA + place for place in group]] = _FREED_SHARE * camera.matrix[0, 0]
            modes.append(mode)
    return _columns(modes)


def _columns(modes: list[Array]) -> Array:
    return np.stack(modes, axis=-1) if modes else np.zeros((len(PARAMETERS), 0))


def _blocks(places: Array) -> Index:
    """The block (n,) of the photograph in which each place (n, 2) lies."""
    across = int(np.clip(np.sqrt(len(places) / _POINTS_PER_BLOCK), 1, _MAX_BLOCKS_ACROSS))
    low, high = places.min(axis=0), places.max(axis=0)
    cell = np.minimum(across * (places - low) / np.maximum(high - low, 1e-9), across - 1).astype(np.int64)
    return np.asarray(cell[:, 1] * across + cell[:, 0])
