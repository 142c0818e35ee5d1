"""Results per step: lengths, displacements and strains beside the caliper's, as rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from dicflow.explorer.fields import TotalFields
from dicflow.explorer.reading import surveyed
from dicflow.explorer.survey import valid_share
from dicflow.kinds.channels import Channels, named_with_unit
from dicflow.kinds.comparison import Comparison
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.quantities import UNCERTAINTY, symbol_of
from dicflow.pipeline import Result
from dicflow.report.context import Context
from dicflow.report.step_summaries import step_summaries

__all__ = ["EXTENSOMETERS", "Column", "History", "step_history", "step_names"]

EXTENSOMETERS = "Extensometers"
"""Source of a history that extensometers give."""
_UNITS = {"_mm": "mm", "_px": "px", "_g": "g", "_pct": "%", "_per_s": "1/s"}
_TITLES = {
    "load_g": "load",
    "caliper_length": "length, caliper",
    "dic_length": "length, DIC",
    "caliper_displacement": "displacement, caliper",
    "dic_displacement": "displacement, DIC",
    "caliper_strain": "strain, caliper",
    "dic_strain": "strain, DIC",
    "sigma_strain": "σ of the strain",
    "displacement_error": "displacement error",
    "strain_error_pct": "strain error",
}


class Column(NamedTuple):
    """One column of numbers.

    key : name of the values in the product
    """

    key: str
    title: str
    unit: str


class History(NamedTuple):
    """One row per step.

    source : what the numbers are, in words
    steps, phases : names of the steps, and loading or unloading; phases are empty if unknown
    values : column's key → number per step, None if unknown
    drawn : keys of what belongs into one plot
    axis : key of what it is drawn over, the load or the time; empty for the steps
    valid_share : of each step but the first; None where it was not measured
    """

    source: str
    steps: tuple[str, ...]
    phases: tuple[str, ...]
    columns: tuple[Column, ...]
    values: Mapping[str, tuple[float | None, ...]]
    valid_share: tuple[float | None, ...]
    drawn: tuple[str, ...]
    remark: str = ""
    axis: str = ""


def step_history(context: Context) -> History | None:
    """The history of the comparison, else of the extensometers, else of the means of the field.

    None for a pipeline without totals. A step that is not there has no numbers.
    """
    result = context.result
    totals = result.stages_of("total")
    if not totals:
        return None
    total = totals[-1]
    steps = step_names(result, total)
    summaries = step_summaries(context, total)
    shares = (None, *_valid_shares(context, total, steps[1:], summaries))
    phases: tuple[str, ...] = ()
    remark = ""
    if rows := _comparison(result):
        source, phases = "Beside the caliper", tuple(row["phase"] for row in rows)
        columns = [key for key in rows[0] if key in _TITLES or (_ending(key) != "_pct" and _bare(key) in _TITLES)]
        values = {key: tuple(row.get(key) for row in rows) for key in columns}
        remark = _other_length(rows[0])
    elif values := _extensometers(result):
        source = EXTENSOMETERS
    else:
        source, values = "Means over the field", _means([summaries.get(step, {}) for step in steps[1:]])
    lengths = ("displacement", "length") if remark else ()
    drawn = tuple(key for key in values if _is_drawn(key) and not any(word in key for word in lengths))
    logged = _logged(result, steps)
    axis = "load_g" if "load_g" in values else logged.axis
    shown = (*map(_column, values), *logged.columns)
    values = {**values, **logged.values}
    return History(source, steps, phases or logged.phases, shown, values, shares, drawn, remark, axis)


def _is_drawn(key: str) -> bool:
    """Whether a column has a curve; rates and uncertainties stand in the table alone."""
    return not key.endswith("_per_s") and not key.rpartition(" · ")[2].startswith("u_")


class _Logged(NamedTuple):
    """Channels of a machine at the steps. axis : key of the load, else of the time; empty without either"""

    columns: tuple[Column, ...] = ()
    values: Mapping[str, tuple[float | None, ...]] = {}
    phases: tuple[str, ...] = ()
    axis: str = ""


def _logged(result: Result, steps: tuple[str, ...]) -> _Logged:
    """The channels of the log with the load, else of the first log."""
    there = [result.product(stage) for stage in result.stages_of("channels") if result.has(stage)]
    tables = sorted(map(Channels.read, there), key=lambda table: not table.has_load)
    if not tables:
        return _Logged()
    table = tables[0]
    found = {name: table.of(name) for name in table.names}
    keys = {name: named_with_unit(name, channel.unit) for name, channel in found.items()}
    columns = tuple(Column(keys[name], channel.title, channel.unit) for name, channel in found.items())
    values = {key: tuple(column) for key, column in table.columns_at(("reference", *steps[1:])).items()}
    axis = keys[table.load] if table.has_load else keys.get("time", "")
    phases = table.phases_at(("reference", *steps[1:]))
    return _Logged(columns, values, tuple(phases), axis)


def step_names(result: Result, total: str) -> tuple[str, ...]:
    """Names of all steps that a total belongs to, with the first."""
    later = result.steps(total)
    return next((steps for stage in result.stages if (steps := result.steps(stage))[1:] == later), ("first", *later))


def _comparison(result: Result) -> Sequence[Mapping[str, Any]]:
    for stage in result.stages_of("comparison"):
        if result.has(stage):
            return Comparison.read(result.product(stage)).rows
    return []


def _other_length(first: Mapping[str, Any]) -> str:
    """Why displacements are not compared; empty if they are, or if only strains are known."""
    if "displacement_error_mm" in first or "dic_length_mm" not in first:
        return ""
    return (
        f"DIC measured a length of {first['dic_length_mm']:.1f} mm, the caliper one of "
        f"{first['caliper_length_mm']:.1f} mm: only their strains compare."
    )


def _extensometers(result: Result) -> dict[str, tuple[float | None, ...]]:
    """Length and strain of each extensometer, its uncertainty u beside it."""
    for stage in result.stages_of("probes"):
        if not result.has(stage):
            continue
        table = ProbeTable.read(result.product(stage))
        rows = [row for row in table.rows if row["kind"] == "extensometer"]
        keys = [key for key in (rows[0] if rows else {}) if key.removeprefix("u_").startswith(("length", "strain"))]
        return {
            f"{name} · {key}": tuple(row[key] for row in rows if row["probe"] == name)
            for name in table.extensometers
            for key in keys
        }
    return {}


def _means(summaries: Sequence[Mapping[str, Any]]) -> dict[str, tuple[float | None, ...]]:
    """Mean of each quantity at all steps. summaries : of the steps after the first"""
    keys = dict.fromkeys(key for summary in summaries for key in summary if key.startswith("mean_"))
    return {key: (0.0, *(summary.get(key) for summary in summaries)) for key in keys}


def _valid_shares(
    context: Context, total: str, steps: Sequence[str], summaries: Mapping[str, Mapping[str, Any]]
) -> Iterator[float | None]:
    """Share of the region's points that have a value at each step; counted here if the total does not state it."""
    fields = None
    for step in steps:
        if step not in summaries:
            yield None
        elif "valid_share" in summaries[step]:
            yield float(summaries[step]["valid_share"])
        else:
            fields = fields or TotalFields(context.result, total)
            yield valid_share(surveyed(fields, step, context.pieces.get))


def _ending(key: str) -> str:
    return next((ending for ending in _UNITS if key.endswith(ending)), "")


def _bare(key: str) -> str:
    return key.removesuffix(_ending(key))


def _column(key: str) -> Column:
    """Title and unit of a column by its key."""
    ending, bare = _ending(key), _bare(key)
    if bare.startswith("mean_"):
        return Column(key, f"mean {symbol_of(bare[5:])}", _UNITS.get(ending, "1"))
    title = _TITLES.get(key) or _TITLES.get(bare) or bare.replace("u_", f"{UNCERTAINTY} of the ").replace("_", " ")
    return Column(key, title, _UNITS.get(ending, "1"))
