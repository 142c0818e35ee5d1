"""Three tests on one rubber as tables of stress and stretch, with known constants and known noise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import MODES
from dicflow.core.material.response import stress_in_mode

__all__ = ["CONSTANTS", "MODEL", "NOISE", "rubber_table", "write_rubber"]

MODEL = "ogden_2"
CONSTANTS = {"mu1": 0.55, "alpha1": 1.4, "mu2": 0.004, "alpha2": 5.5}
"""Constants of the rubber; factors in MPa, W = Σ μk/αk (λ1^αk + λ2^αk + λ3^αk − 3)."""
NOISE = 0.01
"""Standard deviation of the stresses, relative to them."""
_LARGEST = {"uniaxial": 3.0, "planar": 2.6, "equibiaxial": 2.2}
_POINTS = 14
_SEED = 1944


def write_rubber(folder: Path) -> None:
    """Write ``uniaxial.csv``, ``planar.csv``, ``equibiaxial.csv`` and ``truth.json``; always the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    for mode in MODES:
        (folder / f"{mode}.csv").write_text(rubber_table(mode), encoding="utf-8")
    truth = {"model": MODEL, "constants": CONSTANTS, "noise": NOISE}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def rubber_table(mode: str) -> str:
    """One test as CSV, with noise of a fixed seed."""
    stretch = np.linspace(1.0, _LARGEST[mode], _POINTS + 1)[1:]
    exact = stress_in_mode(MODELS[MODEL], np.array(list(CONSTANTS.values())), mode, stretch)
    noise = np.random.default_rng([_SEED, list(MODES).index(mode)]).standard_normal(_POINTS)
    rows = [f"{x:.4f},{y:.5f}" for x, y in zip(stretch, exact * (1.0 + NOISE * noise), strict=True)]
    note = f"# A made rubber in {mode} tension; noise of 1 % of the stress. truth.json has its constants."
    return "\n".join([note, "stretch,nominal_stress_MPa", *rows]) + "\n"
