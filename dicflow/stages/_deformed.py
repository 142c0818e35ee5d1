"""Fields of a deformed surface, and figures of a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dicflow.kinds.kind import summary_of
from dicflow.kinds.quantities import BASIC, figure_in_words
from dicflow.kinds.total import Total, named_with_unit

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.strain.point_scatter import AxisScatter
    from dicflow.core.uncertainty.covariance import MeasuredPoints

__all__ = [
    "beyond_noise",
    "combined",
    "consistent_status",
    "degrees",
    "displacements",
    "figures_sentence",
    "median_errors",
    "shares",
]


def displacements(before: MeasuredPoints, after: MeasuredPoints, covariance: np.ndarray) -> dict[str, np.ndarray]:
    """U, V and W, and σ of each."""
    import numpy as np

    from dicflow.core.uncertainty.covariance import displacement_variances

    values = after.xyz - before.xyz
    values[np.isnan(values).any(axis=-1)] = np.nan
    variances = displacement_variances(covariance)
    deviations = np.sqrt(np.maximum(variances, 0.0))
    return {
        **{name: values[..., axis] for axis, name in enumerate("UVW")},
        **{f"sigma_{name}": deviations[..., axis] for axis, name in enumerate("UVW")},
    }


def combined(fields: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Combined uncertainty of each quantity that has a standard deviation; this itself where the bias is unknown."""
    import numpy as np

    names = [name.removeprefix("sigma_") for name in fields if name.startswith("sigma_")]
    biases = {name: np.nan_to_num(fields.get(f"bias_{name}", 0.0)) for name in names}
    return {f"u_{name}": np.hypot(fields[f"sigma_{name}"], biases[name]) for name in names}


def beyond_noise(
    bias: Mapping[str, np.ndarray], moved: Mapping[str, np.ndarray], seen: Sequence[AxisScatter]
) -> dict[str, np.ndarray]:
    """Bias of U, V and W with what the points scatter beyond their σ; empty if the bias is unknown.

    moved : with σ of each
    """
    import numpy as np

    excess = {f"bias_{name}": np.sqrt(axis.variance / axis.noise - 1.0) for name, axis in zip("UVW", seen, strict=True)}
    return {
        name: np.hypot(values, excess[name] * moved[name.replace("bias", "sigma")]) for name, values in bias.items()
    }


def degrees(degree: np.ndarray) -> dict[str, Any]:
    """The degree of most points, and the share of points of each."""
    found = shares(degree)
    return {"degree": int(max(found, key=lambda one: found[one])) if found else 1, "degree_shares": found}


def shares(values: np.ndarray) -> dict[str, float]:
    """The share of points of each value."""
    import numpy as np

    found, counts = np.unique(values, return_counts=True)
    return {str(one): float(count / counts.sum()) for one, count in zip(found, counts, strict=True)}


def consistent_status(status: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Status that agrees with the values: valid or filled if known, else a reason."""
    import numpy as np

    from dicflow.core.status import Status

    reasons = np.where(known, np.minimum(status, Status.FILLED), np.maximum(status, Status.OUTSIDE))
    return np.asarray(reasons, dtype=np.uint8)


def median_errors(fields: Mapping[str, np.ndarray], unit: str) -> dict[str, float]:
    """Median σ and u of displacements and strains; a quantity without values is absent."""
    import numpy as np

    found = {}
    for prefix in ("sigma_", "u_"):
        for name in BASIC:
            known = fields[f"{prefix}{name}"][np.isfinite(fields[f"{prefix}{name}"])]
            if known.size:
                found[f"{prefix}{named_with_unit(name, unit)}"] = float(np.median(known))
    return found


def _smaller(total: Total) -> str:
    """The gauge where the window is smaller, and at how many points that is; empty without any."""
    from dicflow.core.strain.gauge import vsg_px

    side, shares = total.window_points[0], total.window_shares
    others = [(int(points), share) for points, share in shares.items() if int(points) < side]
    said = [f"{vsg_px(n, total.step_size, total.subset_size):g} px at {share:.1%} of the points" for n, share in others]
    return "".join(f", {words}" for words in said)


def figures_sentence(total: Total) -> str:
    """The gauge, and the uncertainties at a step, as sentences of a methods paragraph."""
    gauge, summary = total.gauge, summary_of(total.product)
    text = "" if gauge is None else f" The virtual strain gauge measures {gauge.size} [idics2018]{_smaller(total)}."
    names = {name: named_with_unit(name, total.unit) for name in BASIC}
    known = {name: summary.get(f"u_{named}") for name, named in names.items()}
    figures = [figure_in_words(name, value, total.unit) for name, value in known.items() if value is not None]
    if not figures:
        return text
    said = ", ".join(figures)
    return f"{text} The median standard uncertainties, by image noise and remaining bias, were {said} at the last step."
