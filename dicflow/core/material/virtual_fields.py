"""Constants from whole fields: the virtual work of the stresses is that of the load, for every virtual displacement.

For a sheet of thickness t between two grips, one at rest and the other pulled along Y by the force F, and every virtual
displacement u* that is 0 at the first grip and (0, e) at the second, t ∫ P : ∂u*/∂X dA = F e. The sides are free. A
**virtual field** is the gradient of u* at the points, and its work e by a unit force.

Points (n,) have places, areas and deformation gradients F (step, n, 2, 2) in the first configuration; together their
areas should be the sheet's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from dicflow.core.arrays import Array
from dicflow.core.material.fit import corrected_criterion, correlation_of
from dicflow.core.material.membrane import sheet_stress, sheet_stress_by_constants, sheet_stress_by_gradient
from dicflow.core.material.models import Model

__all__ = [
    "FieldFit",
    "Sheet",
    "VirtualField",
    "balance",
    "constants_of",
    "piecewise_fields",
    "uniform",
]


_ROUNDS = 2
"""Searches, each with weights at the constants of the one before."""
_MOST_EVALUATIONS = 100
"""Of the residuals in one search. Models that fit need 60 at most; of one that does not, terms run away."""
_LEAST_VARIANCE = 1e-8
"""Variance of a sum of virtual works, relative to that of the noisiest one, that counts as noise at least."""
_BUMP, _APART, _REACH = 0.25, 1.5, 3.0
"""Width of a bump of noise, in sides of a gauge; distance of bumps, and how far they go beyond the points, in widths.

Slopes of straight lines through a window of subsets have nearly the noise of the slopes of such bumps.
"""


class Sheet(NamedTuple):
    """A thin specimen between two grips.

    places : (n, 2) — X across the load, from 0 to ``width``, and Y along it, from 0 at the resting grip to ``length``;
        or any two numbers in their place that are 0, ``width`` and ``length`` at the sides and the grips
    areas : (n,) — of the first surface that each point stands for [mm²]
    gradients : (step, n, 2, 2)
    forces : (step,) [N]
    width, length, thickness : [mm]
    u_gradient : standard deviation of each component of the gradients by noise, one number or (step,)
    u_bias : the same of the bias that remains in them, which is one error of all steps
    shared : number of points in a gauge of the strain, whose windows overlap
    u_force : standard deviation of each force [N]
    u_thickness, u_width : of the thickness, which all sheets share, and of the width, relative to them
    slopes : (n, 2, 2) — derivatives of the places along X and Y; None where the places are X and Y
    """

    places: Array
    areas: Array
    gradients: Array
    forces: Array
    width: float
    length: float
    thickness: float
    u_gradient: float | Array = 0.0
    u_bias: float | Array = 0.0
    shared: float = 1.0
    u_force: float = 0.0
    u_thickness: float = 0.0
    u_width: float = 0.0
    slopes: Array | None = None

    @property
    def noise_width(self) -> float:
        """Width of the bumps that make the noise of the gradients; cells of virtual fields are no smaller [mm]."""
        return _BUMP * float(np.sqrt(self.shared * self.areas.mean()))

    def in_space(self, gradient: Array) -> Array:
        """Derivatives (..., n, 2) by the places as those along X and Y."""
        return gradient if self.slopes is None else np.asarray(np.einsum("...nk,nkj->...nj", gradient, self.slopes))


class VirtualField(NamedTuple):
    """gradient : ∂u*/∂X (n, 2, 2); work : e"""

    gradient: Array
    work: float


class FieldFit(NamedTuple):
    """Constants (p,), and their covariance (p, p).

    independent : by the noise of fields and forces
    common : by the section and by the bias that remains in the fields
    residuals : of each sheet, virtual work of the stresses less that of the force, (step, field) [N]
    squares, equations : sum of the weighted squares of the residuals, and their number
    """

    constants: Array
    independent: Array
    common: Array
    residuals: tuple[Array, ...]
    squares: float
    equations: int

    @property
    def misfit_ratio(self) -> float:
        """Weighted squares per degree of freedom: 1 where the noise explains the residuals."""
        return self.squares / (self.equations - len(self.constants))

    @property
    def aicc(self) -> float:
        """Akaike's corrected criterion with a common factor of all variances estimated."""
        return corrected_criterion(self.squares, self.equations, len(self.constants))

    @property
    def covariance(self) -> Array:
        """Of the constants, both shares together, (p, p)."""
        return self.independent + self.common

    @property
    def correlation(self) -> Array:
        """Of the constants by the independent share, (p, p)."""
        return correlation_of(self.independent)


