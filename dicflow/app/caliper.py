"""The comparison with a caliper: what is compared, its table with uncertainties, and lengths that a person types."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dicflow.app.document import problems, read_pipeline
from dicflow.app.drawing import photographs_of, stages_of
from dicflow.app.project import Project
from dicflow.app.versions import change, digest_of
from dicflow.comparison.caliper import caliper_uncertainty, reading_step
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.caliper import Caliper, read_caliper
from dicflow.io.edited_yaml import Edit, edited
from dicflow.kinds.comparison import Comparison
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline, Result

__all__ = ["comparison_of", "write_lengths"]

_FILE, _STAGE = "caliper.csv", "compare"
_HEAD = "# One row per step: load on the specimen [g], length between the places that the caliper touches [mm]."
_MOST_TABLES = 20
_MOST_BYTES = 1_000_000
_PHASES = ("loading", "unloading")


def comparison_of(project: Project, name: str) -> dict[str, Any]:
    """The stage ``compare`` of a pipeline file, and what it came to.

    ``stage``: its name, "" without one; ``file``: the caliper's table, its ``digest`` and its ``lengths``, None before
    they are written; ``files``: all tables of a caliper in the folder; ``extensometer``: the one that is compared, and
    ``extensometers``: those of the probes; ``steps``: names of all steps; ``rows``: of the comparison, None before it
    is computed; ``read_mm``: the step in which the caliper was read.
    """
    pipeline = project.pipeline(name)
    stage = next(iter(stages_of(pipeline, "compare")), "")
    values = _values(pipeline, stage) if stage else {}
    file = str(values.get("caliper") or _FILE)
    table = _read(project.data_path(file))
    result = pipeline.result()
    return {
        "stage": stage,
        "file": file,
        "digest": digest_of(project, project.name_of(project.data_path(file))),
        "files": _tables(project),
        "lengths": None if table is None else _typed(table),
        "read_mm": None if table is None else reading_step(table.length_mm),
        "extensometer": values.get("extensometer"),
        "extensometers": _extensometers(pipeline),
        "steps": _steps(pipeline),
        "rows": _rows(result, stage, values, table) if stage and result.has(stage) else None,
    }


def _values(pipeline: Pipeline, stage: str) -> Mapping[str, Any]:
    found: Mapping[str, Any] = pipeline.resolved()["stages"][pipeline.instances[0][stage]]
    return found


def _read(path: Path) -> Caliper | None:
    try:
        return read_caliper(path)
    except InputError:
        return None


def _tables(project: Project) -> list[str]:
    """Names of the caliper's tables in the folder of the photographs."""
    files = [path for path in sorted(project.data_folder.glob("*.csv")) if path.stat().st_size <= _MOST_BYTES]
    return [path.name for path in files[:_MOST_TABLES] if _read(path) is not None]


def _typed(table: Caliper) -> list[dict[str, Any]]:
    columns = zip(table.phase, table.load_g.tolist(), table.length_mm.tolist(), strict=True)
    return [{"phase": phase, "load_g": load, "length_mm": length} for phase, load, length in columns]


def _extensometers(pipeline: Pipeline) -> list[str]:
    probes = stages_of(pipeline, "probes")
    return list(_values(pipeline, probes[0])["extensometers"] or ()) if probes else []


def _steps(pipeline: Pipeline) -> list[str]:
    """Names of the steps of the test: those of the photographs that the total comes from."""
    totals = [one for one in pipeline.instances[0] if one in stages_of(pipeline, "deformation")] or stages_of(
        pipeline, "correlate"
    )
    source = photographs_of(pipeline, totals[0]) if totals else next(iter(pipeline.graph.files))
    return list(pipeline.graph.steps[pipeline.instances[0][source]])


