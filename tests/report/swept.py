"""A sweep of subset and window with totals of known noise, without any computation."""

from __future__ import annotations

from itertools import product as every
from types import SimpleNamespace

import numpy as np

from dicflow.engine.product import Product
from dicflow.report.context import Context
from dicflow.report.pieces import Pieces
from tests.io.exported_totals import total

STEPS = ("step_01", "step_02")
SIDES = tuple(every((15, 21, 27, 33, 39, 45), (20, 30, 40, 50, 60, 70, 80, 90, 100, 110)))
"""Subset and window of 60 variants."""


def sigma(subset, window):
    """σ of a strain that falls with the gauge."""
    return 0.05 / (subset * window)


class Swept:
    """What the section of a sweep asks a result."""

    def __init__(self, sides=SIDES, form="precise"):
        self.sides, self.form = sides, form
        self.values = [{"correlation.subset_size": subset, "total.window": window} for subset, window in sides]

    def stages_of(self, kind):
        return ["total"] if kind == "total" else []

    def steps(self, stage, variant=0):
        return STEPS

    def has(self, stage, step, variant=0):
        return True

    def digest(self, stage, step, variant=0):
        return f"{step}-{variant}-{self.sides[variant]}"

    def product(self, stage, step, variant=0):
        (subset, window), made = self.sides[variant], total(self.form)
        side = float(subset + window)
        noise = sigma(subset, window)
        gauge = {"vsg_px": side, "vsg_mm": side / 20.0} if self.form == "precise" else {}
        summary = {"sigma_exx": noise, "sigma_eyy": 1.2 * noise, "mean_eyy": 0.01 + noise, "points": 35}
        bend = np.sin(np.arange(35).reshape(7, 5) * side / 40.0)
        strain = made.variables["eyy"]
        variables = {**made.variables, "eyy": strain._replace(values=strain.values * (1.0 + 0.2 * bend))}
        return Product("total", variables, {**made.attrs, **gauge, "summary": summary})

    def table(self):
        return [{**values, **self._scalars(k)} for k, values in enumerate(self.values)]

    def _scalars(self, variant):
        summary = self.product("total", STEPS[0], variant).attrs["summary"]
        return {f"total.{key}": value for key, value in summary.items()}


def context_of_sweep(result, folder):
    return Context(SimpleNamespace(), result, None, Pieces(folder / ".report", "code"), folder)
