"""Variants of a pipeline: every combination of values that a sweep lists."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from dicflow.discovery import nearest
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import Document, Place, parse_value

__all__ = ["Variant", "variants", "with_settings", "with_values"]

_KEYS = ("grid", "zip", "list", "exclude")


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
        raise ConfigurationError(f"{document.where(('sweep',))}: the sweep has no variant left; take out an exclude")
    return [Variant(dict(row), with_values(document, row)) for row in kept]


def with_values(document: Document, values: Mapping[str, Any], given_by: str = "") -> Document:
    """The file with other values at dotted places, ``stage.parameter`` or deeper.

    given_by : origin of the values in messages; default the place of each in the sweep
    Raises ConfigurationError if the stage does not exist.
    """
    data, positions, given = copy.deepcopy(document.data), dict(document.positions), dict(document.given)
    for dotted, value in values.items():
        where = given_by or _sweep_place(document, dotted)
        stage, *path = dotted.split(".")
        stages = data["stages"] if isinstance(data.get("stages"), dict) else {}
        if not isinstance(stages.get(stage), dict) or not path:
            raise ConfigurationError(
                f"{where}: '{dotted}': no stage '{stage}'{nearest(stage, stages)}; write stage.parameter, "
                f"the stages are {', '.join(stages)}"
            )
        _put(stages[stage], path, value)
        place = ("stages", stage, *path)
        positions = {other: position for other, position in positions.items() if other[: len(place)] != place}
        given[place] = where
    return document._replace(data=data, positions=positions, given=given)


def with_settings(document: Document, settings: Sequence[str]) -> Document:
    """The file as the command line changes it: ``stage.parameter=value``, and ``=v1,v2,v3`` for one more sweep.

    A setting overrides the file's own sweep of the same parameter.

    Raises ConfigurationError for a setting of another form.
    """
    for setting in settings:
        dotted, sign, text = setting.partition("=")
        if not sign or "." not in dotted:
            raise ConfigurationError(f"--set {setting}: write stage.parameter=value, or =v1,v2,v3 to sweep over values")
        values = _values(setting, text)
        sweep = _without(_checked(document), dotted, values)
        if len(values) == 1:
            document = with_values(document, {dotted: values[0]}, f"--set {setting}")
        else:
            sweep["grid"] = {**sweep.get("grid", {}), dotted: values}
            given = {**document.given, ("sweep", "grid", dotted): f"--set {setting}"}
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
    try:
        values = parse_value(f"[{text}]")
    except ConfigurationError as error:
        reason = str(error).partition(": ")[2]
        raise ConfigurationError(f"--set {setting}: {reason}; close every bracket and quote") from error
    if not isinstance(values, list) or not values:
        raise ConfigurationError(f"--set {setting}: has no value; write stage.parameter=value, null for none")
    return values


def _put(entry: dict[str, Any], path: Sequence[str], value: Any) -> None:
    for key in path[:-1]:
        inner = entry.get(key)
        entry[key] = inner if isinstance(inner, dict) else {}
        entry = entry[key]
    entry[path[-1]] = value


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
                    f"{document.where(('sweep', 'exclude', index, key))}: sweep: exclude names '{key}', which the "
                    f"sweep does not vary{nearest(key, varied)}; it varies {', '.join(varied)}"
                )


def _check(document: Document, sweep: Any) -> None:
    def fail(place: tuple[str | int, ...], message: str) -> None:
        raise ConfigurationError(f"{document.where(('sweep', *place))}: sweep: {message}")

    if not isinstance(sweep, dict) or not sweep:
        fail((), f"expected a mapping with {', '.join(_KEYS)}")
    for key, part in sweep.items():
        if key not in _KEYS:
            fail((key,), f"unknown key '{key}'{nearest(key, _KEYS)}; keys: {', '.join(_KEYS)}")
        if key in ("list", "exclude"):
            if not isinstance(part, list) or not all(isinstance(row, dict) and row for row in part):
                fail((key,), f"'{key}' is a list of mappings, parameter: value")
        elif not isinstance(part, dict) or not all(isinstance(values, list) and values for values in part.values()):
            fail((key,), f"'{key}' maps each parameter to a list of values")
    lengths = {len(values) for values in sweep.get("zip", {}).values()}
    if len(lengths) > 1:
        fail(("zip",), f"the lists under 'zip' must have one length, found {sorted(lengths)}")
    twice = set(sweep.get("grid", {})) & set(sweep.get("zip", {}))
    if twice:
        fail(("zip",), f"'{twice.pop()}' is under grid and zip; keep one")
