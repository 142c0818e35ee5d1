"""How often the truth is within the reported standard deviations, in space: the same scene with ever new noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.photographs.region import rectangle
from dicflow.core.synthetic.deformation import strain
from dicflow.core.tensors import symmetric
from dicflow.engine.product import Product, Variable
from dicflow.kinds.region import polygons_to_json
from dicflow.kinds.rig import rig_to_json
from dicflow.stages.correlate import Correlate
from dicflow.stages.deformation import Deformation
from dicflow.stages.stereo import Stereo
from dicflow.stages.triangulate import Triangulate
from tests import stereo_scene as scene
from tests.bars import Figure

NOISE = 2.0
TRUE_NOISE = float(np.hypot(NOISE, 12**-0.5))
"""With that of whole grey levels."""
STATE = scene.State(stretch=1.02, curl=0.3, turn=(0.03, 0.05, 0.02), shift=(0.5, 0.3, -0.5))
REPETITIONS = 30
QUANTITIES = ("X", "Y", "Z", "U", "V", "W", "exx", "eyy", "gxy")
BARS = ((1, 68.0, 3.0), (2, 95.0, 2.0))
"""How many σ, the share of the errors that should be within them, and how far off it may be [%]."""
RIG = Product("rig", {}, {"rig": rig_to_json(scene.RIG)})
REGION = Product("region", {}, {"polygons": polygons_to_json([rectangle(*scene.REGION)])})


class Measured(NamedTuple):
    """A strip at rest and stretched, as measured.

    places : (row, col, 2) — of the points in the first left photograph [px]
    total : what became of them
    noise : of the photographs, measured or given [grey levels]
    """

    places: np.ndarray
    total: Product
    noise: float


def coverage() -> Iterator[Figure]:
    """Subsets as they are by default, affine in time and quadratic across, and quadratic in both."""
    ratio = measured(0, Correlate()).noise / TRUE_NOISE
    yield Figure("coverage in space: noise measured in the photographs, over the true one", ratio)
    for way, shape_function in (("by default", "affine"), ("quadratic", "quadratic")):
        yield from covered(f"coverage in space, {way}", shape_function)


def covered(name: str, shape_function: Literal["affine", "quadratic"]) -> Iterator[Figure]:
    """Shares of all points in all repetitions, the noise being known."""
    stage = Correlate(shape_function=shape_function, noise=TRUE_NOISE)
    found = [scaled_errors(measured(seed, stage)) for seed in range(REPETITIONS)]
    print(f"\n{name}: errors over their reported σ\n{'':<6}{'scatter':>8}{'mean':>8}{'1σ':>8}{'2σ':>8}{'points':>10}")
    doubts = []
    for quantity in QUANTITIES:
        scaled = [errors[quantity] for errors in found]
        shares = [100.0 * share_within(scaled, sigmas) for sigmas, *_ in BARS]
        doubts += [100.0 * uncertainty_of_share(scaled, sigmas) for sigmas, *_ in BARS]
        all_of_them = np.concatenate(scaled)
        print(f"{quantity:<6}{all_of_them.std():>8.3f}{all_of_them.mean():>8.3f}", end="")
        print("".join(f"{share:>8.1f}" for share in shares), f"{all_of_them.size:>9}")
        for share, (sigmas, expected, tolerance) in zip(shares, BARS, strict=True):
            text = f"{name}: |share within {sigmas}σ of {quantity} − {expected:g} %|"
            yield Figure(text, abs(share - expected), tolerance, unit="%")
    yield Figure(f"{name}: largest standard error of these shares", max(doubts), 1.0, unit="%")


def share_within(scaled: Sequence[np.ndarray], sigmas: float) -> float:
    """Share of the errors within so many σ."""
    return float((np.abs(np.concatenate(scaled)) < sigmas).mean())


def uncertainty_of_share(scaled: Sequence[np.ndarray], sigmas: float) -> float:
    """Standard error of the share, by its scatter between repetitions, as points of one share pixels."""
    shares = [(np.abs(errors) < sigmas).mean() for errors in scaled]
    return float(np.std(shares, ddof=1) / np.sqrt(len(shares)))


def measured(seed: int, correlate: Correlate) -> Measured:
    """Both states by the stages, with noise of its own in each photograph."""
    rest, stretched = (
        _images(*scene.photographs(state, NOISE, 2 * seed + step)) for step, state in enumerate((scene.REST, STATE))
    )
    before = correlate.run(images=rest, images_first=rest, region=REGION)
    after = correlate.run(
        images=stretched, images_first=rest, images_before=rest, region=REGION, correlation_before=before
    )
    right_first, right = (_right(images, rest, step, before) for images, step in ((rest, before), (stretched, after)))
    points_first, points = (
        Triangulate().run(correlation=step, correlation_first=before, stereo=stereo, stereo_first=right_first, rig=RIG)
        for step, stereo in ((before, right_first), (after, right))
    )
    total = Deformation().run(points=points, points_first=points_first)
    return Measured(before["xy"], total, after.attrs["noise_grey"])


def _right(images: Product, images_first: Product, correlation: Product, correlation_first: Product) -> Product:
    first = {"images_first": images_first, "correlation_first": correlation_first}
    return Stereo().run(images=images, correlation=correlation, rig=RIG, **first)


def _images(left: np.ndarray, right: np.ndarray) -> Product:
    return Product("images", {"left": Variable(("row", "col"), left), "right": Variable(("row", "col"), right)})


def scaled_errors(found: Measured) -> dict[str, np.ndarray]:
    """Errors (n,) over their reported σ, of every quantity at the stretched state."""
    material, total = scene.material(found.places), found.total
    before, after = (scene.space_truth(material, state) for state in (scene.REST, STATE))
    deviations = np.sqrt(np.diagonal(symmetric(total["covariance"]), axis1=-2, axis2=-1)[..., :3])
    place, motion = (total["xyz"] - after) / deviations, after - before
    imposed = strain(scene.deformation(scene.REST), scene.deformation(STATE), material)
    truth = {**{name: motion[..., axis] for axis, name in enumerate("UVW")}, **imposed._asdict()}
    errors = {name: place[..., axis] for axis, name in enumerate("XYZ")}
    errors |= {name: (total[name] - truth[name]) / total[f"sigma_{name}"] for name in truth}
    return {name: values[np.isfinite(values)] for name, values in errors.items()}
