"""Correlation of subsets: where a square of the reference photograph lies in a target, to the noise limit.

Inverse compositional Gauss-Newton (Baker and Matthews, Int. J. Computer Vision 56, 2004; Pan, Li and Tong,
Experimental Mechanics 53, 2013) on the zero-mean normalised sum of squared differences

    ZNSSD = Σ w (f̂ − ĝ)²,   f̂ = (f − f̄)/Δf,   Δf² = Σ w (f − f̄)²,

over the warp of the subset. The parts of the derivatives that a change of brightness or contrast explains are
subtracted, so that the Hessian H is that of the criterion itself, and the covariance of the warp is 2 σ² H⁻¹ for noise
of σ grey levels in both photographs (Pan et al., Optics Express 16, 2008).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Codes, Image, Index, Iterations, Mask
from dicflow.core.correlation.gauss_newton import (
    Control,
    NormalEquations,
    covariance,
    iterate,
    mean_square_slope,
    prepare,
)
from dicflow.core.correlation.lattice_sums import NO_SUMS, LatticeSums, index_of_sums, lattice_sums, sum_count
from dicflow.core.correlation.residuals import Residuals, new_residuals
from dicflow.core.correlation.subset_sums import Pixels
from dicflow.core.correlation.template import (
    CLEAR_MARGIN_PX,
    Template,
    copy_square,
    count_rows,
    gather_part,
    is_whole,
    keep_measured,
    kernel_mask,
    lay_out,
    shows_measured,
)
from dicflow.core.correlation.warp import TERMS, identity
from dicflow.core.correlation.working_space import Work, working_space
from dicflow.core.kernels import INNER, KERNEL
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.status import Status
from dicflow.core.threads import over

__all__ = ["Correlated", "OwnSubsets", "Subset", "correlate", "describe", "pixel_weights", "residuals", "with_sums"]


_CHUNK = 512
"""Subsets that a thread takes at once."""
_MIN_MEASURED_SHARE = 0.25
"""Share of the square's pixels that must be measured in both photographs."""
_MAX_SELECTIONS, _MAX_SHIFT_PX = 4, 0.1
"""How often the pixels that are measured in the target are selected, and the shift of the place up to which they stay
as they are [px]."""
_NO_COEFFICIENTS = np.zeros((0, 0), dtype=np.float32)
_VALID, _LOW_TEXTURE, _NOT_CONVERGED = int(Status.VALID), int(Status.LOW_TEXTURE), int(Status.NOT_CONVERGED)
_CUT_SUBSET, _OVEREXPOSED = int(Status.CUT_SUBSET), int(Status.OVEREXPOSED)


class Subset(NamedTuple):
    """Size, weight and shape function of subsets, and when their search has converged.

    size : side of the square, odd [px]
    shape_function : "affine" or "quadratic"
    gaussian : standard deviation of the weight of pixels [px]; 0 for equal weights
    min_share : share of the square's pixels that must be usable
    iterations : maximum number
    tolerance_px : converged when the remaining correction, its RMS over the subset, is below this [px]; the arithmetic
        reaches some 1e-5
    """

    size: int = 31
    shape_function: str = "affine"
    gaussian: float = 0.0
    min_share: float = 0.5
    iterations: int = 30
    tolerance_px: float = 1e-3


DEFAULT_SUBSET = Subset()


class OwnSubsets(NamedTuple):
    """The subsets of a reference photograph: its template, and sums over the pixels of whole ones."""

    template: Template
    sums: LatticeSums


class Correlated(NamedTuple):
    """Results of correlation at n points.

    warp : (n, 2, 3 or 6) float64 — of the subset in the target (:mod:`dicflow.core.correlation.warp`); NaN where not
        found
    znssd : (n,) float64 — 0 for a perfect fit, 2 for unrelated patterns, 4 for the negative; NaN where not compared
    iterations : (n,) int16
    status : (n,) uint8 — VALID, or the reason why not found
    covariance : (n, 3) float64 — xx, xy and yy of the centre's place in the target for noise of one grey level in both
        photographs [px² per grey level²]; half of it comes from each
    contraction : (n,) float64 — the last increment over the one before; NaN after a single iteration
    texture : (n, 2) float64 — variance of the template's grey levels [grey levels²], and mean square of their slope
        as far as brightness and contrast do not explain it [grey levels² per px²]; NaN where not found
    """

    warp: Array
    znssd: Array
    iterations: Iterations
    status: Codes
    covariance: Array
    contraction: Array
    texture: Array


