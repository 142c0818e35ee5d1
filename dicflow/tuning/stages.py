"""The stages of a pipeline whose settings are chosen, and the same pipeline reduced to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from dicflow.core.strain.gauge_kernel import GaugeSetting
from dicflow.core.surfaces.filters import odd_window
from dicflow.errors import ConfigurationError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.wiring import Wired, wire
from dicflow.stages.correlate import Correlate
from dicflow.stages.deformation import Deformation

__all__ = ["Tuned", "reduced", "tuned_stages"]


class Tuned(NamedTuple):
    """The stages whose settings are chosen.

    photographs, correlation, total : names of the stages
    needed : names of all stages that the total needs, itself included
    in_space : whether two cameras measure
    present : the settings of the file
    window_px : of the strain, as the file has it
    """

    photographs: str
    correlation: str
    total: str
    needed: frozenset[str]
    in_space: bool
    present: GaugeSetting
    window_px: float

    def values(self, setting: GaugeSetting) -> dict[str, Any]:
        """Dotted parameter → value, as a sweep or the file has them."""
        window = self.window_px if setting == self.present else setting.window_points * setting.step_size
        return {
            f"{self.correlation}.subset_size": setting.subset_size,
            f"{self.correlation}.step_size": setting.step_size,
            f"{self.correlation}.shape_function": setting.shape_function,
            f"{self.total}.window": f"{window:g} px",
        }


def tuned_stages(pipeline: Pipeline) -> Tuned:
    """The last strain of a pipeline and the subset correlation that it comes from.

    Raises ConfigurationError for a pipeline without them, or with a sweep of its own.
    """
    source = pipeline.path
    if "sweep" in pipeline.document.data:
        raise ConfigurationError(f"{source}: has a sweep of its own; take it out, since tuning makes one")
    wired = wire(pipeline.document)
    totals = [name for name, stage in wired.items() if isinstance(stage.node, Deformation)]
    needed = _upstream(wired, totals[-1]) if totals else {}
    correlations = [name for name in needed if isinstance(wired[name].node, Correlate)]
    if not correlations:
        raise ConfigurationError(
            f"{source}: no stage 'deformation' that follows a stage 'correlate'; only subset correlation is tuned, "
            "'dicflow init' writes such a pipeline"
        )
    total, correlation = totals[-1], correlations[0]
    photographs = wired[correlation].inputs["images"]
    while "images" in wired[photographs].inputs:
        photographs = wired[photographs].inputs["images"]
    strain, search = wired[total].node, wired[correlation].node
    assert isinstance(strain, Deformation)
    assert isinstance(search, Correlate)
    window, _ = odd_window((strain.window, strain.window), search.step_size)
    degree = 1 if strain.degree == "auto" else strain.degree
    present = GaugeSetting(search.subset_size, search.step_size, search.shape_function, window, degree)
    in_space = wired[wired[total].inputs["points"]].node.gives == "points"
    return Tuned(photographs, correlation, total, frozenset(needed), in_space, present, strain.window)


def reduced(pipeline: Pipeline, tuned: Tuned, settings: Sequence[GaugeSetting], steps: Sequence[str]) -> Pipeline:
    """The pipeline up to its strain, at a few steps, with one variant per setting and the same store.

    Their strains are of one degree everywhere, that of planes where the file leaves it open: gauges of different
    degrees do not compare.
    """
    data: Mapping[str, Any] = pipeline.document.data
    stages = {name: entry for name, entry in data["stages"].items() if name in tuned.needed}
    variants = [{**tuned.values(setting), f"{tuned.total}.degree": setting.degree} for setting in settings]
    document = pipeline.document._replace(data={"stages": stages, "sweep": {"list": variants}})
    path = pipeline.path.with_stem(f"{pipeline.name}.tune")
    return replace(pipeline, path=path, document=document, only={tuned.photographs: tuple(steps)})


def _upstream(wired: Mapping[str, Wired], name: str) -> dict[str, None]:
    """Names of a stage and of all that it takes from, nearest first."""
    found: dict[str, None] = {}
    waiting = [name]
    while waiting:
        name = waiting.pop(0)
        if name not in found:
            found[name] = None
            waiting += wired[name].inputs.values()
    return found
