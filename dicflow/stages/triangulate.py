"""Points in space and their uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.node import At, Node, Port, Scope
from dicflow.engine.product import Product
from dicflow.kinds.correlation import Correlation
from dicflow.kinds.images import check_size
from dicflow.kinds.points import PointErrors, Points
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.stereo import Stereo

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Rig
    from dicflow.core.cameras.triangulate import Triangulated

__all__ = ["Triangulate", "sentence"]


class Triangulate(Node):
    """The points that best explain both photographs, with covariance and status.

    Both places are found with one template, whose noise moves a point along the surface; the noise of the photographs
    themselves moves it in depth too. Both photographs have the same weights at all steps, by the errors at the first
    one: where a rig does not fit exactly, the rays of a point miss each other, and the place between them must not
    depend on the noise of the step. ``way`` and ``way_right`` hold the routes by which the left and the right place
    were found: directly from the first photograph, or via a reference step.
    """

    title: ClassVar = "triangulate"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "correlation": Port("correlation"),
        "correlation_first": Port("correlation", at=At.FIRST),
        "stereo": Port("stereo"),
        "stereo_first": Port("stereo", at=At.FIRST),
        "rig": Port("rig"),
    }
    gives: ClassVar = "points"
    impl_version: ClassVar = 8

    stage: Literal["triangulate"] = "triangulate"

    def run(
        self,
        correlation: Product,
        correlation_first: Product,
        stereo: Product,
        stereo_first: Product,
        rig: Product,
    ) -> Product:
        """``correlation_first`` and ``stereo_first`` are those of the first step."""
        import numpy as np

        from dicflow.core.cameras.triangulate import triangulate
        from dicflow.core.status import Status

        left, right = Correlation.read(correlation), Stereo.read(stereo)
        cameras = CalibratedRig.read(rig).cameras
        check_size("left", cameras.left.size, left.image_size)
        weights = Correlation.read(correlation_first)["template"], Stereo.read(stereo_first)["covariance"]
        found = triangulate(cameras, left["xy"], right["xy"], *weights)
        status = np.maximum(left["status"], right["status"])
        status[(status <= Status.FILLED) & ~np.isfinite(found.xyz).all(axis=-1)] = Status.EPIPOLAR
        inside = np.isfinite(Correlation.read(correlation_first)["xy"]).all(axis=-1)
        errors = _errors(found, left, right, _common_misfit(cameras, left, right))
        return Points.write(found, errors, status, (left, right), _facts(found, errors, status, right, inside))


def _common_misfit(cameras: Rig, left: Correlation, right: Stereo) -> np.ndarray:
    """Covariance (row, col, 3) by misfit that is common to both photographs [px² of the first left photograph].

    The smaller misfit of both, along no direction more than either place has.
    """
    import numpy as np

    from dicflow.core.cameras.common_misfit import PlaceErrors, independent_share, shared_part
    from dicflow.core.tensors import congruent, inverse

    views = [(one["xy"], one["covariance"], one["misfit"].astype(float)) for one in (left, right)]
    share = independent_share(cameras, *(PlaceErrors(xy, total - misfit, misfit) for xy, total, misfit in views))
    of_left, of_right = (congruent(inverse(one["gradient"]), one["misfit"].astype(float)) for one in (left, right))
    smaller = np.where(_variance(of_left) < _variance(of_right), of_left, of_right)
    for one in (left, right):
        smaller = shared_part(smaller, congruent(inverse(one["gradient"]), one["covariance"]))
    return np.asarray((1.0 - share) * smaller)


def _errors(found: Triangulated, left: Correlation, right: Stereo, misfit: np.ndarray) -> PointErrors:
    """Errors of the points by those in both photographs.

    misfit : (row, col, 3) — covariance by it that is common to both [px² of the first left photograph]

    At the first step the left place is the point itself, without error. If both places were found via one reference
    step, its inherited covariance is common to both photographs, which are correlated with one template.

    A richer shape function than that of the first left photograph is more sensitive to the template's noise. Since the
    other one's estimate is efficient, the additional error is independent of it: a second error, of the places with
    that shape function.
    """
    import numpy as np

    from dicflow.core.cameras.triangulate import point_covariance
    from dicflow.core.tensors import congruent, inverse

    by_left, by_right = found.by_left @ left["gradient"], found.by_right @ right["gradient"]
    of_right = congruent(inverse(right["gradient"]), right["covariance"])
    of_left = congruent(inverse(left["gradient"]), left["covariance"])
    first = (left["way"] == 0)[..., None]
    chained = ((right["way"] > 1) & right.matched_at_every_step)[..., None]
    common = misfit + np.where(chained, congruent(inverse(left["gradient"]), left.inherited_covariance), 0.0)
    ratio = _variance(_own_template(left)) / _variance(right["template"]) if _differ(left, right) else 1.0
    shares = (
        (by_left, of_left - common),
        (by_right, np.where(chained, 2.0 - ratio, 1.0) * of_right - misfit),
        (by_left + by_right, common),
    )
    by_place, by_other, by_both = (point_covariance(slopes, covariance) for slopes, covariance in shares)
    own, alone = by_place + by_other + by_both, by_place + by_both
    sensitivity = np.where(first[..., None], by_right, by_left + by_right)
    bias = _bias(found, left, right)
    left_richer = left.shape_function != left.first_shape_function
    right_richer = right.grid.shape_function != left.first_shape_function
    if not (left_richer or right_richer):
        return PointErrors(own, alone, sensitivity, left["template"], bias)
    richer = _own_template(left) if left_richer else right["template"]
    added = left_richer * by_left + right_richer * by_right
    both = np.concatenate([sensitivity, np.where(chained[..., None], 0.0, added)], axis=-1)
    return PointErrors(own, alone, both, _two_errors(left["template"], richer), bias)


def _bias(found: Triangulated, left: Correlation, right: Stereo) -> np.ndarray | None:
    """Motion (row, col, 3, 2) of the points by the bias of the left places along x and y [mm]; None if unknown.

    Subsets of one shape function are off by the same part of the material in both photographs.
    """
    from dicflow.core.tensors import inverse

    if "bias" not in left:
        return None
    slopes: np.ndarray = found.by_left
    if not _differ(left, right):
        slopes = slopes + found.by_right @ right["gradient"] @ inverse(left["gradient"])
    bias: np.ndarray = slopes * left["bias"][..., None, :]
    return bias


def _differ(left: Correlation, right: Stereo) -> bool:
    """Whether the shape functions left and right differ at a step."""
    return left.shape_function != right.grid.shape_function


def _own_template(left: Correlation) -> np.ndarray:
    """Covariance (row, col, 3) of the left places by the noise of the template, with their shape function [px²]."""
    return left["template_own" if "template_own" in left else "template"]


def _variance(covariance: np.ndarray) -> Any:
    """Sum of both variances (row, col, 1) of covariances (row, col, 3)."""
    return covariance[..., :1] + covariance[..., 2:]


def _two_errors(template: np.ndarray, richer: np.ndarray) -> np.ndarray:
    """Covariance (row, col, 10) of the template's error and of the addition by a richer shape function [px²].

    template, richer : (row, col, 3) — covariances of the error with either
    """
    import numpy as np

    from dicflow.core.tensors import symmetric, upper_triangle

    both = np.zeros((*template.shape[:2], 4, 4))
    both[..., :2, :2] = symmetric(template)
    both[..., 2:, 2:] = symmetric(_positive(richer - template))
    return upper_triangle(both)


def _positive(covariance: np.ndarray) -> np.ndarray:
    """The nearest covariances (row, col, 3): without negative variances."""
    import numpy as np

    from dicflow.core.tensors import symmetric, upper_triangle

    known = np.isfinite(covariance).all(axis=-1)
    nearest = np.full(covariance.shape, np.nan)
    values, axes = np.linalg.eigh(symmetric(covariance[known]))
    nearest[known] = upper_triangle((axes * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2))
    return nearest


def _facts(
    found: Triangulated, errors: PointErrors, status: np.ndarray, right: Stereo, inside: np.ndarray
) -> dict[str, Any]:
    """Further attributes of a step.

    inside : (row, col) — the points of the region at the first step
    """
    reasons = _reasons(status[inside])
    points = int(inside.sum())
    summary = {"points": points, "valid_share": reasons.get("valid", 0.0), **_figures(found, errors, status, right)}
    return {"reasons": reasons, "text": _sentence(reasons, points), "summary": summary}


def _reasons(status: np.ndarray) -> dict[str, float]:
    """Share of the region's points by status, most first; empty without points."""
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


def _figures(found: Triangulated, errors: PointErrors, status: np.ndarray, right: Stereo) -> dict[str, float]:
    """Root mean squares of the residuals and medians of σ over the measured points; empty without any."""
    import numpy as np

    from dicflow.core.status import Status

    kept = status <= Status.FILLED
    if not kept.any():
        return {}
    residuals = {"epipolar_px": right["epipolar"][kept], "reprojection_px": found.reprojection.astype("f4")[kept]}
    variances = np.median(np.diagonal(errors.own[kept], axis1=-2, axis2=-1), axis=0)
    return {
        **{name: float(np.sqrt(np.mean(values**2))) for name, values in residuals.items()},
        **{f"sigma_{axis}_mm": float(np.sqrt(value)) for axis, value in zip("XYZ", variances, strict=True)},
    }


def sentence(stage: Triangulate, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return "Points in space are those of maximum likelihood for both photographs [hartley1997]."