def _rows(
    result: Result, stage: str, values: Mapping[str, Any], caliper: Caliper | None
) -> list[dict[str, float | str | None]]:
    """The comparison, with the uncertainty of its strains and of their differences; None where a number is unknown."""
    table = Comparison.read(result.product(stage))
    u_dic = _uncertainty(result, values.get("extensometer"), len(table.rows))
    u_caliper = np.zeros(len(table.rows)) if caliper is None else caliper_uncertainty(caliper.length_mm)
    return [
        {
            **row,
            "u_strain": _known(u_dic[k]),
            "u_difference": _known(math.hypot(u_dic[k], u_caliper[k])) if len(u_caliper) > k else None,
        }
        for k, row in enumerate(table.rows)
    ]


def _uncertainty(result: Result, extensometer: str | None, count: int) -> np.ndarray:
    """Combined standard uncertainty of an extensometer's strain (step,), 0 at the first; NaN for what has none."""
    unknown = np.full(count, np.nan)
    probes = next((one for one in result.stages_of("probes") if result.has(one)), None)
    if extensometer is None or probes is None:
        return unknown
    table = ProbeTable.read(result.product(probes))
    if extensometer not in table.extensometers:
        return unknown
    found = table.of_extensometer(extensometer, "u_strain").copy()
    if "calibration_strain" in table:
        found = np.hypot(found, np.nan_to_num(table.of_extensometer(extensometer, "calibration_strain")))
    found[0] = 0.0
    return np.asarray(found)


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def write_lengths(
    project: Project, name: str, lengths: Sequence[Mapping[str, Any]], seen: Mapping[str, str]
) -> dict[str, Any]:
    """Write the lengths that a person has read from the caliper, and let the pipeline compare with them.

    lengths : of each step ``phase``, ``load_g`` and ``length_mm``, as typed
    seen : digests of the pipeline file and of the table as the page has them
    Returns the name of the ``file``. Raises ConfigurationError for what is no number or does not fit the steps.
    """
    pipeline = project.pipeline(name)
    steps = _steps(pipeline)
    if len(lengths) != len(steps):
        raise ConfigurationError(f"{len(lengths)} lengths for {len(steps)} steps; give the length at every step")
    stage = next(iter(stages_of(pipeline, "compare")), "")
    file = str(_values(pipeline, stage)["caliper"]) if stage else _FILE
    lines = [_line(step, row) for step, row in zip(steps, lengths, strict=True)]
    new = {project.name_of(project.data_path(file)): "\n".join([_HEAD, "phase,load_g,length_mm", *lines, ""]).encode()}
    if not stage:
        new[name] = _with_stage(project, pipeline, name, file).encode()
    change(project, seen, new, f"lengths of the caliper in {file}")
    return {"file": file}


def _line(step: str, row: Mapping[str, Any]) -> str:
    load, length = (_number(step, row[key], words) for key, words in (("load_g", "load"), ("length_mm", "length")))
    if float(length) <= 0.0:
        raise ConfigurationError(f"{step}: the length must be above 0 mm; type what the caliper shows")
    phase = row["phase"] if row["phase"] in _PHASES else _PHASES[0]
    return f"{phase},{load},{length}"


def _number(step: str, typed: Any, words: str) -> str:
    """A number as it was typed, with a decimal point."""
    text = str(typed).strip().replace(",", ".")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < 0.0:
        raise ConfigurationError(f"{step}: the {words} '{typed}' is no number; type it as 12.5")
    return text


def _with_stage(project: Project, pipeline: Pipeline, name: str, file: str) -> str:
    """The text of a pipeline file with a stage that compares. Raises ConfigurationError if it cannot have one."""
    extensometers = _extensometers(pipeline)
    stage = {"stage": "compare", "caliper": file, **({"extensometer": extensometers[0]} if extensometers else {})}
    taken = pipeline.document.data["stages"]
    free = next(one for one in (_STAGE, *(f"{_STAGE}_{k}" for k in range(2, 99))) if one not in taken)
    source = str(project.path(name))
    new = edited(read_pipeline(project, name).text, source, [Edit(("stages", free), stage)])
    if left := problems(new, source):
        raise ConfigurationError("\n".join(left))
    return new