def uniform(sheet: Sheet) -> VirtualField:
    """u* = (0, Y / L), by which the mean of P_yy carries the force."""
    gradient = np.zeros((len(sheet.areas), 2, 2))
    gradient[:, 1] = sheet.in_space(np.broadcast_to([0.0, 1.0 / sheet.length], (len(sheet.areas), 2)))
    return VirtualField(gradient, 1.0)


def balance(model: Model, c: Array, sheet: Sheet) -> Array:
    """Force that the mean of P_yy carries at each step, relative to that measured, (step,); NaN without force."""
    stress = sheet_stress(model, c, sheet.gradients)
    work = sheet.thickness * np.einsum("n,snij,nij->s", sheet.areas, stress, uniform(sheet).gradient)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(sheet.forces == 0.0, np.nan, work / sheet.forces))


def piecewise_fields(sheet: Sheet, columns: Array, rows: Array) -> list[VirtualField]:
    """Bilinear virtual displacements on a mesh over the sheet.

    One field for each component of each node between the grips, and one that moves the whole pulled grip along Y.
    columns, rows : where the lines of the mesh lie along X and Y, from 0 to the width and the length; they should lie
        between the points, so that the areas of these sum up each cell
    """
    shapes = _shapes(sheet, columns, rows)
    fields = []
    for row in range(1, len(rows) - 1):
        for column in range(len(columns)):
            for axis in (0, 1):
                gradient = np.zeros((len(sheet.areas), 2, 2))
                gradient[:, axis] = shapes[row, column]
                fields.append(VirtualField(gradient, 0.0))
    grip = np.zeros((len(sheet.areas), 2, 2))
    grip[:, 1] = shapes[-1].sum(axis=0)
    return [VirtualField(grip, 1.0), *fields]


def _shapes(sheet: Sheet, columns: Array, rows: Array) -> Array:
    """Gradients of the bilinear shape functions at the points, (row, column, n, 2)."""
    across, by_x = _hats(sheet.places[:, 0], columns)
    along, by_y = _hats(sheet.places[:, 1], rows)
    by_place = np.stack([along[:, None, :] * by_x[None, :, :], by_y[:, None, :] * across[None, :, :]], axis=-1)
    return sheet.in_space(by_place)


def _hats(places: Array, lines: Array) -> tuple[Array, Array]:
    """Hat functions of the lines of a mesh and their slopes at places (n,), (line, n) each."""
    cell = np.clip(np.searchsorted(lines, places, side="right") - 1, 0, len(lines) - 2)
    side = np.diff(lines)[cell]
    share, points = (places - lines[cell]) / side, np.arange(len(places))
    values, slopes = np.zeros((2, len(lines), len(places)))
    values[cell, points], values[cell + 1, points] = 1.0 - share, share
    slopes[cell, points], slopes[cell + 1, points] = -1.0 / side, 1.0 / side
    return values, slopes


def constants_of(
    model: Model, sheets: Sequence[Sheet], fields: Sequence[Sequence[VirtualField]], start: Array
) -> FieldFit:
    """Constants by weighted least squares over all steps and virtual fields of one or several specimens.

    The virtual works of one step are weighted by the inverse of their covariance, since they share the errors of the
    points, by noise and by the bias that remains; where the noise of gradients is unknown, alike. Where residuals are
    larger than these errors explain (5 % level), or nothing is known of them, they give the variance.
    fields : of each sheet
    start : constants (p,) from which Gauss and Newton's search begins
    Raises ValueError if there are not more equations than constants.
    """
    equations = sum(len(sheet.forces) * len(listed) for sheet, listed in zip(sheets, fields, strict=True))
    if equations <= len(model.constants):
        raise ValueError(f"{equations} equations for {len(model.constants)} constants; give more steps or fields")
    systems, c = [_System(*pair) for pair in zip(sheets, fields, strict=True)], start
    for _ in range(_ROUNDS):
        noise = [system.by_noise(model, c) for system in systems]
        whiteners = [system.whitener(part) for system, part in zip(systems, noise, strict=True)]
        c = least_squares(
            lambda x: _all(whiteners, [system.residuals(model, x) for system in systems]),  # noqa: B023
            c,
            lambda x: _all(whiteners, [system.slopes(model, x) for system in systems]),  # noqa: B023
            x_scale="jac",
            xtol=1e-12,
            max_nfev=_MOST_EVALUATIONS,
        ).x
    solver = np.asarray(np.linalg.pinv(_all(whiteners, [system.slopes(model, c) for system in systems])), dtype=float)
    residuals = [system.residuals(model, c) for system in systems]
    left = _all(whiteners, residuals)
    squares = float(left @ left)
    variance = _variance(squares, equations - len(c), all(system.is_noisy for system in systems))
    shifts = np.stack([solver @ _all(whiteners, changes) for changes in _by_section(systems)])
    independent, by_bias = _by_fields(systems, whiteners, noise, solver)
    return FieldFit(c, independent * variance, shifts.T @ shifts + by_bias, tuple(residuals), squares, equations)


