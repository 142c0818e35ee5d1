"""The kernels that stages use, each compiled by one call on a few pixels with arrays of the types that stages have.

Numba compiles a kernel at its first call and keeps it. A file beside the kept kernels then says so, so that a run knows
without loading numba what it has to compile before its first tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from dicflow.engine.kernel_cache import kernel_mark
from dicflow.engine.node import Node

__all__ = ["KERNELS", "ahead", "compile_kernels", "get_ready", "uncompiled"]

_SIDE = 48
"""Side of the photograph that kernels are tried on [px]."""


def get_ready() -> None:
    """Load what nearly all stages use, with one thread per worker: other workers use the other cores."""
    import cv2

    cv2.setNumThreads(1)


def uncompiled(nodes: Mapping[str, Node]) -> dict[str, dict[str, Callable[[], None]]]:
    """Calls that compile the kernels of each stage by name, where these are not kept yet; empty without a place."""
    missing = {name: [kernel for kernel in _used(node) if _is_missing(kernel)] for name, node in nodes.items()}
    return {
        name: {kernel: partial(compile_kernels, [kernel]) for kernel in kernels}
        for name, kernels in missing.items()
        if kernels
    }


def ahead(nodes: Mapping[str, Node]) -> list[Callable[[], None]]:
    """What loads the kernels of stages, of those that are kept."""
    used = dict.fromkeys(kernel for node in nodes.values() for kernel in _used(node))
    return [KERNELS[kernel] for kernel in used if not _is_missing(kernel)]


def compile_kernels(names: Sequence[str]) -> None:
    """Compile those of some of :data:`KERNELS` that are not kept yet, and note that they are."""
    for name in names:
        mark = kernel_mark(name)
        if mark is not None and mark.exists():
            continue
        KERNELS[name]()
        if mark is not None:
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()


def _is_missing(name: str) -> bool:
    mark = kernel_mark(name)
    return mark is not None and not mark.exists()


def _used(node: Node) -> Sequence[str]:
    """Names of the kernels that a stage surely uses."""
    found: Sequence[str] = getattr(node, "kernels", None) or _USED.get(node.stage, ())
    return found


def _search() -> None:
    """A subset of a photograph, found in itself, with its residual."""
    import numpy as np

    from dicflow.core.correlation.subsets import Subset, correlate, residuals
    from dicflow.core.correlation.template import template
    from dicflow.core.correlation.warp import identity
    from dicflow.core.photographs.interpolate import spline

    photograph = spline(np.random.default_rng(0).integers(0, 255, (_SIDE, _SIDE)).astype(np.uint8))
    reference, centre = template(photograph), np.full((1, 2), 24.0)
    correlate(reference, photograph, centre, identity(centre), Subset(11))
    residuals(reference, photograph, centre.astype(np.int64), identity(centre), Subset(11))


def _sums() -> None:
    """Sums over squares around four points."""
    import numpy as np

    from dicflow.core.correlation.lattice_sums import NO_SUMS, lattice_sums

    image = np.zeros((_SIDE, _SIDE), dtype=np.float32)
    assert lattice_sums((image, image, image), _grid(), np.ones(31), 1) is not NO_SUMS


def _neighbours() -> None:
    """What four subsets that were found say of each other."""
    import numpy as np

    from dicflow.core.correlation.jumps import predicted_by_sides
    from dicflow.core.correlation.neighbours import mean_of_neighbours, predicted_by_neighbours
    from dicflow.core.correlation.warp import identity
    from dicflow.core.parts import single_part

    grid, status = _grid(), np.zeros((2, 2), dtype=np.uint8)
    one, found = np.zeros((1, 2), dtype=np.int64), (status, identity(grid), grid, single_part(grid))
    mean_of_neighbours(one, *found, np.zeros((2, 2)), 1)
    predicted_by_neighbours(one, *found)
    predicted_by_sides(one, *found, 1)


def _grid() -> Any:
    """Centres (2, 2, 2) of four subsets in a photograph."""
    import numpy as np

    return np.stack(np.meshgrid([20.0, 28.0], [20.0, 28.0]), axis=-1)


def _judgement() -> None:
    """Residuals of four subsets, a photograph at their centres, and two motions of these."""
    import numpy as np

    from dicflow.core.correlation.chain import chained
    from dicflow.core.correlation.light import light_shift
    from dicflow.core.correlation.residuals import new_residuals
    from dicflow.core.correlation.uneven import uneven_variance
    from dicflow.core.correlation.warp import identity
    from dicflow.core.photographs.interpolate import interpolate, spline

    fit = new_residuals(4, 11, 3)
    uneven_variance(fit, 11)
    light_shift(fit, np.ones(4, dtype=bool), 11)
    photograph = spline(np.random.default_rng(0).integers(0, 255, (_SIDE, _SIDE)).astype(np.uint8))
    interpolate(photograph, _grid())
    chained(identity(_grid()), identity(_grid()), _grid())


def _motion() -> None:
    import numpy as np

    from dicflow.core.matching.pairs import local_motion

    places = np.random.default_rng(0).uniform(0.0, _SIDE, (20, 2))
    local_motion(places, places, places)


def _refinement() -> None:
    import numpy as np

    from dicflow.core.matching.refine import refinable, refine_matches

    photograph = np.random.default_rng(0).integers(0, 255, (_SIDE, _SIDE)).astype(np.uint8)
    images = refinable(photograph, photograph)
    refine_matches(images, np.full((1, 2), 24.0), np.full((1, 2), 24.0), np.eye(2)[None])


def _polynomials() -> None:
    import numpy as np

    from dicflow.core.surfaces.filters import local_polynomial

    local_polynomial(np.zeros((5, 5, 1)), (3, 3), 1)


def _strain() -> None:
    import numpy as np

    from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
    from dicflow.core.strain.degree_choice import candidate_fits, chosen_gradient
    from dicflow.core.uncertainty.overlap import overlap

    row, col = np.mgrid[:5, :5].astype(float)
    plane = np.stack([col, row, 0.0 * row], axis=-1)
    errors = [ErrorShare(np.broadcast_to(np.eye(6), (5, 5, 6, 6)), overlap(11, 5.0))]
    chosen_gradient(measured_surface(plane, plane, errors), candidate_fits((3, 3), 1))


def _disparity() -> None:
    import numpy as np

    from dicflow.core.matching.subpixel import refine_disparity

    photograph = np.random.default_rng(0).uniform(0.0, 255.0, (_SIDE, _SIDE)).astype(np.float32)
    refine_disparity(photograph, photograph, np.zeros((_SIDE, _SIDE), dtype=np.float32))


KERNELS: Mapping[str, Callable[[], None]] = {
    "search": _search,
    "sums": _sums,
    "judgement": _judgement,
    "neighbours": _neighbours,
    "refinement": _refinement,
    "polynomials": _polynomials,
    "strain": _strain,
    "motion": _motion,
    "disparity": _disparity,
}
"""Kernels by name, those that take longest to compile first."""
_USED: Mapping[str, Sequence[str]] = {
    "correlate": ("search", "sums", "judgement", "neighbours", "motion"),
    "stereo": ("search", "sums", "judgement", "neighbours", "motion"),
    "track": ("motion",),
    "disparity": ("disparity",),
    "displacement": ("polynomials",),
    "smooth": ("polynomials",),
    "strain": ("polynomials",),
    "deformation": ("polynomials", "strain"),
}
"""Stage → names of the kernels that it uses."""
