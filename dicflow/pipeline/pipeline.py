"""A pipeline: the file, its variants, and the graph they make."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dicflow.engine.files import FilePart
from dicflow.engine.graph import Graph, StageSpec, expand
from dicflow.engine.journal import Event, RunInfo, find_run, runs
from dicflow.engine.node import Node
from dicflow.engine.plan import CodePolicy, Plan, make_plan
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.configuration import Document, read
from dicflow.pipeline.notebook import table_html
from dicflow.pipeline.past import past_result
from dicflow.pipeline.report_facts import ReportFacts, report_facts
from dicflow.pipeline.resolved import kept_settings, resolved_of
from dicflow.pipeline.result import Result
from dicflow.pipeline.sweep import Variant, variants, with_settings
from dicflow.pipeline.wiring import Wired, wire

if TYPE_CHECKING:
    from dicflow.engine.execute import RunResult
    from dicflow.engine.node import Steps
    from dicflow.engine.references import Ref
    from dicflow.engine.running import Options

__all__ = ["Pipeline"]

_SETTINGS = ("stages", "variants")
"""Parts of the resolved pipeline that are equal in all runs of one measurement."""


@dataclass(frozen=True, repr=False)
class Pipeline:
    """A validated pipeline file.

    path : the file
    document : its content
    folder : where relative paths of photographs and tables start
    store_folder : where products are kept; both absolute, since workers may have another working directory
    only : names of the steps to keep, by the stage that starts their series; all steps of others
    found : the steps of each stage that starts a series, where they are known; else their folders are looked at
    """

    path: Path
    document: Document
    folder: Path
    store_folder: Path
    only: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    found: Mapping[str, Steps] | None = None

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        data: str | Path | None = None,
        store: str | Path | None = None,
        settings: Sequence[str] = (),
    ) -> Pipeline:
        """Read and validate a pipeline file.

        data : folder where the file's relative paths start; default the file's own
        store : folder for the products; default ``.dicflow`` beside the file
        settings : as after ``--set``: ``["surface.robust=LAR", "smooth.degree=1,2,3"]``; several values make a sweep

        Raises ConfigurationError that lists everything wrong with ``file:line:column``.
        """
        path = Path(path)
        document = read(path)
        document = with_settings(document, settings)
        folder = Path(data) if data is not None else path.parent
        if not folder.is_dir():
            raise ConfigurationError(f"{folder}: no such folder; --data names the folder that holds the photographs")
        store_folder = Path(store) if store is not None else path.parent / ".dicflow"
        pipeline = cls(path, document, folder.absolute(), store_folder.absolute())
        assert pipeline._wired
        return pipeline

    def __repr__(self) -> str:
        return f"<dicflow.Pipeline {self._size}>"

    def _repr_html_(self) -> str:
        rows = [
            (name, node.stage, ", ".join(dict.fromkeys(wired.inputs.values())), _settings(node))
            for name, wired in self._wired[0].items()
            for node in [wired.node]
        ]
        return table_html(f"Pipeline {self._size}", ("stage", "kind", "takes", "settings"), rows)

    @property
    def _size(self) -> str:
        """``pipeline.yaml: 14 stages, 2 variants``."""
        count = len(self.variants)
        return f"{self.path.name}: {len(self._wired[0])} stages" + (f", {count} variants" if count > 1 else "")

    @property
    def name(self) -> str:
        """The file's stem; results and runs carry it."""
        return self.path.stem

    @property
    def title(self) -> str:
        """The title that the file gives, else its name."""
        return str(self.document.data.get("title", self.name))

    @cached_property
    def facts(self) -> ReportFacts:
        """What the file's section ``report`` states of the test."""
        return report_facts(self.document)

    @cached_property
    def variants(self) -> list[Variant]:
        """Variants of the sweep; one without values if the file has no sweep."""
        return variants(self.document)

    @cached_property
    def _wired(self) -> list[dict[str, Wired]]:
        return [wire(variant.document) for variant in self.variants]

    @cached_property
    def _instances(self) -> tuple[list[dict[str, str]], dict[str, StageSpec]]:
        """Per variant: stage → instance; and the instances. Equal stages of several variants are one instance."""
        names: list[dict[str, str]] = []
        specs: dict[str, StageSpec] = {}
        known: dict[tuple[str, str, tuple[tuple[str, str], ...]], str] = {}
        for number, wired in enumerate(self._wired, start=1):
            names.append({})
            for stage in _in_order(wired):
                entry = wired[stage]
                inputs = {port: names[-1][producer] for port, producer in entry.inputs.items() if producer != stage}
                identity = (stage, entry.node.model_dump_json(), tuple(sorted(inputs.items())))
                if identity not in known:
                    known[identity] = stage if stage not in specs else f"{stage}@{number}"
                    only = self.only.get(stage, ())
                    specs[known[identity]] = StageSpec(entry.node, inputs, self.folder, entry.where, entry.places, only)
                names[-1][stage] = known[identity]
        return names, specs

    @property
    def instances(self) -> list[dict[str, str]]:
        """Per variant: name of a stage in the file → its name in the graph (``surface``, ``surface@2``)."""
        return self._instances[0]

    @cached_property
    def graph(self) -> Graph:
        """Every task of every variant.

        Raises InputError for photographs that are missing or that lie outside the folders this file may read.
        """
        assert self.searched is not None
        graph = expand(self._instances[1], self.found)
        for task in graph.tasks.values():
            self._check_inside(task.stage, task.files.values())
        return graph

    @cached_property
    def searched(self) -> Mapping[str, tuple[Path, ...]]:
        """Stage that starts a series → folders in which it looks. Raises InputError as :attr:`graph` does."""
        places = {name: spec.node.searches(spec.folder) for name, spec in self._instances[1].items()}
        for name, folders in places.items():
            self._check_inside(name, folders)
        return {name: folders for name, folders in places.items() if folders}

    @property
    def stages(self) -> Mapping[str, StageSpec]:
        """The stages of the graph by name."""
        return self._instances[1]

    def _check_inside(self, stage: str, files: Iterable[Path | FilePart]) -> None:
        """Raise InputError for a file or folder that lies outside those this pipeline may read."""
        for file in files:
            place = Path(file).resolve()
            if not any(place.is_relative_to(root) for root in self._roots):
                raise InputError(
                    f"{stage}: {file} lies outside the folder of {self.path.name}; a pipeline reads only "
                    "below its own folder, the working directory, and the folder given with --data"
                )

    @cached_property
    def _roots(self) -> list[Path]:
        return [root.resolve() for root in (self.path.parent, self.folder, Path.cwd())]

    @cached_property
    def store(self) -> Store:
        """The store, made if missing."""
        return Store.open(self.store_folder)

    def plan(self, code_policy: CodePolicy = "recompute", on_event: Callable[[Event], None] | None = None) -> Plan:
        """What is stored and what must be computed, with reasons. on_event : receives the progress of a large plan"""
        return make_plan(self.graph, self.store, pipeline=self.name, code_policy=code_policy, on_event=on_event)

    def run(self, **options: Any) -> Result:
        """Compute what is missing and return everything by name.

        options : fields of :class:`dicflow.engine.execute.Options`: ``scheduler``, ``workers``, ``dashboard``, …
        A script calls it under ``if __name__ == "__main__":``, since worker processes import the script again.
        """
        from dicflow.engine.execute import run

        chosen = self.options(**options)
        outcome = run(self.graph, self.store, pipeline=self.name, resolved=self.described(), options=chosen)
        refs = {name: done.ref for name, done in outcome.outcomes.items() if done.ref is not None}
        return self._result(refs, outcome)

    @staticmethod
    def options(**options: Any) -> Options:
        """How stages of dicflow are run. options : fields of :class:`dicflow.engine.running.Options`"""
        from dicflow.engine.running import Options
        from dicflow.stages._kernels import ahead, get_ready, uncompiled

        return Options(**{"worker_setup": get_ready, "uncompiled": uncompiled, "ahead": ahead, **options})

    def described(self) -> dict[str, Any]:
        """What a run keeps: :meth:`resolved`, the steps of each series, and the name of the folder with the files."""
        steps = {stage: list(files) for stage, files in self.graph.files.items()}
        return {**self.resolved(), "steps": steps, "data": self.folder.name}

    def result(self) -> Result:
        """The stored products of this pipeline; nothing is computed.

        If photographs or other files of the user cannot be used, these are the products of the last run with the same
        settings, and ``notes`` says so. Raises InputError if that run is unknown too.
        """
        try:
            plan = self.plan("ignore")
        except InputError as error:
            return self._last_result(error)
        refs = {name: entry.ref for name, entry in plan.entries.items() if entry.ref is not None}
        return self._result(refs, None)

    def past_result(self, run: str) -> Result:
        """The products of an earlier run in this store, of any pipeline and with any settings; nothing is computed.

        run : its id
        Products that were not kept are made again when they are read, also from photographs that are still there.
        ``notes`` says what is gone. Raises StoreError for a run that is unknown, or that this version cannot read.
        """
        try:
            found = list(self.result().refs.values())
        except InputError:
            found = []
        known = {ref.digest: ref for ref in found if not ref.lost}
        return past_result(self.store, find_run(self.store, run), known)

    def last_run(self) -> RunInfo | None:
        """The newest run with the same stages and settings; None before the first."""
        ours = self.resolved()
        return next((run for run in runs(self.store) if run.pipeline == self.name and _is_alike(run, ours)), None)

    def _result(self, refs: Mapping[str, Ref], outcome: RunResult | None) -> Result:
        values = [dict(variant.values) for variant in self.variants]
        return Result(self.graph, self.store, refs, self.instances, values, outcome)

    def _last_result(self, error: InputError) -> Result:
        """The products of the last run, without any of the files that it read."""
        run = self.last_run()
        resolved = {} if run is None else kept_settings(run)
        if run is None or not {"steps", "data"} <= resolved.keys():
            raise error
        found = past_result(self.store, run)
        source = f"run {run.id} of the files in '{resolved['data']}'"
        note = f"This is what {source} left in the store, without photographs; a file cannot be used: {error}."
        return found.noted(note)

    def resolved(self) -> dict[str, Any]:
        """The pipeline with every default written out, as a run keeps it.

        ``title``; ``stages``: parameters and inputs of each stage of the graph; ``variants``: values of the sweep;
        ``instances``: per variant the stage of the graph that stands for each stage in the file.
        """
        stages = {
            name: {**spec.node.model_dump(mode="json"), "inputs": dict(spec.inputs)}
            for name, spec in self._instances[1].items()
        }
        return {
            "title": self.title,
            "stages": stages,
            "variants": [dict(variant.values) for variant in self.variants],
            "instances": [dict(names) for names in self.instances],
        }


def _settings(node: Node) -> str:
    """Parameters that are not the default, as a pipeline file has them."""
    given = node.model_dump(mode="json", exclude_defaults=True, exclude={"stage"})
    return ", ".join(f"{name}: {json.dumps(value, ensure_ascii=False)}" for name, value in given.items())


def _in_order(wired: Mapping[str, Wired]) -> Iterable[str]:
    """Names of stages, each after those it takes from."""
    done: dict[str, None] = {}

    def visit(name: str) -> None:
        for producer in wired[name].inputs.values():
            if producer != name and producer not in done:
                visit(producer)
        done.setdefault(name)

    for name in wired:
        visit(name)
    return done


def _is_alike(run: RunInfo, ours: Mapping[str, Any]) -> bool:
    """Whether a run had these stages and settings, and its files are whole."""
    found = resolved_of(run)
    return found is not None and all(found[name] == ours[name] for name in _SETTINGS) and run.is_whole