def _by_fields(
    systems: Sequence[_System], whiteners: Sequence[Array], noise: Sequence[Array], solver: Array
) -> tuple[Array, Array]:
    """Covariances of the constants by the noise of fields and forces, and by the bias of the fields, (p, p) each.

    noise : of each sheet, see :meth:`_System.by_noise`; solver : (p, n) — constants by the whitened works
    """
    ends = np.cumsum([system.works.size for system in systems])[:-1]
    by_noise, by_bias = np.zeros((2, len(solver), len(solver)))
    for system, whitener, part, own in zip(systems, whiteners, np.split(solver, ends, axis=1), noise, strict=True):
        by_work = np.einsum("psf,sfg->spg", part.reshape(-1, *system.works.shape), whitener)
        by_noise += system.covariance(by_work, own)
        by_bias += system.covariance_by_bias(by_work, own)
    return by_noise, by_bias


def _by_section(systems: Sequence[_System]) -> list[list[Array]]:
    """Changes of the residuals of all sheets by the thickness, which they share, and by the width of each."""
    works = [system.works * system.sheet.forces[:, None] for system in systems]
    found = [[work * system.sheet.u_thickness for work, system in zip(works, systems, strict=True)]]
    for system, own in zip(systems, works, strict=True):
        found.append([own * system.sheet.u_width if work is own else np.zeros_like(work) for work in works])
    return found


def _variance(squares: float, freedom: int, is_known: bool) -> float:
    """Variance of weighted residuals by their sum of squares; 1 where the known noise explains them."""
    return 1.0 if is_known and squares <= chi2.ppf(0.95, freedom) else squares / freedom


def _all(whiteners: Sequence[Array], parts: Sequence[Array]) -> Array:
    """Parts of all sheets, (step, field) or (step, field, p), in units of their noise, one under the other."""
    found = [(whitener @ part.reshape(*part.shape[:2], -1)) for whitener, part in zip(whiteners, parts, strict=True)]
    flat = np.concatenate([one.reshape(-1, one.shape[-1]) for one in found])
    return flat if parts[0].ndim == 3 else flat[:, 0]


def _between(places: Array, width: float) -> Array:
    """Middles of bumps along one axis, from below the least place to above the largest."""
    least, most = places.min() - _REACH * width, places.max() + _REACH * width
    return np.linspace(least, most, math.ceil((most - least) / (_APART * width)) + 1)


