"""Sides of a comparison: the stored products of a pipeline or a run, or a table of points.

Each gives its fields at the places that the points had in the left photograph of the first step, so that measurements
on different grids, in rectified or raw photographs, meet.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from dicflow.engine.journal import RunInfo, find_run, is_run_id
from dicflow.engine.product import Product
from dicflow.engine.references import Ref, load
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, StoreError
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total
from dicflow.kinds.track import Track
from dicflow.pipeline.pipeline import Pipeline
from dicflow.pipeline.places import to_left_photograph
from dicflow.pipeline.recipes import run_refs
from dicflow.pipeline.resolved import instances_of, kept_settings

if TYPE_CHECKING:
    import numpy as np

    from dicflow.io.points_table import PointTable

__all__ = ["Field", "MeasuredSide", "Side", "TableSide", "open_sides", "settings_of"]

_NUMBERED = re.compile(r"(.+)#(\d+)")
Names = tuple[str, str | None]
"""A stage as the file names it, and a step."""


class Field(NamedTuple):
    """Everything measured at one step.

    places : (..., 2) px of the left photograph at the first step
    values, sigmas : quantity → (...), NaN if unknown
    units : quantity → unit, if known; titles : quantity → measure, if known
    """

    places: np.ndarray
    values: Mapping[str, np.ndarray]
    sigmas: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    titles: Mapping[str, str]


class Side(Protocol):
    """One of two measurements.

    settings : parameters and inputs of each stage by its name in the file; None for a table
    steps : names of the steps that have a field; empty for a table, which may be compared with any step
    notes : whole sentences about where it comes from
    """

    @property
    def label(self) -> str: ...
    @property
    def settings(self) -> Mapping[str, Any] | None: ...
    @property
    def steps(self) -> tuple[str, ...]: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    def field(self, step: str) -> Field: ...


class TableSide(NamedTuple):
    """A table of points."""

    label: str
    table: PointTable
    settings: None = None
    steps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def field(self, step: str) -> Field:
        """The table, for any step."""
        table = self.table
        return Field(table.xy, table.values, table.sigmas, table.units, {})


class MeasuredSide(NamedTuple):
    """One variant of a pipeline or of a run.

    store : holds the products
    total : the stage whose fields are compared
    refs : stage and step → product
    """

    label: str
    settings: Mapping[str, Any]
    store: Store
    total: str
    refs: Mapping[Names, Ref]
    notes: tuple[str, ...] = ()

    @property
    def steps(self) -> tuple[str, ...]:
        """Steps that have a total, in natural order of their names."""
        from dicflow.io.images import natural_key

        return tuple(sorted((step or "" for stage, step in self.refs if stage == self.total), key=natural_key))

    def field(self, step: str) -> Field:
        """All fields of a step on the grid of its total."""
        import numpy as np

        total = Total.read(self._product(self.total, step))
        real = [name for name in total.fields if np.issubdtype(total[name].dtype, np.floating)]
        known = {name: np.asarray(total[name], dtype=np.float64) for name in real}
        return Field(
            self._places(total),
            known,
            {name.removeprefix("sigma_"): values for name, values in known.items() if name.startswith("sigma_")},
            {name: total.unit_of(name) for name in real},
            {name: total.title(name) for name in real},
        )

    def _places(self, total: Total) -> np.ndarray:
        """Where the points were in the left photograph of the first step [px]."""
        from dicflow.core.cameras.camera import project

        if "xy_reference" in total:
            return total["xy_reference"]
        rig = self._first("rig")
        cameras = None if rig is None else CalibratedRig.read(rig).cameras
        if total.follows_material:
            points = self._grid()
        else:  # on a grid of its own at each step
            places = total["xyz_reference"]
            if total.in_space and cameras is not None:
                return project(cameras.left, places)
            points = places[..., :2]
        mapping = to_left_photograph("rectified" if total.in_space else "plane", cameras)
        return points if mapping is None else mapping(points)

    def _grid(self) -> np.ndarray:
        """The material grid at the first step, in the tracked image [px]."""
        track = self._first("track")
        if track is None:
            raise StoreError(f"{self.label}: the tracked points of the first step are not in the store; run again")
        return Track.read(track)["points"]

    def _first(self, kind: str) -> Product | None:
        """The product of a kind, of the first step if it has steps."""
        found = _stage_of(self.store, self.refs, kind)
        if found is None:
            return None
        from dicflow.io.images import natural_key

        steps = [step for stage, step in self.refs if stage == found]
        return self._product(found, min(steps, key=lambda step: natural_key(step or "")))

    def _product(self, stage: str, step: str | None) -> Product:
        ref = self.refs[stage, step]
        state, manifest = self.store.inspect(ref.digest)
        what = stage if step is None else f"{stage}/{step}"
        if state != "complete" or manifest is None:
            raise StoreError(f"{self.label}: {what} is no longer in {self.store.path}; run the pipeline again")
        if ref.lost:
            raise StoreError(
                f"{self.label}: {what} was not kept, and cannot be made again by this version of dicflow; run the "
                "pipeline again and name its file"
            )
        return load(self.store, ref)


def open_sides(a: str, b: str, store: Path | None = None, data: Path | None = None) -> tuple[Side, Side]:
    """Two measurements by the names that a user gives.

    a, b : a pipeline file, for its stored products; the id of a run; or a table of points. ``#2`` behind a
        file or an id selects the second variant of a sweep
    store : folder of the products; default ``.dicflow`` beside each pipeline file, for a run beside the other side's
    data : folder where relative paths of the pipeline files start; default their own
    Raises ConfigurationError, InputError or StoreError that says what was expected.
    """
    return _open(a, b, store, data), _open(b, a, store, data)


def _open(text: str, other: str, store: Path | None, data: Path | None) -> Side:
    name, variant = _parted(text)
    path = Path(name)
    if is_run_id(name):
        beside = Path(_parted(other)[0])
        near = beside.parent if beside.suffix in (".yaml", ".yml") else Path()
        return _run_side(text, name, variant, Store.open(store or near / ".dicflow", create=False))
    if path.suffix in (".yaml", ".yml"):
        return _pipeline_side(text, variant, Pipeline.load(path, data=data, store=store))
    if not path.is_file():
        raise ConfigurationError(
            f"{text}: is neither a file nor the id of a run; name a pipeline, a run, or a table of points"
        )
    from dicflow.io.points_table import read_points

    return TableSide(path.name, read_points(path))


def _parted(text: str) -> tuple[str, int]:
    """A name, and the index of the variant; the number behind # counts from 1."""
    if (match := _NUMBERED.fullmatch(text)) and not Path(text).exists():
        return match[1], int(match[2]) - 1
    return text, 0