def correlate(
    reference: Template,
    target: Spline,
    centres: Array,
    start: Array,
    subset: Subset = DEFAULT_SUBSET,
    threads: int = 1,
    contraction: float = 1.0,
    sums: LatticeSums = NO_SUMS,
) -> Correlated:
    """Find subsets of a reference photograph in a target.

    centres : (n, 2) — whole pixels of the reference photograph
    start : (n, 2, 3 or 6) — warps to start from, right to a few pixels; a NaN leaves the point UNTRACKED
    threads : how many share the points; the result does not depend on it
    contraction : expected ratio of the second increment to the first, from similar points; after a good start the
        search then ends without a second one. 1 where it is unknown.
    sums : of :func:`with_sums`, of the same template and subsets

    Raises ValueError for an even subset size, one below 5 px, and starts or sums that do not fit the subsets.
    """
    _check(subset, sums)
    needed = (len(centres), 2, TERMS[subset.shape_function])
    if start.shape != needed:
        raise ValueError(
            f"starts have the shape {start.shape}; {len(centres)} {subset.shape_function} warps need {needed}"
        )
    found, photograph = _unsearched(start, Status.UNTRACKED), (target.coefficients, kernel_mask(target.measured))
    control = _control(subset, target.degree, contraction)
    _complete(found, (reference, sums), photograph, centres, start, pixel_weights(subset), control, threads)
    return found


def describe(
    reference: Template,
    measured: Mask | None,
    centres: Array,
    subset: Subset = DEFAULT_SUBSET,
    threads: int = 1,
    sums: LatticeSums = NO_SUMS,
) -> Correlated:
    """Subsets of a photograph found in itself: what :func:`correlate` gives, without a search and its rounding.

    measured : (rows, cols) bool — pixels of the photograph that are measured; None for all
    centres, threads, sums : as there

    Raises ValueError for an even subset size, one below 5 px, and sums that do not fit the subsets.
    """
    _check(subset, sums)
    start = identity(centres, subset.shape_function)  # type: ignore[arg-type]
    found, target = _unsearched(start, Status.VALID), (_NO_COEFFICIENTS, kernel_mask(measured))
    control = _control(subset, 0, 1.0)
    _complete(found, (reference, sums), target, centres, start, pixel_weights(subset), control, threads)
    found.znssd[found.status == Status.VALID] = 0.0
    return found


def with_sums(reference: Template, grid: Array, subset: Subset, threads: int = 1) -> OwnSubsets:
    """The subsets of a reference photograph around whole pixels, ready for searches.

    grid : (rows, cols, 2) — centres, whole pixels of the reference photograph; NaN for none
    threads : how many share the work; the result does not depend on it
    """
    images = reference.grey, reference.by_x, reference.by_y
    return OwnSubsets(reference, lattice_sums(images, grid, _weights_along_side(subset), _degree(subset), threads))


def residuals(reference: Template, target: Spline, centres: Index, warp: Array, subset: Subset) -> Residuals:
    """Residuals of subsets that were found.

    centres : (n, 2) — whole pixels of the template; warp : (n, 2, 3 or 6)
    """
    found, photograph = _unsearched(warp, Status.VALID), (target.coefficients, kernel_mask(target.measured))
    rest = new_residuals(len(centres), subset.size, TERMS[subset.shape_function])
    any_pixels = _control(subset, target.degree, 1.0)._replace(min_share=0.0, min_pixels=1)
    warp = np.ascontiguousarray(warp)
    _correlate((reference, NO_SUMS), photograph, centres, warp, pixel_weights(subset), any_pixels, found, rest)
    return rest


