"""Variants of a pipeline: every combination of values that a sweep lists."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

from dicflow.discovery import nearest
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import Document, Place, parse_value
from dicflow.io.text import printable

__all__ = ["Variant", "variants", "with_settings", "with_values"]

_KEYS = ("grid", "zip", "list", "exclude")
_MAX_VARIANTS = 1_000
_MAX_PARAMETERS = 100
_MAX_VALUES = 1_000_000
"""Values of all stages, times variants."""
_MAX_DEPTH = 10
_DECIMAL_COMMA = re.compile(r"\s*(\d+),(\d+)\s*([^\W\d]+)\s*")


class Variant(NamedTuple):
    """One combination of values.

    values : dotted parameter (``surface.degree.z``) → value; empty for a pipeline without a sweep
    document : the pipeline file with these values in their places
    """

    values: dict[str, Any]
    document: Document


def variants(document: Document) -> list[Variant]:
    """All variants of a pipeline file, in the order of the sweep; one without values if the file has no sweep.

    ``grid`` combines every value with every other, ``zip`` takes the n-th of each, ``list`` adds combinations given
    one by one, ``exclude`` removes those that hold all values of one of its entries. Grid and zip multiply.

    Raises ConfigurationError with the place.
    """
    sweep = document.data.get("sweep")
    if sweep is None:
        return [Variant({}, document)]
    _check(document, sweep)
    rows = [*_products(sweep), *sweep.get("list", [])]
    _refuse_unknown(document, sweep.get("exclude", []), rows)
    kept = [row for row in rows if not any(_holds(row, entry) for entry in sweep.get("exclude", []))]
    if not kept:
        raise ConfigurationError(document.where(("sweep",)), "the sweep has no variant left", "take out an exclude")
    return [Variant(dict(row), with_values(document, row)) for row in kept]


def with_values(document: Document, values: Mapping[str, Any], given_by: str = "") -> Document:
    """The file with other values at dotted places, ``stage.parameter`` or deeper.

    given_by : origin of the values in messages; default the place of each in the sweep
    Raises ConfigurationError if the stage does not exist.
    """
    given = dict(document.given)
    stages = document.data.get("stages")
    stages = dict(stages) if isinstance(stages, dict) else {}
    for dotted, value in values.items():
        where = given_by or _sweep_place(document, dotted)
        stage, *path = dotted.split(".")
        if not isinstance(stages.get(stage), dict) or not 0 < len(path) <= _MAX_DEPTH:
            raise ConfigurationError(
                where,
                f"'{printable(dotted)}': no stage '{printable(stage)}'{nearest(stage, stages)}",
                f"write stage.parameter, the stages are {printable(', '.join(stages), 300)}",
            )
        stages[stage] = _with(stages[stage], path, value)
        given[("stages", stage, *path)] = where
    return document._replace(data={**document.data, "stages": stages}, given=given)


def with_settings(document: Document, settings: Sequence[str]) -> Document:
    """The file as the command line changes it: ``stage.parameter=value``, and ``=v1,v2,v3`` for one more sweep.

    A setting overrides the file's own sweep of the same parameter.

    Raises ConfigurationError for a setting of another form.
    """
    for setting in settings:
        dotted, sign, text = setting.partition("=")
        if not sign or "." not in dotted or not dotted.isprintable():
            raise ConfigurationError(
                f"--set {printable(setting)}", "not a setting", "write stage.parameter=value, or =v1,v2,v3 to sweep"
            )
        values = _values(setting, text)
        sweep = _without(_checked(document), dotted, values)
        if len(values) == 1:
            document = with_values(document, {dotted: values[0]}, f"--set {printable(setting)}")
        else:
            sweep["grid"] = {**sweep.get("grid", {}), dotted: values}
            given = {**document.given, ("sweep", "grid", dotted): f"--set {printable(setting)}"}
            document = document._replace(given=given)
        rest = {key: part for key, part in document.data.items() if key != "sweep"}
        varies = any(sweep.get(key) for key in ("grid", "zip", "list"))
        document = document._replace(data={**rest, "sweep": sweep} if varies else rest)
    return document


def _checked(document: Document) -> Mapping[str, Any]:
    """The sweep of a file; empty if it has none."""
    sweep: Mapping[str, Any] | None = document.data.get("sweep")
    if sweep is None:
        return {}
    _check(document, sweep)
    return sweep


def _without(sweep: Mapping[str, Any], dotted: str, values: Sequence[Any]) -> dict[str, Any]:
    """A sweep without a parameter that a setting gives.

    With a single value, an exclude of another value of the parameter is dropped, and one of this value keeps its other
    conditions.
    """
    left: dict[str, Any] = {key: _dropped(part, dotted) for key, part in sweep.items() if key in ("grid", "zip")}
    if "list" in sweep:
        rows = [_dropped(row, dotted) for row in sweep["list"]]
        left["list"] = [row for k, row in enumerate(rows) if row and row not in rows[:k]]
    if "exclude" in sweep:
        one = len(values) == 1
        holding = [entry for entry in sweep["exclude"] if not one or entry.get(dotted, values[0]) == values[0]]
        left["exclude"] = [rest for entry in holding if (rest := _dropped(entry, dotted))] if one else holding
    return left


def _dropped(part: Mapping[str, Any], dotted: str) -> dict[str, Any]:
    return {key: value for key, value in part.items() if key != dotted}


def _sweep_place(document: Document, dotted: str) -> str:
    """Where a sweep gives the values of a parameter."""
    places: list[Place] = [("sweep", "grid", dotted), ("sweep", "zip", dotted)]
    return document.where(next((place for place in places if document.holds(place)), ("sweep",)))


def _values(setting: str, text: str) -> list[Any]:
    """The values of a setting. Raises ConfigurationError if it has none, or is cut short."""
    where = f"--set {printable(setting)}"
    try:
        values = parse_value(f"[{text}]")
    except ConfigurationError as error:
        raise ConfigurationError(where, str(error.args[1]), f"{error.args[2]}, and close every bracket") from error
    if not isinstance(values, list) or not values:
        raise ConfigurationError(where, "has no value", "write stage.parameter=value, null for none")
    if (halves := _DECIMAL_COMMA.fullmatch(text)) is not None:
        whole, part, unit = halves.groups()
        remedy = f"write {whole}.{part} {unit} for one value, {whole} {unit},{part} {unit} for a sweep of two"
        raise ConfigurationError(where, "may be a decimal comma, or two values of which one has no unit", remedy)
    return values


def _with(entry: Any, path: Sequence[str], value: Any) -> Any:
    """A mapping with another value at a path, which is made where it is missing; the mapping itself stays."""
    if not path:
        return value
    own = entry if isinstance(entry, dict) else {}
    return {**own, path[0]: _with(own.get(path[0]), path[1:], value)}


def _products(sweep: Mapping[str, Any]) -> list[dict[str, Any]]:
    grid = [[{key: value} for value in values] for key, values in sweep.get("grid", {}).items()]
    columns = sweep.get("zip", {})
    zipped = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    if not grid and not zipped:
        return []
    return [
        {key: value for part in parts for key, value in part.items()}
        for parts in itertools.product(*grid, zipped or [{}])
    ]


def _holds(row: Mapping[str, Any], entry: Mapping[str, Any]) -> bool:
    return all(key in row and row[key] == value for key, value in entry.items())


def _refuse_unknown(
    document: Document, exclude: Sequence[Mapping[str, Any]], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Every parameter under exclude must be one that the sweep varies."""
    varied = dict.fromkeys(key for row in rows for key in row)
    for index, entry in enumerate(exclude):
        for key in entry:
            if key not in varied:
                raise ConfigurationError(
                    document.where(("sweep", "exclude", index, key)),
                    f"sweep: exclude names '{printable(key)}', which the sweep does not vary{nearest(key, varied)}",
                    f"use one of {printable(', '.join(varied), 300)}",
                )