class _System:
    """The equations of one sheet: a virtual work for each step and field."""

    def __init__(self, sheet: Sheet, fields: Sequence[VirtualField]) -> None:
        self.sheet = sheet
        self.gradients = np.stack([field.gradient for field in fields])
        self.works = np.tile([field.work for field in fields], (len(sheet.forces), 1))

    @property
    def is_noisy(self) -> bool:
        """Whether the noise of the gradients is known."""
        return bool(np.all(np.asarray(self.sheet.u_gradient) > 0.0))

    def residuals(self, model: Model, c: Array) -> Array:
        """Work of the stresses less that of the forces, (step, field) [N]."""
        work = self._work(sheet_stress(model, c, self.sheet.gradients)[:, :, None])
        return np.asarray(work[..., 0] - self.works * self.sheet.forces[:, None])

    def slopes(self, model: Model, c: Array) -> Array:
        """Changes of the residuals by the constants, (step, field, p)."""
        return self._work(sheet_stress_by_constants(model, c, self.sheet.gradients))

    def whitener(self, noise: Array) -> Array:
        """Matrices (step, field, field) that make the errors of the residuals of one step independent and 1."""
        steps, count = self.works.shape
        if not self.is_noisy:
            return np.broadcast_to(np.eye(count), (steps, count, count))
        u = np.hypot(self._u_gradient, self.sheet.u_bias)
        by_field, by_force = noise * u[:, None, None], self.sheet.u_force * self.works[..., None]
        values, vectors = np.linalg.eigh(by_field @ by_field.swapaxes(1, 2) + by_force @ by_force.swapaxes(1, 2))
        values = np.maximum(values, _LEAST_VARIANCE * values[:, -1:])
        return np.asarray(vectors.swapaxes(1, 2) / np.sqrt(values)[..., None])

    def covariance(self, by_work: Array, noise: Array) -> Array:
        """Covariance (p, p) by noise of what has derivatives (step, p, field) by the works.

        The noise of the first photograph is in all steps: it is that of the step with the least noise, in which both
        photographs count alike.
        """
        if not self.is_noisy:
            return np.asarray(np.einsum("spf,sqf->pq", by_work, by_work))
        by_field, by_force = by_work @ noise, self.sheet.u_force * (by_work @ self.works[..., None])[..., 0]
        first = float(self._u_gradient.min()) / np.sqrt(2.0)
        own = np.sqrt(self._u_gradient**2 - first**2)[:, None, None] * by_field
        common = first * by_field.sum(axis=0)
        return np.asarray(np.einsum("spm,sqm->pq", own, own) + common @ common.T + by_force.T @ by_force)

    def covariance_by_bias(self, by_work: Array, noise: Array) -> Array:
        """The same (p, p) by a bias of the gradients, which varies over the sheet as noise does, alike in all steps."""
        shift = np.einsum("s,spf,sfm->pm", np.broadcast_to(self.sheet.u_bias, len(self.works)), by_work, noise)
        return np.asarray(shift @ shift.T)

    @property
    def _u_gradient(self) -> Array:
        return np.broadcast_to(self.sheet.u_gradient, len(self.works))

    def by_noise(self, model: Model, c: Array) -> Array:
        """Changes of the works by bumps of noise, (step, field, m); the gradients have the standard deviation 1."""
        sheet, changes = self.sheet, sheet_stress_by_gradient(model, c, self.sheet.gradients)
        weights = sheet.thickness * sheet.areas[:, None, None]
        parts = np.einsum("snijkl,fnij->sfknl", changes, weights * self.gradients, optimize=True)
        if sheet.shared > 1.0:
            by_place = parts if sheet.slopes is None else np.einsum("sfknl,nml->sfknm", parts, sheet.slopes)
            parts = np.stack([self._of_bumps(part) for part in by_place])
        return np.asarray(parts.reshape(*self.works.shape, -1))

    def _of_bumps(self, part: Array) -> Array:
        """Sums of vectors (..., n, 2) times the gradients of bumps at the points, (..., row, col)."""
        (x, slope_x), (y, slope_y) = self._bumps
        along_x = np.swapaxes(part[..., :1] * y, -1, -2) @ slope_x
        return np.asarray(along_x + np.swapaxes(part[..., 1:] * slope_y, -1, -2) @ x)

    @cached_property
    def _bumps(self) -> list[tuple[Array, Array]]:
        """Factors of the bumps along both axes and their slopes, (n, m) each; all slopes have the mean square 1."""
        width, found = self.sheet.noise_width, []
        for places in self.sheet.places.T:
            away = (places[:, None] - _between(places, width)) / width
            values = np.exp(-0.5 * away**2)
            values /= np.sqrt((values**2).sum(axis=1).mean())
            slopes = away * values
            found.append((values, slopes / np.sqrt((slopes**2).sum(axis=1).mean())))
        return found

    def _work(self, stress: Array) -> Array:
        """Virtual work of stresses (step, n, p, 2, 2), (step, field, p)."""
        parts = [np.einsum("n,snpij,nij->sp", self.sheet.areas, stress, gradient) for gradient in self.gradients]
        return np.asarray(self.sheet.thickness * np.stack(parts, axis=1))
