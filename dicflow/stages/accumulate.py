"""Total displacement and strain since the first step."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from dicflow.engine.node import At, Node, Port, Scope
from dicflow.engine.product import Product
from dicflow.kinds.increment import StrainIncrement
from dicflow.kinds.quantities import BASIC
from dicflow.kinds.total import Total, TotalFacts, field_means

__all__ = ["Accumulate", "sentence"]

_TITLES = {
    "material": {
        "exx": "engineering strain εxx = |F e₁| − 1",
        "eyy": "engineering strain εyy = |F e₂| − 1",
        "gxy": "shear γxy, decrease of the right angle",
    },
    "thesis": {
        "exx": "strain εxx, sum of ΔDX/ΔX",
        "eyy": "strain εyy, sum of ΔDY/ΔY",
        "gxy": "shear strain, sum of ΔDY/ΔX + ΔDX/ΔY",
    },
}
"""What the strains of a total are; e₁ and e₂ are the material directions that were x and y at the first step."""


class Accumulate(Node):
    """Add an increment to the total of the previous step.

    In the material definition displacements are added and deformation gradients multiplied point by point,
    F = f · F of the previous step; a lost point stays lost. In the thesis's the previous total is stretched to the new
    grid like an image, gaps are filled, and displacements and strains are added. The sum of incremental engineering
    strains is not the engineering strain: it approximates ln(1 + ε), about 0.8 instead of 1.2 at a stretch of 2.2. The
    increment that follows a step without any displacement is added to the total of the last step that has one.
    """

    title: ClassVar = "accumulate the steps"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {
        "strain": Port("strain_increment"),
        "total_before": Port("total", at=At.PREVIOUS, optional=True, own=True),
    }
    gives: ClassVar = "total"

    stage: Literal["accumulate"] = "accumulate"

    def run(self, strain: Product, total_before: Product | None = None) -> Product:
        increment = StrainIncrement.read(strain)
        before = None if total_before is None else Total.read(total_before).last
        fields = _material(increment, before) if increment.follows_material else _thesis(increment, before)
        status = fields.pop("status")
        facts = TotalFacts(
            increment.definition,
            increment.unit,
            _TITLES[increment.definition],
            {"step_size": increment.step_size, "summary": field_means(fields, increment.unit)},
        )
        total = Total.write(fields, status, facts)
        return total if increment.has_values else Total.read(total).lost(before)


def _material(increment: StrainIncrement, before: Total | None) -> dict[str, Any]:
    """The fields of the total along material points, and their status."""
    import numpy as np

    from dicflow.core.strain.surface_strain import engineering_strain
    from dicflow.kinds.status import known_or_nan

    fields = {name: increment[name] for name in ("U", "V", "W", "xy", "xyz", "xyz_reference", "gradient", "status")}
    if before is not None:
        fields.update({name: before[name] + increment[name] for name in "UVW"})
        fields["gradient"] = increment["gradient"] @ before["gradient"]
        fields["xyz_reference"] = before["xyz_reference"]
        fields["status"] = np.maximum(increment["status"], before["status"])
    fields.update(engineering_strain(fields["gradient"])._asdict())
    complete = np.isfinite(np.stack([fields[name] for name in BASIC])).all(axis=0)
    return {name: values if name == "status" else known_or_nan(complete, values) for name, values in fields.items()}


def _thesis(increment: StrainIncrement, before: Total | None) -> dict[str, Any]:
    """The fields of the total by stretching and adding, and their status."""
    import numpy as np

    from dicflow.core.status import Status
    from dicflow.core.surfaces.displacement import fill_cells, resize, resize_codes

    fields = {name: increment[name] for name in (*BASIC, "xy", "xyz", "xyz_reference", "status")}
    if before is not None:
        shape, status = increment["U"].shape, increment["status"]
        stretched = resize(np.stack([before[name] for name in BASIC], axis=-1), shape)
        filled = fill_cells(stretched, np.isfinite(increment["U"]))
        fields.update({name: increment[name] + filled.values[..., index] for index, name in enumerate(BASIC)})
        fields["xyz_reference"] = resize(before["xyz_reference"], shape)
        known = np.isfinite(fields["U"])
        worst = np.maximum(np.maximum(status, resize_codes(before["status"], shape)), Status.FILLED * filled.filled)
        fields["status"] = np.where(known, np.minimum(worst, Status.FILLED), np.maximum(worst, Status.OUTSIDE))
        fields["status"] = fields["status"].astype(np.uint8)
    return fields


def sentence(stage: Accumulate, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return "The steps were accumulated to displacement and strain since the first one."
