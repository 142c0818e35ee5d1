"""A published or measured curve of stress and stretch from a table, without photographs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.node import InputFile, Node, Scope, parameter
from dicflow.engine.product import Product
from dicflow.stages._curve import MODES, Measured, curve_product

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Curve", "sentence"]


class Curve(Node):
    """Read stress and stretch of one test from a table.

    Columns: ``stretch``, ``strain`` or ``strain_pct``; ``nominal_stress_MPa`` or ``true_stress_MPa``, also in Pa, kPa,
    N/mm2 and psi. True stress is made nominal by P = σ / λ, since volume is kept. The uncertainty of single points is
    read from columns such as ``u_nominal_stress_MPa`` and ``u_stretch``, or given here for all. Where neither says it,
    a fit weights all points by their stress, and takes the scatter about the curve for the uncertainty. The exported
    table of another pipeline's curve is read with both shares of its uncertainty, so that its test joins a fit here.
    """

    title: ClassVar = "read a stress–stretch curve"
    scope: ClassVar = Scope.TEST
    gives: ClassVar = "curve"

    stage: Literal["curve"] = "curve"
    file: InputFile = parameter(..., "CSV table with the columns stretch, nominal_stress_MPa; one row per point")
    mode: Literal["uniaxial", "planar", "equibiaxial", "biaxial"] = parameter(..., MODES)
    u_stress: float | None = parameter(
        None, "independent share of the stress's uncertainty, relative to it", gt=0, lt=1
    )
    u_stretch: float | None = parameter(None, "standard uncertainty of single stretches", gt=0, lt=1)
    common_stress: float = parameter(0.0, "uncertainty that all stresses share, relative to them", ge=0, lt=1)

    def check(self, path: Path) -> dict[str, Any]:
        from dicflow.io.stress_table import read_stresses

        return {"rows": len(read_stresses(path).stretch)}

    def run(self, file_path: Path) -> Product:
        from dicflow.io.stress_table import read_stresses

        table = read_stresses(file_path)
        scale = 1.0 / table.stretch if table.is_true else 1.0
        stress = table.stress * scale
        measured = Measured(
            [str(number) for number in range(1, len(stress) + 1)],
            table.phase or (),
            table.stretch,
            stress,
            _given(table.u_stretch, self.u_stretch, stress),
            self._u_stress(stress) if table.u_stress is None else table.u_stress * scale,
            table.lateral,
        )
        shared = self.common_stress if table.common_stress is None else table.common_stress
        return curve_product(measured, self.mode, (shared, table.common_stretch or 0.0))

    def _u_stress(self, stress: np.ndarray) -> np.ndarray | None:
        """The uncertainty in proportion to the stress, of small ones that of a twentieth of the largest."""
        import numpy as np

        size = np.abs(stress)
        return None if self.u_stress is None else self.u_stress * np.maximum(size, 0.05 * size.max())


def _given(column: np.ndarray | None, value: float | None, like: np.ndarray) -> np.ndarray | None:
    """The column, else the one value for all."""
    import numpy as np

    return column if column is not None or value is None else np.full(len(like), value)


def sentence(stage: Curve, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return f"A stress–stretch curve in {stage.mode} tension was taken from a table."
