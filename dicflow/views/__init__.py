"""Figures from datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dicflow.errors import ConfigurationError
from dicflow.pipeline.registry import nearest
from dicflow.pipeline.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot"]


def plot(result: Result, stage: str, quantity: str, *, step: str | int = -1, variant: int = 0) -> Figure:
    """One quantity of one step on the grid of its product.

    step : name or number; the last by default. Not looked at for a stage that runs once
    Raises ConfigurationError for a quantity that the product does not have and lists those it has.
    """
    from dicflow.views.maps import picture

    product = result.product(stage, step if result.steps(stage) else None, variant)
    if quantity not in product.variables:
        known = ", ".join(product.variables)
        raise ConfigurationError(
            f"no quantity '{quantity}' in {stage}{nearest(quantity, product.variables)}; it has {known}"
        )
    return picture(product.variables[quantity], f"{stage} · {quantity}")


Result.drawing = plot
