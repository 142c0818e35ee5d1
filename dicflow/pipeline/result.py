"""The products of a run, by the names of the pipeline file."""

from __future__ import annotations

import difflib
import importlib
import math
import re
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.engine.graph import Graph
from dicflow.engine.lazy import lazy_dataset, open_group
from dicflow.engine.node import Node, Scope
from dicflow.engine.product import Product
from dicflow.engine.references import Ref, can_be_read, load
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, DicflowError
from dicflow.kinds.kind import rows_of, summary_of
from dicflow.kinds.status import STATUS_NAME, status_attributes
from dicflow.pipeline.coordinates import with_places, with_steps
from dicflow.pipeline.notebook import table_html

if TYPE_CHECKING:
    import pandas
    import xarray
    import zarr

    from dicflow.engine.execute import RunResult

__all__ = ["ArrayFacts", "Result"]

Variant = int | str
"""A variant of a sweep: "#2" as tables, reports and the command line name the second one, or its index, which is 1."""
_NAME = re.compile(r"#([1-9]\d{0,5})")
_TABLES = ("channels", "comparison", "curve", "material", "noise", "probes")
"""Kinds of product that are tables."""
_VIEW = "dicflow.explorer.page:Explorer"
"""``module:class`` that shows a result; it belongs to a layer above, and is loaded when somebody asks for it."""


class ArrayFacts(NamedTuple):
    """An array of a product.

    digest : of its contents
    shape : lengths of its axes
    dtype : of its values, as numpy writes it
    """

    digest: str
    shape: tuple[int, ...]
    dtype: str


