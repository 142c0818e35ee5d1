"""Stresses and stretches of one test as a product: true stress, moduli, cycle, with their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.curve import StressCurve

if TYPE_CHECKING:
    import numpy as np

__all__ = ["MODES", "Measured", "curve_product"]

MODES = "how the specimen deforms across the load: freely, not at all, as along the load, or as measured"
_CREEP = 0.05
"""Work after the largest load, relative to that before it, from which the specimen counts as growing."""
_MOST_STRETCH = 15.0
"""Largest stretch that no rubber exceeds."""
_WORK = ("loading", "unloading", "loop")


class Measured(NamedTuple):
    """What a test measured, (step,) each, NaN where unknown; None if no step knows it.

    phases : of each step, loading or unloading; empty: loading up to the largest stress
    load : [N]
    nominal : nominal stress [MPa]
    u_stretch, u_nominal : independent shares of their uncertainty
    lateral : stretch across the load
    """

    steps: Sequence[str]
    phases: Sequence[str]
    stretch: np.ndarray
    nominal: np.ndarray
    u_stretch: np.ndarray | None = None
    u_nominal: np.ndarray | None = None
    lateral: np.ndarray | None = None
    load: np.ndarray | None = None


def curve_product(found: Measured, mode: str, common: tuple[float, float], warnings: Sequence[str] = ()) -> Product:
    """The curve of one test.

    common : shares of stress and stretch, relative to them, that all steps have in common
    Raises StageError if fewer than two steps are known, or the load runs against the stretch.
    """
    import numpy as np

    from dicflow.core.material.cycle import peak_of

    known = np.isfinite(found.stretch) & np.isfinite(found.nominal)
    _check(found, known, mode)
    phases = found.phases
    if not phases:
        peak = peak_of(np.where(known, found.nominal, np.nan))
        phases = ["loading" if index <= peak else "unloading" for index in range(len(known))]
    values = {**_stresses(found, common), **_moduli(found, known), **_ratios(found)}
    summary = _summary(found, known, common)
    lost = [] if known.all() else [_lost(int((~known).sum()))]
    notes = [*_turning(np.abs(found.nominal)), *_notes(summary)]
    facts = {"summary": summary, "warnings": [*warnings, *lost, *notes]}
    return StressCurve.write(values, found.steps, phases, mode, common, facts)


def _check(found: Measured, known: np.ndarray, mode: str) -> None:
    import numpy as np

    if known.sum() < 2:
        raise StageError(
            f"{known.sum()} of {len(known)} steps have both a load and a stretch, and a curve needs two; look at both"
        )
    if mode == "biaxial" and found.lateral is None:
        raise StageError("mode: biaxial needs the stretch across the load; measure it, or set another mode")
    stretch, stress = found.stretch[known], found.nominal[known]
    if np.ptp(stress) == 0.0 or np.ptp(stretch) == 0.0:
        same = "load" if np.ptp(stress) == 0.0 else "stretch"
        raise StageError(f"the {same} is the same at all {len(stretch)} steps; look at its column")
    if np.corrcoef(stretch, stress)[0, 1] <= 0.0:
        raise StageError(
            "the load runs against the stretch: the more load, the shorter the specimen; look at the order of rows, "
            "the sign of the load, and the direction of the stretch"
        )


def _lost(count: int) -> str:
    steps = "1 step has" if count == 1 else f"{count} steps have"
    return f"{steps} no load or no stretch and is missing in the curve; look at its points and at the load's column"


def _stresses(found: Measured, common: tuple[float, float]) -> dict[str, np.ndarray]:
    """Stretches and stresses with both shares of their uncertainty."""
    import numpy as np

    stretch, nominal = found.stretch, found.nominal
    values = {"stretch": stretch, "nominal_stress": nominal, "true_stress": nominal * stretch}
    if found.load is not None:
        values["load"] = found.load
    if found.lateral is not None:
        values["lateral_stretch"] = found.lateral
    if found.u_stretch is not None:
        values["u_stretch"] = found.u_stretch
    if found.u_nominal is not None:
        values["u_nominal_stress"] = found.u_nominal
        u_stretch = 0.0 if found.u_stretch is None else found.u_stretch
        values["u_true_stress"] = np.hypot(stretch * found.u_nominal, nominal * u_stretch)
    values["common_stretch"] = stretch * common[1]
    values["common_nominal_stress"] = np.abs(nominal) * common[0]
    values["common_true_stress"] = np.abs(nominal * stretch) * math.hypot(*common)
    return values


def _moduli(found: Measured, known: np.ndarray) -> dict[str, np.ndarray]:
    """Secant and tangent moduli with the independent share of their uncertainty."""
    import numpy as np

    from dicflow.core.material.cycle import propagated, secant_modulus, tangent_modulus

    values, sigma = _vector(found, known)
    moduli = {}
    for name, function in (("secant_modulus", secant_modulus), ("tangent_modulus", tangent_modulus)):

        def modulus(x: np.ndarray, function: Callable[..., np.ndarray] = function) -> np.ndarray:
            return function(*np.split(x, 2))

        moduli[name] = _spread(modulus(values), known)
        if found.u_nominal is not None:
            moduli[f"u_{name}"] = _spread(propagated(modulus, values, sigma), known)
    return moduli


def _vector(found: Measured, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Known stretches, then known stresses; and their independent uncertainties, 0 where unknown."""
    import numpy as np

    zero = np.zeros(len(known))
    sigma = [zero if one is None else one for one in (found.u_stretch, found.u_nominal)]
    return (
        np.concatenate([found.stretch[known], found.nominal[known]]),
        np.concatenate([one[known] for one in sigma]),
    )