def _check(document: Document, sweep: Any) -> None:
    """Refuse what is not a sweep, and one of too many variants, which are counted before they are made."""
    if not isinstance(sweep, dict) or not sweep:
        _fail(document, (), "not a mapping", f"write one with {', '.join(_KEYS)}")
    for key, part in sweep.items():
        if key not in _KEYS:
            problem = f"unknown key '{printable(key)}'{nearest(key, _KEYS)}"
            _fail(document, (key,), problem, f"use {', '.join(_KEYS)}")
        if key in ("list", "exclude"):
            if not isinstance(part, list) or not all(isinstance(row, dict) and row for row in part):
                _fail(document, (key,), f"'{key}' is not a list of mappings", "write '- stage.parameter: value'")
        elif not isinstance(part, dict) or not all(isinstance(values, list) and values for values in part.values()):
            problem = f"'{key}' does not map each parameter to a list of values"
            _fail(document, (key,), problem, "write 'stage.parameter: [1, 2]'")
    grid, columns = sweep.get("grid", {}), sweep.get("zip", {})
    if twice := sorted(set(grid) & set(columns)):
        _fail(document, ("zip",), f"'{printable(twice[0])}' is under grid and zip", "keep one")
    lengths = {len(values) for values in columns.values()}
    if len(lengths) > 1:
        _fail(document, ("zip",), f"the lists under 'zip' have the lengths {sorted(lengths)}", "make them equal")
    _check_counts(document, sweep, math.prod([*map(len, grid.values()), *lengths]) if grid or columns else 0)


def _check_counts(document: Document, sweep: Mapping[str, Any], combined: int) -> None:
    """combined : number of variants that grid and zip make"""
    parameters = len(sweep.get("grid", {})) + len(sweep.get("zip", {}))
    if parameters > _MAX_PARAMETERS:
        _fail(document, (), f"varies {parameters} parameters, at most {_MAX_PARAMETERS} are possible", "vary fewer")
    rows = {"list": len(sweep.get("list", ())), "exclude": len(sweep.get("exclude", ()))}
    count = max(combined + rows["list"], rows["exclude"])
    if count > _MAX_VARIANTS:
        problem = f"{count:.10g} variants, at most {_MAX_VARIANTS:,} are possible"
        _fail(document, (), problem, "shorten the lists, or vary parameters together with 'zip'")
    values = sum(place[:1] != ("sweep",) for place in document.positions)
    if count * values > _MAX_VALUES:
        problem = f"{count:,} variants of stages with {values:,} values"
        _fail(document, (), problem, "shorten their lists, or keep long ones in files of their own")


def _fail(document: Document, place: Place, problem: str, remedy: str) -> NoReturn:
    raise ConfigurationError(document.where(("sweep", *place)), f"sweep: {problem}", remedy)
