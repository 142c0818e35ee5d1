"""A source of fields that are formulas, with gaps, for the explorer."""

from __future__ import annotations

from typing import Any

import numpy as np

from dicflow.core.status import Status
from dicflow.explorer.fields import FieldFacts, QuantityFacts, StepFields
from dicflow.explorer.reading import Reading
from dicflow.explorer.survey import extents, scales_of, survey

__all__ = ["Bare", "Waves", "reading_of"]


class Waves:
    """Points that move along y; strain and depth are waves. Every seventh point of the second row is lost.

    rows, cols : of the grid; count : of steps
    """

    facts = FieldFacts(stage="total", form="deformation", unit="mm", follows=True, directions="material")
    photographs = None

    def __init__(self, rows: int = 30, cols: int = 40, count: int = 4) -> None:
        self.rows, self.cols = rows, cols
        self.steps = [f"step_{number:03d}" for number in range(1, count + 1)]

    def quantities(self) -> list[QuantityFacts]:
        names = ("name", "symbol", "title", "unit", "signed", "positive", "starts")
        rows = [
            ("exx", "εxx", "engineering strain εxx, VSG 40 px", "1", True, "longer", True),
            ("W", "W", "displacement W", "mm", True, "towards larger Z", True),
            ("<b>", "<b>", "</script><b>a name of a plug-in", "1", False, "", False),
        ]
        return [QuantityFacts(**dict(zip(names, row, strict=True))) for row in rows]

    def has(self, step: str) -> bool:
        return step in self.steps

    def sources(self, step: str) -> list[str]:
        return [f"digest of {step}", str((self.rows, self.cols))]

    def first_sources(self) -> list[str]:
        return ["digest of the grid"]

    def at_first(self) -> np.ndarray:
        row, col = np.mgrid[0 : self.rows, 0 : self.cols].astype(float)
        return np.stack([100.0 + 10.0 * col, 50.0 + 10.0 * row], axis=-1)

    def at_point(self, step: str, quantity: str, index: int) -> tuple[float, float]:
        fields = self.read(step)
        error = fields.errors["u"].get(quantity, np.full(self.rows * self.cols, np.nan))
        return float(fields.values[quantity].flat[index]), float(error.flat[index])

    def read(self, step: str) -> StepFields:
        number = self.steps.index(step) + 1
        first = self.at_first()
        x, y = (first[..., 0] - 100) / 10 / self.cols, (first[..., 1] - 50) / 10 / self.rows
        status = np.zeros((self.rows, self.cols), np.uint8)
        status[1, ::7] = Status.HIDDEN
        lost = status > Status.FILLED
        exx = np.where(lost, np.nan, number * (0.01 + 0.02 * np.sin(3 * x) * np.cos(2 * y)))
        w = np.where(lost, np.nan, 0.3 * number * x - 0.1 * y)
        here = np.where(lost[..., None], np.nan, first + np.array([0.0, 2.0 * number]))
        space = np.where(lost[..., None], np.nan, np.stack([40 * x, 30 * y, 500 + 20 * x * x], axis=-1))
        sigma = np.where(lost, np.nan, 1e-4 * (1 + x + 3 * y)).astype(np.float32)
        bias = np.where(lost, np.nan, 1e-5 + 4e-4 * x)
        parts = {"u": np.hypot(sigma, bias), "sigma": sigma, "bias": bias, "share": 2 * sigma}
        errors = {part: {"exx": numbers} for part, numbers in parts.items()}
        return StepFields({"exx": exx, "W": w, "<b>": x}, errors, status, {"left": here, "space": space})


class Bare:
    """A result that has nothing but steps."""

    def __init__(self, waves: Waves) -> None:
        self.waves = waves

    def stages_of(self, kind: str) -> list[str]:
        return []

    def number(self, stage: str, step: str) -> int:
        return self.waves.steps.index(step) + 1


def reading_of(waves: Waves) -> Reading:
    """The waves, read."""
    inside = np.isfinite(waves.at_first()).all(axis=-1)
    surveys = {step: survey(waves.read(step), inside) for step in waves.steps}
    result: Any = Bare(waves)
    scales = scales_of([*surveys.values()], extents(waves.at_first()))
    return Reading(result, waves, waves.steps, surveys, scales, (waves.rows, waves.cols), waves.quantities(), None)