def _complete(
    found: Correlated,
    reference: tuple[Template, LatticeSums],
    target: tuple[Image, Mask],
    centres: Array,
    start: Array,
    weight: Image,
    control: Control,
    threads: int,
) -> None:
    """Let so many threads do :func:`_correlate`, each for some subsets at a time."""
    whole_pixels, no_rest = centres.astype(np.int64), new_residuals(0, len(weight), start.shape[-1])

    def correlate_chunk(chunk: slice) -> None:
        results = Correlated._make(field[chunk] for field in found)
        _correlate(reference, target, whole_pixels[chunk], start[chunk], weight, control, results, no_rest)

    over(threads, correlate_chunk, (slice(first, first + _CHUNK) for first in range(0, len(centres), _CHUNK)))


def _check(subset: Subset, sums: LatticeSums) -> None:
    if subset.size % 2 == 0 or subset.size < 5:
        raise ValueError(f"a subset's side must be an odd number of at least 5 px, got {subset.size}")
    count, weight = sum_count(_degree(subset)), _weights_along_side(subset)
    if len(sums.values) and not (sums.values.shape[1] == count and np.array_equal(sums.weight, weight)):
        raise ValueError("the sums are those of subsets of another size, weight or shape function")


def _degree(subset: Subset) -> int:
    """Of the shape function."""
    return 1 if subset.shape_function == "affine" else 2


def _control(subset: Subset, degree: int, contraction: float) -> Control:
    return Control(
        degree,
        subset.size // 2,
        subset.min_share,
        4 * TERMS[subset.shape_function],
        subset.iterations,
        float(subset.tolerance_px),
        subset.gaussian > 0.0,
        contraction,
    )


def _unsearched(start: Array, status: Status) -> Correlated:
    """Subsets of which nothing is known but a status."""
    n = len(start)
    return Correlated(
        np.full(start.shape, np.nan),
        np.full(n, np.nan),
        np.zeros(n, dtype=np.int16),
        np.full(n, status, dtype=np.uint8),
        np.full((n, 3), np.nan),
        np.full(n, np.nan),
        np.full((n, 2), np.nan),
    )


def pixel_weights(subset: Subset) -> Image:
    """Weight of each pixel of a whole subset (size, size)."""
    along = _weights_along_side(subset)
    return np.outer(along, along).astype(np.float32)


def _weights_along_side(subset: Subset) -> Array:
    """Weights (size,) along one side; that of a pixel is the product of its column's and its row's."""
    if subset.gaussian <= 0.0:
        return np.ones(subset.size)
    offset = np.arange(subset.size) - subset.size // 2
    return np.asarray(np.exp(-0.5 * (offset / subset.gaussian) ** 2))


