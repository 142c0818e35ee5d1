"""Points in space, with what is uncertain about them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from dicflow.engine.node import At, Node, Port, Scope
from dicflow.engine.product import Product, Variable

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.triangulate import Triangulated

__all__ = ["Triangulate"]

_GRID = ("row", "col")


class Errors(NamedTuple):
    """Errors of the points of one step.

    own : (row, col, 3, 3) — covariance from all but the first template's noise [mm²]
    left : (row, col, 3, 3) — the part of it that the subsets in the left photographs bring [mm²]
    sensitivity : (row, col, 3, 2) — by how much a point moves per error of the first template [mm/px]
    template : (row, col, 3) — covariance of this error, xx, xy, yy [px²]

    Where the shape functions left and right differ the template has two such errors: (row, col, 3, 4) and
    (row, col, 10), the upper triangle of the covariance of both.
    """

    own: np.ndarray
    left: np.ndarray
    sensitivity: np.ndarray
    template: np.ndarray


class Triangulate(Node):
    """The points that best explain both photographs, with covariance and the reason where there is none.

    Both places go back to one template, so its noise moves a point along the surface alike in both; the noise of the
    photographs themselves moves it in depth too. ``way`` and ``way_right`` say by which way the left and the right
    place were found, directly from the first photographs or through others.
    """

    title: ClassVar = "triangulate"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "correlation": Port("correlation"),
        "correlation_first": Port("correlation", at=At.FIRST),
        "stereo": Port("stereo"),
        "rig": Port("rig"),
    }
    gives: ClassVar = "points"
    impl_version: ClassVar = 4

    stage: Literal["triangulate"] = "triangulate"

    def run(self, correlation: Product, correlation_first: Product, stereo: Product, rig: Product) -> Product:
        """``correlation_first`` is that of the first step."""
        import numpy as np

        from dicflow.core.cameras.triangulate import triangulate
        from dicflow.kinds.rig import rig_from_json
        from dicflow.stages.stereo import check_size

        cameras = rig_from_json(rig.attrs["rig"])
        check_size("left", cameras.left.size, correlation.attrs["image_size"])
        first = (correlation["way"] == 0)[..., None]
        left = np.where(first, correlation["template"], correlation["covariance"])
        found = triangulate(cameras, correlation["xy"], stereo["xy"], left, stereo["covariance"])
        errors = _errors(found, correlation, stereo)
        inside = np.isfinite(correlation_first["xy"]).all(axis=-1)
        return _product(found, errors, correlation, stereo, inside)


def _errors(found: Triangulated, correlation: Product, stereo: Product) -> Errors:
    """What the errors in both photographs do to the points.

    At the first step the left place is the point itself, without error. Where both places were chained through one
    later reference, the error of the way there is common to both photographs, as they are correlated with one template.

    A richer shape function in the right photograph feels the template's noise more. Since the other one's estimate is
    efficient, what is added is independent of it: a second error of the template, which only the right place has.
    """
    import numpy as np

    from dicflow.core.cameras.triangulate import point_covariance
    from dicflow.core.tensors import congruent, inverse

    by_left, by_right = found.by_left @ correlation["gradient"], found.by_right @ stereo["gradient"]
    right = congruent(inverse(stereo["gradient"]), stereo["covariance"])
    left = congruent(inverse(correlation["gradient"]), correlation["covariance"])
    first = (correlation["way"] == 0)[..., None]
    chained = ((stereo["way"] > 1) & (stereo.attrs["match"] == "every_step"))[..., None]
    common = np.where(chained, congruent(inverse(correlation["gradient"]), correlation["passed"]), 0.0)
    ratio = _variance(correlation["template"]) / _variance(stereo["template"]) if _differ(correlation, stereo) else 1.0
    shares = (
        (by_left, left - common),
        (by_right, np.where(chained, 2.0 - ratio, 1.0) * right),
        (by_left + by_right, common),
    )
    by_place, by_other, by_both = (point_covariance(slopes, covariance) for slopes, covariance in shares)
    own, alone = by_place + by_other + by_both, by_place + by_both
    sensitivity = np.where(first[..., None], by_right, by_left + by_right)
    if not _differ(correlation, stereo):
        return Errors(own, alone, sensitivity, correlation["template"])
    added = np.where(chained[..., None], 0.0, by_right)
    return Errors(own, alone, np.concatenate([sensitivity, added], axis=-1), _two_errors(correlation, stereo))


def _differ(correlation: Product, stereo: Product) -> bool:
    """Whether the shape functions left and right do."""
    return bool(correlation.attrs["shape_function"] != stereo.attrs["shape_function"])


def _variance(covariance: np.ndarray) -> Any:
    """Sum of both variances (row, col, 1) of covariances (row, col, 3)."""
    return covariance[..., :1] + covariance[..., 2:]


def _two_errors(correlation: Product, stereo: Product) -> np.ndarray:
    """Covariance (row, col, 10) of the template's error and of what the right shape function adds to it [px²]."""
    import numpy as np

    from dicflow.core.tensors import symmetric, upper

    template = correlation["template"]
    both = np.zeros((*template.shape[:2], 4, 4))
    both[..., :2, :2] = symmetric(template)
    both[..., 2:, 2:] = symmetric(_positive(stereo["template"] - template))
    return upper(both)


