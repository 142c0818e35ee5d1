"""Total displacement and strain since the first step."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from dicflow.engine.node import At, Node, Port, Scope
from dicflow.engine.product import Product, Variable

__all__ = ["Accumulate", "field_means"]

_VECTOR = ("row", "col", "component")
_MEASURES = {
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
    """Add an increment to the total before it.

    In the material definition displacements are added and deformation gradients multiplied point by point,
    F = f · F before; a point that was lost once stays lost. In the thesis's the total before is stretched to the new
    grid like an image, gaps are filled, and displacements and strains are added. The sum of incremental engineering
    strains is not the engineering strain: it comes near ln(1 + ε), so at a stretch of 2.2 it reads about 0.8 instead
    of 1.2.
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
        definition, unit = strain.attrs["definition"], strain.attrs["unit"]
        fields = _material(strain, total_before) if definition == "material" else _thesis(strain, total_before)
        attrs = {
            "definition": definition,
            "unit": unit,
            "step_size": strain.attrs["step_size"],
            "measures": _MEASURES[definition],
            "summary": field_means(fields, unit),
        }
        return Product("total", _variables(fields, unit), attrs)


def _material(strain: Product, before: Product | None) -> dict[str, Any]:
    """The fields of the total along material points."""
    import numpy as np

    from dicflow.core.strain.surface_strain import engineering_strain

    fields = {name: strain[name] for name in ("U", "V", "W", "xy", "xyz", "xyz_reference", "gradient", "status")}
    if before is not None:
        fields.update({name: before[name] + strain[name] for name in "UVW"})
        fields["gradient"] = strain["gradient"] @ before["gradient"]
        fields["xyz_reference"] = before["xyz_reference"]
        fields["status"] = np.maximum(strain["status"], before["status"])
    fields.update(engineering_strain(fields["gradient"])._asdict())
    complete = np.isfinite(np.stack([fields[name] for name in ("U", "V", "W", "exx", "eyy", "gxy")])).all(axis=0)
    return {name: values if name == "status" else _blank(values, complete) for name, values in fields.items()}


def _thesis(strain: Product, before: Product | None) -> dict[str, Any]:
    """The fields of the total by stretching and adding."""
    import numpy as np

    from dicflow.core.status import Status
    from dicflow.core.surfaces.displacement import fill_cells, resize, resize_codes

    summed = ("U", "V", "W", "exx", "eyy", "gxy")
    fields = {name: strain[name] for name in (*summed, "xy", "xyz", "xyz_reference", "status")}
    if before is not None:
        shape, status = strain["U"].shape, strain["status"]
        stretched = resize(np.stack([before[name] for name in summed], axis=-1), shape)
        filled = fill_cells(stretched, np.isfinite(strain["U"]))
        fields.update({name: strain[name] + filled.values[..., index] for index, name in enumerate(summed)})
        fields["xyz_reference"] = resize(before["xyz_reference"], shape)
        known = np.isfinite(fields["U"])
        worst = np.maximum(np.maximum(status, resize_codes(before["status"], shape)), Status.FILLED * filled.filled)
        fields["status"] = np.where(known, np.minimum(worst, Status.FILLED), np.maximum(worst, Status.OUTSIDE))
        fields["status"] = fields["status"].astype(np.uint8)
    return fields


def _blank(values: Any, complete: Any) -> Any:
    """NaN where the total is not complete."""
    import numpy as np

    return np.where(complete.reshape(complete.shape + (1,) * (values.ndim - 2)), values, np.nan)


def _variables(fields: dict[str, Any], unit: str) -> dict[str, Variable]:
    from dicflow.stages.strain import strain_variables

    return {
        **{n: Variable(("row", "col"), fields[n], unit, f"displacement {n}") for n in "UVW"},
        **strain_variables([fields[name] for name in ("exx", "eyy", "gxy")], ""),
        "xyz": Variable(_VECTOR, fields["xyz"], unit, "place"),
        "xyz_reference": Variable(_VECTOR, fields["xyz_reference"], unit, "place at the first step"),
        "xy": Variable(("row", "col", "image_component"), fields["xy"], "px", "place in the image"),
        **(
            {"gradient": Variable(("row", "col", "out", "in"), fields["gradient"], "1", "deformation gradient")}
            if "gradient" in fields
            else {}
        ),
        "status": Variable(("row", "col"), fields["status"], "1", "why a point has a value, or has none"),
    }


def field_means(fields: dict[str, Any], unit: str) -> dict[str, float]:
    """Means over the points that have a value; absent without any."""
    import numpy as np

    units = {"U": f"_{unit}", "V": f"_{unit}", "W": f"_{unit}"}
    means = {
        f"mean_{name}{units.get(name, '')}": fields[name][np.isfinite(fields[name])]
        for name in ("U", "V", "W", "exx", "eyy", "gxy")
    }
    return {name: float(values.mean()) for name, values in means.items() if values.size}
