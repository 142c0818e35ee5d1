"""What can be seen before a run: the region that is found, and the grid of points with their σ.

The stages themselves are run, at the first step only, so that a preview is what the run will give. It is done in a
process of its own, since it loads all numerics and may take long.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dicflow.app.project import Project
from dicflow.core.photographs.outline import simple_outline
from dicflow.engine.graph import Graph, TaskInput
from dicflow.engine.plan import Plan
from dicflow.engine.product import Product
from dicflow.engine.references import load
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, StageError
from dicflow.kinds.correlation import Correlation
from dicflow.kinds.images import Images
from dicflow.kinds.region import Region, polygons_to_json
from dicflow.pipeline.registry import node_class
from dicflow.report.quality import advice_on

__all__ = ["Maker", "grid_preview", "proposed_region"]

_MOST_POINTS = 12_000
"""Points that are drawn; of more every second one, and so on."""
_DIGITS = 2


def proposed_region(project: Project, name: str, stage: str) -> dict[str, Any]:
    """A simple outline of what the stage ``region`` finds by itself, in pixels of the first left photograph.

    Raises StageError if the photograph shows no speckled specimen.
    """
    pipeline = project.pipeline(name)
    graph = pipeline.graph
    images = _source_of_photographs(graph, pipeline.instances[0][stage])
    steps = graph.steps[images]
    maker = Maker(graph, pipeline.plan("ignore"), pipeline.store)
    node: Any = node_class("region")
    early = _Early(
        maker, tuple((step, f"{images}/{step}") for step in (steps[k] for k in (1, 2, 4, 8, 16) if k < len(steps)))
    )
    window = getattr(graph.stages[pipeline.instances[0][stage]].node, "window", 32)
    first = maker.product(f"{images}/{steps[0]}")
    found = Region.read(node(window=window).run(images=first, images_early=early)).polygons
    return {"polygons": polygons_to_json(simple_outline(found, Images.read(first).left.shape, window), _DIGITS)}


def grid_preview(project: Project, name: str, text: str, stage: str) -> dict[str, Any]:
    """The points of a stage ``correlate`` at the first step, with a text of the pipeline file that may not be saved.

    ``points``: places [px] and whether each can be followed, thinned to what can be drawn; ``count`` and ``valid`` of
    all; ``subset_size`` and ``step_size``; ``sigma_px``: median σ of a displacement of one step along x and y by the
    noise; ``noise_grey``; ``advice``: sentences on the speckles, each with whether it is good; ``speckle_px``.
    Raises the error with which the stage would fail.
    """
    pipeline = project.candidate(name, text)
    if pipeline.document.data["stages"].get(stage, {}).get("stage") != "correlate":
        raise ConfigurationError(f"{stage}: a preview needs a stage 'correlate'; choose one")
    graph, instance = pipeline.graph, pipeline.instances[0][stage]
    maker = Maker(graph, pipeline.plan("ignore"), pipeline.store)
    first = f"{instance}/{graph.steps[instance][0]}"
    task = graph.tasks[first]
    found = Correlation.read(maker.product(first))
    images, region = (maker.product(str(task.inputs[port])) for port in ("images", "region"))
    speckle = _pattern(Images.read(images).left, Region.read(region))
    valid = found["status"] == 0
    inside = np.isfinite(found["xy"]).all(axis=-1)
    sigma = np.sqrt(2.0 * np.median(found["template"][valid][:, [0, 2]].astype(float), axis=0))
    return {
        **_drawn(found["xy"], inside, valid),
        "count": int(inside.sum()),
        "valid": int(valid.sum()),
        **found.grid._asdict(),
        "sigma_px": [float(value) for value in sigma],
        "noise_grey": found.noise_grey,
        "noise_source": found.noise_source,
        "speckle_px": speckle["size_px"],
        "advice": advice_on(speckle, found.grid.subset_size),
        "as_taken": Images.read(images).as_taken,
    }


def _pattern(grey: np.ndarray, region: Region) -> dict[str, float | None]:
    """Size [px], gradient [grey levels of 255 per px], contrast and saturated share of a pattern; None if unknown."""
    from dicflow.core.photographs.region import interior
    from dicflow.core.photographs.texture import mean_intensity_gradient, saturated_share, speckle_size

    inside = interior(region.polygons, grey.shape)
    levels = grey[inside].astype(float)
    found = {
        "size_px": speckle_size(grey, inside),
        "gradient": mean_intensity_gradient(grey, inside),
        "contrast": float(levels.std() / max(levels.mean(), 1e-12)),
        "saturated": saturated_share(grey, inside),
    }
    return {name: value if np.isfinite(value) else None for name, value in found.items()}


def _drawn(places: np.ndarray, inside: np.ndarray, valid: np.ndarray) -> dict[str, Any]:
    """Places [px] of the grid as lists, and whether each is valid."""
    stride = 1
    while inside[::stride, ::stride].sum() > _MOST_POINTS:
        stride += 1
    part = (slice(None, None, stride),) * 2
    chosen = inside[part]
    points = places[part][chosen].round(_DIGITS).tolist()
    return {"points": points, "is_valid": valid[part][chosen].tolist(), "stride": stride}


def _source_of_photographs(graph: Graph, stage: str) -> str:
    """The stage ``images`` that a stage descends from."""
    while not graph.files.get(stage):
        inputs = graph.stages[stage].inputs
        stage = inputs["images"] if "images" in inputs else next(iter(inputs.values()))
    return stage


class Maker:
    """Gives products of tasks: from the store, else by running the stage here; nothing is stored."""

    def __init__(self, graph: Graph, plan: Plan, store: Store) -> None:
        self.graph, self.plan, self.store = graph, plan, store
        self._made: dict[str, Product] = {}

    def product(self, name: str) -> Product:
        """The product of a task. Raises StageError with the stage's name in front."""
        if name not in self._made:
            entry = self.plan.entries[name]
            self._made[name] = load(self.store, entry.ref) if entry.ref is not None else self._run(name)
        return self._made[name]

    def _run(self, name: str) -> Product:
        task = self.graph.tasks[name]
        inputs = {port: self._opened(source) for port, source in task.inputs.items()}
        try:
            return task.node.run(**inputs, **task.files)
        except StageError as error:
            raise StageError(f"{name}: {error}") from error

    def _opened(self, source: TaskInput) -> Any:
        if source is None or isinstance(source, str):
            return None if source is None else self.product(source)
        return _Early(self, source)


class _Early(Sequence[Product]):
    """Products of several steps, each made when it is used."""

    def __init__(self, maker: Maker, tasks: tuple[tuple[str, str], ...]) -> None:
        self._maker, self._tasks = maker, tasks

    @property
    def steps(self) -> tuple[str, ...]:
        return tuple(step for step, _ in self._tasks)

    def __len__(self) -> int:
        return len(self._tasks)

    def __getitem__(self, place: Any) -> Any:
        return self._maker.product(self._tasks[place][1])