def _positive(covariance: np.ndarray) -> np.ndarray:
    """The nearest covariances (row, col, 3): without negative variances."""
    import numpy as np

    from dicflow.core.tensors import symmetric, upper

    known = np.isfinite(covariance).all(axis=-1)
    nearest = np.full(covariance.shape, np.nan)
    values, axes = np.linalg.eigh(symmetric(covariance[known]))
    nearest[known] = upper((axes * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2))
    return nearest


def _product(found: Triangulated, errors: Errors, correlation: Product, stereo: Product, inside: np.ndarray) -> Product:
    """inside : (row, col) — the points of the region at the first step"""
    import numpy as np

    from dicflow.core.status import Status
    from dicflow.core.tensors import upper

    status = np.maximum(correlation["status"], stereo["status"])
    status[(status <= Status.FILLED) & ~np.isfinite(found.xyz).all(axis=-1)] = Status.EPIPOLAR
    kept = status <= Status.FILLED
    pixel, single = (*_GRID, "image_component"), np.float32
    variables = {
        "xyz": Variable((*_GRID, "component"), found.xyz, "mm", "position"),
        "xy": Variable(pixel, correlation["xy"], "px", "place in the left photograph"),
        "xy_right": Variable(pixel, stereo["xy"], "px", "place in the right photograph"),
        "covariance": Variable((*_GRID, "pair"), upper(errors.own), "mm²", "covariance XX, XY, XZ, YY, YZ, ZZ"),
        "covariance_left": Variable(
            (*_GRID, "pair"), upper(errors.left), "mm²", "share of the left photographs in the covariance"
        ),
        "sensitivity": Variable(
            (*_GRID, "component", "error"), errors.sensitivity, "mm/px", "motion per error of the template"
        ),
        "reprojection": Variable(_GRID, found.reprojection.astype(single), "px", "reprojection error"),
    }
    variables = {name: part._replace(values=_where(kept, part.values)) for name, part in variables.items()}
    worse = np.fmax(correlation["znssd"], stereo["znssd"])
    variables |= {
        "epipolar": stereo.variables["epipolar"],
        "template": Variable(
            (*_GRID, "error_pair"), errors.template, "px²", "covariance of the first template's error"
        ),
        "znssd": Variable(_GRID, worse.astype(single), "1", "misfit of the grey levels (ZNSSD), the worse of both"),
        "way": correlation.variables["way"],
        "way_right": stereo.variables["way"],
        "status": Variable(_GRID, status, "1", "why a point has a place, or has none"),
    }
    facts = {name: correlation.attrs[name] for name in ("step_size", "subset_size", "image_size", "noise_grey")}
    reasons = _reasons(status[inside])
    summary = {"points": int(inside.sum()), "valid_share": reasons.get("valid", 0.0), **_figures(variables, kept)}
    attrs = {
        **facts,
        "shape_function": stereo.attrs["shape_function"],
        "shape_function_left": correlation.attrs["shape_function"],
        "reasons": reasons,
        "text": _sentence(reasons, int(inside.sum())),
        "summary": summary,
    }
    return Product("points", variables, attrs)


def _where(kept: np.ndarray, values: np.ndarray) -> np.ndarray:
    """NaN where a point does not count."""
    import numpy as np

    return np.where(kept.reshape(kept.shape + (1,) * (values.ndim - 2)), values, np.nan)


def _reasons(status: np.ndarray) -> dict[str, float]:
    """Share of the region's points by what became of them, most first; none where there is no point."""
    import numpy as np

    from dicflow.core.status import Status

    codes, counts = np.unique(np.where(status == Status.FILLED, Status.VALID, status), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return {Status(int(codes[i])).label: float(counts[i] / status.size) for i in order}


def _sentence(reasons: dict[str, float], points: int) -> str:
    """``98.2 % of 12,400 points; 1.1 % epipolar, 0.7 % hidden``."""
    lost = ", ".join(f"{100.0 * share:.1f} % {label}" for label, share in reasons.items() if label != "valid")
    measured = f"{100.0 * reasons.get('valid', 0.0):.1f} % of {points:,} points"
    return f"{measured}; {lost}" if lost else measured


def _figures(variables: dict[str, Variable], kept: np.ndarray) -> dict[str, float]:
    """Root mean squares of the residuals and medians of σ over the measured points; none without any."""
    import numpy as np

    if not kept.any():
        return {}
    residuals = {f"{name}_px": variables[name].values[kept] for name in ("epipolar", "reprojection")}
    variances = np.median(variables["covariance"].values[kept][:, [0, 3, 5]], axis=0)
    return {
        **{name: float(np.sqrt(np.mean(values**2))) for name, values in residuals.items()},
        **{f"sigma_{axis}_mm": float(np.sqrt(value)) for axis, value in zip("XYZ", variances, strict=True)},
    }