class Result:
    """Products by stage and step, of one variant or of several.

    A variant is chosen by its name, "#1" for the first one as in tables, reports and on the command line, or by its
    index in ``values`` and :meth:`table`, which counts from 0 as all of Python does.
    ``outcome`` is what the run did, None if nothing was run. ``graph`` has the stages and steps, ``notes`` whole
    sentences about where the products come from. :func:`dicflow.plot` draws them, :meth:`view`
    shows their fields in a notebook.
    """

    def __init__(
        self,
        graph: Graph,
        store: Store,
        refs: Mapping[str, Ref],
        instances: Sequence[Mapping[str, str]],
        values: Sequence[Mapping[str, Any]],
        outcome: RunResult | None,
        notes: Sequence[str] = (),
    ) -> None:
        self.graph, self._store, self._refs, self._instances = graph, store, refs, instances
        self.values, self.outcome, self.notes = values, outcome, tuple(notes)

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages in the file."""
        return tuple(self._instances[0])

    def variant(self, which: Variant) -> Result:
        """One variant alone. Raises ConfigurationError for one that does not exist."""
        place = self._place(which)
        alone = ([self._instances[place]], [self.values[place]])
        return Result(self.graph, self._store, self._refs, *alone, self.outcome, self.notes)

    def of_one_test(self) -> Result:
        """The same without other specimens, where a file measures several: the one that maps draw, else the last.

        Stages that they share, such as the calibration, and what is known of their material stay.
        """
        if len({self.source(region, "images") for region in self.stages_of("region")}) < 2:
            return self
        totals = [self.source(stage, "total") for stage in self.stages_of("maps")] or self.stages_of("total")
        if not totals:
            return self
        chosen, names = self._instance(totals[-1], 0), self._instances[0]
        needed = self.graph.upstream([chosen]).stages
        kept = {stage for stage, instance in names.items() if self._belongs(stage, instance, chosen, needed)}
        instances = [{stage: one[stage] for stage in one if stage in kept} for one in self._instances]
        return Result(self.graph, self._store, self._refs, instances, self.values, self.outcome, self.notes)

    def _belongs(self, stage: str, instance: str, total: str, needed: Container[str]) -> bool:
        """Whether a stage has no photographs but those that a total needs, or takes that total, or is of a material."""
        if self.kind(stage) in ("curve", "material"):
            return True
        above = self.graph.upstream([instance]).stages
        return total in above or all(one in needed for one, spec in above.items() if spec.node.gives == "images")

    def noted(self, note: str) -> Result:
        """The same with one more sentence about where the products come from."""
        notes = (*self.notes, note)
        return Result(self.graph, self._store, self._refs, self._instances, self.values, self.outcome, notes)

    @property
    def refs(self) -> Mapping[str, Ref]:
        """Task → reference of its product, for all products in the store."""
        return self._refs

    def steps(self, stage: str, variant: Variant = 0) -> tuple[str, ...]:
        """Names of the steps of a stage; empty for one that runs once. Variants may have photographs of their own."""
        return self.graph.steps[self._instance(stage, variant)]

    def number(self, stage: str, step: str | None, variant: Variant = 0) -> int:
        """Number of a step in the test; the first photograph has 0, and so has a stage that runs once."""
        instance = self._instance(stage, variant)
        if step not in self.graph.steps[instance]:
            return 0
        return self.graph.steps[instance].index(step) + int(self.graph.stages[instance].node.scope is Scope.PAIR)

    def kind(self, stage: str) -> str:
        """The kind of product that a stage gives."""
        return self.graph.stages[self._instance(stage, 0)].node.gives

    def node(self, stage: str, variant: int = 0) -> Node:
        """The stage with its parameters."""
        return self.graph.stages[self._instance(stage, variant)].node

    @property
    def store_folder(self) -> Path:
        """Where the products are kept."""
        return self._store.path

    def source(self, stage: str, port: str, variant: Variant = 0) -> str:
        """The stage in the file that feeds a port of another."""
        names = self._instances[self._place(variant)]
        producer = self.graph.stages[names[stage]].inputs[port]
        return next(name for name, instance in names.items() if instance == producer)

    def stages_of(self, kind: str) -> list[str]:
        """Stages that give a kind of product."""
        return [stage for stage in self.stages if self.kind(stage) == kind]

    def has(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> bool:
        """Whether the product is stored, or can be made again."""
        ref = self._refs.get(self.task(stage, step, variant))
        return ref is not None and not ref.lost

    def can_be_read(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> bool:
        """Whether the product is stored, or the files that it is made of again are there."""
        return self.has(stage, step, variant) and can_be_read(self._store, self.ref(stage, step, variant))

    def digest(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> str:
        """Digest of the product's contents."""
        return self.ref(stage, step, variant).digest

    @property
    def digests(self) -> dict[str, str]:
        """Task → digest of its product, for all products in the store."""
        return {task: ref.digest for task, ref in sorted(self._refs.items())}

    def product(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> Product:
        """One product; its arrays are read when they are first used.

        step : name or number of the step, None for a stage that runs once
        variant : of a sweep: "#2" for the second one, or its index, which is 1
        Raises ConfigurationError for a name that does not exist and lists those that do, DicflowError for a product
        that was not computed.
        """
        return load(self._store, self.ref(stage, step, variant))

    def arrays(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> dict[str, ArrayFacts]:
        """What is known of each array of a product; none is read or made again. Raises as :meth:`product` does."""
        variables: Mapping[str, Any] = self._content(stage, step, variant)["variables"]
        return {name: ArrayFacts(one["digest"], tuple(one["shape"]), one["dtype"]) for name, one in variables.items()}

    def attributes(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> Mapping[str, Any]:
        """Attributes of a product; no array is read or made again. Raises as :meth:`product` does."""
        found: Mapping[str, Any] = self._content(stage, step, variant)["attrs"]
        return found

    def _content(self, stage: str, step: str | int | None, variant: Variant) -> Mapping[str, Any]:
        """What the store says of a product."""
        manifest = self._store.manifest(self.ref(stage, step, variant).digest)
        if manifest is None:
            raise DicflowError(f"{self.task(stage, step, variant)} is no longer in the store; run the pipeline again")
        return manifest.content

    def dataset(
        self, stage: str, step: str | int | None = None, variant: Variant = 0, *, chunks: Any = None
    ) -> xarray.Dataset:
        """One product as an xarray dataset; with ``chunks`` all steps, whose arrays dask reads when they are used.

        chunks : as in xarray: "auto" for one chunk per array and step, or lengths by dimension; only without a step
        Coordinates are ``step``, the number in the test, which is 0 for the first photograph, so that ``sel(step=5)``
        is that of the sixth; ``step_name``; ``time`` [s] and ``load`` where they are known; and of points their places
        at the first step: ``x_px`` (col), ``y_px`` (row), and ``x_mm``, ``y_mm``, ``z_mm`` (row, col).
        The status of points has ``flag_values`` and ``flag_meanings``.
        Raises ConfigurationError for chunks of one step, and if the shape of an array differs between steps.
        """
        if chunks is None:
            dataset = with_places(_with_flags(self.product(stage, step, variant).to_dataset()))
            names = self._named(stage, step, variant)
            return with_steps(dataset, self, stage, names, variant) if names else dataset
        if step is not None:
            raise ConfigurationError("chunks are for all steps of a stage at once; leave out the step, or the chunks")
        refs = {name: self.ref(stage, name, variant) for name in self.steps(stage, variant)}
        if not refs:
            raise ConfigurationError(f"{stage} runs once and has no steps; leave out the chunks")
        dataset = with_places(_with_flags(lazy_dataset(self._store, refs)))
        dataset = dataset if chunks == "auto" else dataset.chunk(chunks)
        return with_steps(dataset, self, stage, list(refs), variant)

    def to_dataframe(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> pandas.DataFrame:
        """The table of a product, such as that of the probes: a column's name ends in its unit.

        Raises ConfigurationError for a product that is no table, and as :meth:`product` does.
        """
        import pandas

        rows = rows_of(self.product(stage, step, variant))
        if rows is None:
            tables = ", ".join(name for name in self.stages if self.node(name).gives in _TABLES) or "none here"
            raise ConfigurationError(
                f"{stage} gives a product of kind {self.kind(stage)}, which is not a table; read it with dataset(), or "
                f"name a stage with a table: {tables}"
            )
        return pandas.DataFrame(list(rows))

    def open(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> zarr.Group:
        """One product as a group of zarr's arrays, read-only. Raises as :meth:`product` does."""
        return open_group(self._store, self.ref(stage, step, variant))

    def __repr__(self) -> str:
        return f"<dicflow.Result: {self._size}; {self._stored}>"

    def _repr_html_(self) -> str:
        rows = [
            (stage, self.node(stage).title, self.kind(stage), len(self.steps(stage)) or "") for stage in self.stages
        ]
        return table_html(f"Result: {self._size}; {self._stored}", ("stage", "does", "gives", "steps"), rows)

    @property
    def _size(self) -> str:
        """``14 stages, 2 variants``."""
        count = len(self.values)
        return f"{len(self.stages)} stages" + (f", {count} variants" if count > 1 else "")

    @property
    def _stored(self) -> str:
        """``83 of 83 products stored``."""
        instances = {instance for names in self._instances for instance in names.values()}
        tasks = [name for name, task in self.graph.tasks.items() if task.stage in instances]
        return f"{sum(name in self._refs for name in tasks)} of {len(tasks)} products stored"

    def _named(self, stage: str, step: str | int | None, variant: Variant) -> list[str]:
        """Name of the one step of a product; empty for a stage that runs once."""
        names = self.steps(stage, variant)
        return [names[step] if isinstance(step, int) else str(step)] if names else []

    def table(self) -> list[dict[str, Any]]:
        """One row per variant: the values of the sweep, then the scalars of every stage, as means over its steps."""
        return [{**values, **self._scalars(variant)} for variant, values in enumerate(self.values)]

    def task(self, stage: str, step: str | int | None, variant: Variant) -> str:
        """Name of the task that gives a product."""
        instance = self._instance(stage, variant)
        steps = self.graph.steps[instance]
        if not steps:
            if step is not None:
                raise ConfigurationError(f"{stage} runs once and has no steps; leave the step out")
            return instance
        if step is None:
            raise ConfigurationError(f"{stage} has steps; name one, as in {stage}/{steps[0]}, of {_listed(steps)}")
        if isinstance(step, int) and -len(steps) <= step < len(steps):
            step = steps[step]
        if f"{instance}/{step}" not in self.graph.tasks:
            raise ConfigurationError(f"{stage} has no step '{step}'; it has {_listed(steps)}")
        return f"{instance}/{step}"

    def view(self) -> Any:
        """The fields in an explorer: a notebook shows it, and its ``html`` is a page that stands alone.

        Raises DicflowError where a product was not computed.
        """
        module, _, name = _VIEW.partition(":")
        return getattr(importlib.import_module(module), name)(self)

    def _place(self, variant: Variant) -> int:
        """Index of a variant."""
        count = len(self._instances)
        found = _NAME.fullmatch(variant) if isinstance(variant, str) else None
        place = int(found[1]) - 1 if found else variant
        if isinstance(place, str) or not 0 <= place < count:
            named = f"'{variant}'" if isinstance(variant, str) else f"with index {variant}"
            known = "there is one, '#1' or index 0" if count == 1 else f"'#1' to '#{count}', or index 0 to {count - 1}"
            raise ConfigurationError(f"no variant {named}: {known}")
        return place

    def _instance(self, stage: str, variant: Variant) -> str:
        names = self._instances[self._place(variant)]
        if stage not in names:
            near = difflib.get_close_matches(stage, self.stages, n=1)
            hint = f", did you mean '{near[0]}'?" if near else ""
            raise ConfigurationError(f"no stage '{stage}'{hint}; stages: {', '.join(self.stages)}")
        return names[stage]

    def ref(self, stage: str, step: str | int | None = None, variant: Variant = 0) -> Ref:
        """Reference by which the store, also in another process, loads a product."""
        task = self.task(stage, step, variant)
        if task not in self._refs:
            raise DicflowError(
                f"{task} is not in the store; run the pipeline first, 'dicflow plan' says what is missing"
            )
        return self._refs[task]

    def _scalars(self, variant: int) -> dict[str, float]:
        columns: dict[str, float] = {}
        for stage in self.stages:
            names = [step for step in self.steps(stage, variant) or (None,) if self.has(stage, step, variant)]
            summaries = [summary_of(self.product(stage, step, variant)) for step in names]
            for key in dict.fromkeys(key for summary in summaries for key in summary):
                numbers = [summary[key] for summary in summaries if isinstance(summary.get(key), int | float)]
                finite = [number for number in numbers if math.isfinite(number)]
                if finite:
                    columns[f"{stage}.{key}"] = sum(finite) / len(finite)
        return columns


def _with_flags(dataset: xarray.Dataset) -> xarray.Dataset:
    """A dataset whose status says what its codes mean."""
    if STATUS_NAME in dataset:
        dataset[STATUS_NAME].attrs.update(status_attributes())
    return dataset


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 12 else f"{', '.join(names[:5])} … {names[-1]}"