@njit(error_model="numpy", **KERNEL)
def _correlate(
    reference: tuple[Template, LatticeSums],
    target: tuple[Image, Mask],
    centres: Index,
    start: Array,
    weight: Image,
    control: Control,
    found: Correlated,
    rest: Residuals,
) -> None:
    """The loop of :func:`correlate`, :func:`describe` and :func:`residuals` over points, which share a working space.

    reference : template of the reference photograph, and sums over its whole subsets
    target : coefficients of its spline, and its measured pixels (rows, cols); an empty mask if all are
    found : subsets that are VALID already are not searched for, they lie where they start
    rest : set instead of anything else, where it has room

    The warp decides which pixels are measured in the target too. They are selected again until the place settles.
    """
    (template, sums), (coefficients, measured) = reference, target
    work, is_compared = working_space(weight, start.shape[2]), len(rest.f) > 0
    p, normal, c = work.pixels, work.normal, work.warp
    for k in range(len(centres)):
        if not _copy_known(start, k, c):
            continue
        row, col = centres[k, 1], centres[k, 0]
        is_found, settled = found.status[k] == _VALID, False
        for _ in range(_MAX_SELECTIONS):
            x, y = c[0, 0], c[1, 0]
            is_clear = measured.size == 0 or shows_measured(measured, c, len(weight) // 2)
            n, found.status[k] = _collect(template, measured, is_clear, (row, col), weight, control, work)
            if n == 0:
                break
            at = index_of_sums(sums, row, col) if n == weight.size else -1
            if not is_compared and not prepare(p, n, work.ones_like_f, (sums, at), normal):
                found.status[k] = _LOW_TEXTURE
                break
            if is_compared or not is_found:
                found.status[k], found.iterations[k], found.znssd[k], found.contraction[k] = iterate(
                    coefficients, p, n, normal, control, work.places, c, (rest, k)
                )
            shift = abs(c[0, 0] - x) + abs(c[1, 0] - y)
            settled = measured.size == 0 or shift < (CLEAR_MARGIN_PX if is_clear else _MAX_SHIFT_PX)
            if settled or found.status[k] != _VALID:
                break
        if found.status[k] == _VALID and not settled:
            found.status[k] = _NOT_CONVERGED
        if found.status[k] == _VALID and not is_compared:
            _set_found(p, n, work.ones_like_f, normal, control, c, found, k)


@njit(error_model="numpy", **INNER)
def _copy_known(start: Array, k: int, warp: Array) -> bool:
    """Copy the coefficients of the k-th warp, with zeros for those that it lacks; False where one is not finite."""
    for i in range(2):
        for j in range(warp.shape[1]):
            warp[i, j] = start[k, i, j] if j < start.shape[2] else 0.0
            if not np.isfinite(warp[i, j]):
                return False
    return True


@njit(error_model="numpy", **INNER)
def _collect(
    reference: Template,
    measured: Mask,
    is_clear: bool,
    centre: tuple[int, int],
    weight: Image,
    control: Control,
    work: Work,
) -> tuple[int, int]:
    """Collect the pixels of the subset around (row, column): their number, and its status.

    is_clear : whether all pixels around it in the target are measured
    Without any pixel the status says why.
    """
    (row, col), size, p = centre, len(weight), work.pixels
    if not (is_clear and is_whole(reference.unusable, row, col, size // 2)):
        work.collected[0], status = _select(reference, measured, centre, weight, control, work)
        return work.collected[0], status
    if work.collected[0] < weight.size:
        lay_out(weight, p)
        work.collected[0] = weight.size
    copy_square(reference.grey, row, col, size, p.f)
    copy_square(reference.by_x, row, col, size, p.fx)
    copy_square(reference.by_y, row, col, size, p.fy)
    return weight.size, _VALID


@njit(error_model="numpy", **INNER)
def _select(
    reference: Template, measured: Mask, centre: tuple[int, int], weight: Image, control: Control, work: Work
) -> tuple[int, int]:
    """Collect the pixels of a cut subset around (row, column); returns their number, and why they are too few, if 0."""
    p, room, half, least = work.pixels, weight.size, len(weight) // 2, control.min_pixels
    n, in_part = gather_part(reference, centre[0], centre[1], weight, p, work.marks)
    if in_part < control.min_share * room or in_part < least:
        return 0, _CUT_SUBSET
    if measured.size > 0:
        n = keep_measured(p, n, work.warp, half, measured)
    if n < min(control.min_share, _MIN_MEASURED_SHARE) * room or n < least:
        return 0, _OVEREXPOSED
    count_rows(p, n, half)
    return n, _VALID


@njit(error_model="numpy", **INNER)
def _set_found(
    p: Pixels,
    n: int,
    ones_like_f: Image,
    normal: NormalEquations,
    control: Control,
    c: Array,
    found: Correlated,
    k: int,
) -> None:
    """Set the warp c (2, 6) of the k-th subset, its texture, and the covariance of its place."""
    for i in range(2):
        for j in range(found.warp.shape[2]):
            found.warp[k, i, j] = c[i, j]
    found.texture[k, 0] = normal.statistics[2] / normal.statistics[1]
    found.texture[k, 1] = mean_square_slope(normal)
    covariance(p, n, ones_like_f, normal, control.is_weighted, c, found.covariance[k])