def _pipeline_side(text: str, variant: int, pipeline: Pipeline) -> MeasuredSide:
    result, resolved = pipeline.result(), pipeline.resolved()
    settings = settings_of(text, resolved, variant)
    tasks = [(stage, step) for stage in result.stages for step in result.steps(stage) or (None,)]
    refs = {
        (stage, step): result.ref(stage, step, variant) for stage, step in tasks if result.has(stage, step, variant)
    }
    side = _measured(_label(pipeline.path.name, resolved, variant), settings, pipeline.store, refs)
    return side._replace(notes=result.notes)


def _run_side(text: str, name: str, variant: int, store: Store) -> MeasuredSide:
    run: RunInfo = find_run(store, name)
    resolved = kept_settings(run)
    settings = settings_of(text, resolved, variant)
    instances = instances_of(resolved)[variant]
    tasks = [(*task.partition("/")[::2], ref) for task, ref in run_refs(store, run).items()]
    refs = {
        (stage, step or None): ref
        for stage, instance in instances.items()
        for owner, step, ref in tasks
        if owner == instance
    }
    return _measured(_label(f"{run.pipeline} {name}", resolved, variant), settings, store, refs)


def _measured(label: str, settings: Mapping[str, Any], store: Store, refs: Mapping[Names, Ref]) -> MeasuredSide:
    total = _stage_of(store, refs, "total")
    if total is None:
        raise StoreError(f"{label}: {store.path} holds no displacement or strain of it; run the pipeline first")
    return MeasuredSide(label, settings, store, total, refs)


def _stage_of(store: Store, refs: Mapping[Names, Ref], kind: str) -> str | None:
    """The last stage that gives a kind of product; None if the store holds no such product."""
    examples = {stage: ref.digest for (stage, _), ref in refs.items()}
    for stage in reversed(examples):
        manifest = store.manifest(examples[stage])
        if manifest is not None and manifest.content["kind"] == kind:
            return stage
    return None


def settings_of(text: str, resolved: Mapping[str, Any], variant: int) -> dict[str, Any]:
    """Parameters and inputs of a variant's stages, all by their names in the file."""
    variants = instances_of(resolved)
    if not 0 <= variant < len(variants):
        raise ConfigurationError(
            f"{text}: there are {len(variants)} variants, counted from 1; write one of them behind #"
        )
    names = {instance: stage for stage, instance in variants[variant].items()}
    stages = {stage: dict(resolved["stages"][instance]) for stage, instance in variants[variant].items()}
    for entry in stages.values():
        entry["inputs"] = {port: names.get(producer, producer) for port, producer in entry["inputs"].items()}
    return stages


def _label(name: str, resolved: Mapping[str, Any], variant: int) -> str:
    """The name, and of a sweep the variant with its values."""
    values: Iterable[tuple[str, Any]] = resolved["variants"][variant].items() if resolved["variants"] else ()
    chosen = ", ".join(f"{key} = {value}" for key, value in values)
    return f"{name}#{variant + 1} ({chosen})" if chosen else name