def _spread(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values of the known steps at all steps, NaN at the others."""
    import numpy as np

    full = np.full(len(known), np.nan)
    full[known] = values
    return full


def _ratios(found: Measured) -> dict[str, np.ndarray]:
    """Poisson's and Hencky's ratio; empty without a stretch across the load."""
    import numpy as np

    if found.lateral is None:
        return {}
    strain = np.where(np.abs(found.stretch - 1.0) < 1e-9, np.nan, found.stretch - 1.0)
    return {
        "poisson_ratio": -(found.lateral - 1.0) / strain,
        "hencky_ratio": -np.log(found.lateral) / np.log1p(strain),
    }


def _summary(found: Measured, known: np.ndarray, common: tuple[float, float]) -> dict[str, float]:
    """Largest stretch and stress; work, loop and set of the cycle with u, all shares together."""
    import numpy as np

    from dicflow.core.material.cycle import cycle_of, propagated

    values, sigma = _vector(found, known)
    cycle = cycle_of(*np.split(values, 2))
    u = propagated(lambda x: np.array(cycle_of(*np.split(x, 2))[:4]), values, sigma)
    stretch, stress = np.split(values, 2)
    most = np.max if stress.max() > 0.0 else np.min
    summary = {"largest_stretch": float(most(stretch)), "largest_stress_MPa": float(most(stress))}
    share = math.hypot(*common)
    for index, name in enumerate(_WORK):
        if math.isfinite(cycle[index]):
            summary[f"{name}_work_mJ_mm3"] = cycle[index]
            summary[f"u_{name}_work_mJ_mm3"] = math.hypot(u[index], share * cycle[index])
    if math.isfinite(cycle.set):
        name = "set" if cycle.is_closed else "set_under_load"
        summary[name] = cycle.set
        summary[f"u_{name}"] = math.hypot(u[3], common[1] * cycle.set)
    return summary


def _turning(load: np.ndarray) -> Iterator[str]:
    from dicflow.core.channels.phases import is_loading

    rises = is_loading(load)
    if again := [step for step in range(1, len(rises)) if rises[step] and not rises[step - 1]]:
        yield (
            f"the load falls, and rises again to step {again[0] + 1}: the steps are out of order, or there are several "
            "cycles, of which works and set are the sum; look at the order of the steps"
        )


def _notes(summary: Mapping[str, float]) -> Iterator[str]:
    if summary.get("loop_work_mJ_mm3", 0.0) < -2.0 * summary.get("u_loop_work_mJ_mm3", 0.0):
        yield "unloading lies above loading: the specimen was shorter at the same load; look at the lengths and loads"
    if summary.get("unloading_work_mJ_mm3", 0.0) < -_CREEP * summary["loading_work_mJ_mm3"]:
        yield "the specimen went on growing after the largest load: it slips, tears or softens; look at those steps"
    if summary["largest_stretch"] > _MOST_STRETCH:
        yield (
            f"the largest stretch is {summary['largest_stretch']:.3g}, more than rubber bears; a strain in percent is "
            "a column strain_pct"
        )
    if "set_under_load" in summary:
        yield (
            "the last step is still under load: the loop's area is that above its stretch, and the set is measured "
            "from loading at the same stress; measure the unloaded specimen last"
        )
