"""Force, crosshead, temperature and time at every step, from the log of a machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from pydantic import field_validator

from dicflow.engine.node import At, InputFile, Millimetres, Node, Port, Scope, Seconds, parameter
from dicflow.engine.product import Product
from dicflow.errors import InputError
from dicflow.kinds.channels import Channel
from dicflow.kinds.channels import Channels as ChannelTable
from dicflow.kinds.images import Images

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.channels.join import Joined
    from dicflow.io.logs.log import Log, Selection
    from dicflow.stages._joined_log import JoinedRows, StepClock

__all__ = ["Channels", "sentence"]


class _Uncertainty(NamedTuple):
    """Of a channel, in its unit, or a share of each value."""

    absolute: float
    share: float


class Channels(Node):
    """Read the log of a testing machine, a balance or a data logger, and give each channel a value at every step.

    Separators, decimal signs, lines of facts above the rows, units and dates are recognised; ``columns`` names what is
    read, by default every column whose unit is known. Grams and kilograms are weights and become N, lengths mm, times
    s, temperatures °C.

    Steps are joined to rows by their names, by their order, or by time with interpolation. Two clocks differ by an
    offset: given in seconds, 0 where both show date and time, or found with ``auto``, by when the specimen moves in
    the pictures and in the log. A step beyond the log's ends has no value.

    Each length has its velocity beside it; with the specimen's ``length`` the crosshead gives the nominal strain rate.
    """

    title: ClassVar = "channels of machines"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {"images": Port("images", at=At.ALL)}
    gives: ClassVar = "channels"

    stage: Literal["channels"] = "channels"
    file: InputFile = parameter(..., "log of a machine: a table of text, of any separator")
    columns: dict[str, str | int] = parameter(
        {},
        "channel: title or number of its column, such as force: Load; 'time' and 'step' are the columns with times and "
        "with names of steps; empty for all with a known unit",
    )
    units: dict[str, str] = parameter({}, "channel: unit of its column, where the log gives none")
    u: dict[str, str] = parameter({}, "channel: standard uncertainty, such as 0.5 N or 0.5 %")
    load: str | None = parameter(None, "channel that loads the specimen; absent: force, or the only one in N")
    join: Literal["name", "order", "time"] | None = parameter(
        None,
        "how rows belong to steps; absent: by name if the log has names of steps, by time if both have times, "
        "else by order",
    )
    offset: Literal["auto"] | Seconds | None = parameter(
        None,
        "what the log's clock shows more than that of the photographs, or auto to find it by the motion; absent: 0, "
        "for clocks with dates",
        unit="s",
    )
    decimal: Literal[".", ","] | None = parameter(None, "decimal sign; absent: found")
    length: Millimetres | None = parameter(
        None, "free length of the specimen between the grips, for the nominal strain rate", unit="mm", gt=0
    )

    @field_validator("u")
    @classmethod
    def _readable(cls, value: dict[str, str]) -> dict[str, str]:
        for text in value.values():
            _uncertainty(text)
        return value

    def check(self, path: Path) -> dict[str, Any]:
        from dicflow.io.logs.log import read_log

        log = read_log(path, self._selection())
        self._check_names(log)
        if self.join == "name" and log.steps is None:
            raise InputError(log.where, "has no column with names of steps", "name it with columns: {step: …}")
        if (self.join == "time" or self.offset is not None) and log.clock is None:
            raise InputError(log.where, "has no column with times", "name it with columns: {time: …}")
        return {"rows": len(log.numbers)}

    def agree(
        self,
        facts: Mapping[Path, Mapping[str, Any]],
        steps: Mapping[str, Mapping[str, Path]],
        inputs: Mapping[str, tuple[str, ...]],
    ) -> None:
        count = len(inputs["images"])
        for path, fact in facts.items():
            if self.join == "order" and fact["rows"] != count:
                raise InputError(
                    str(path),
                    f"has {fact['rows']} rows for {count} steps",
                    "write one per step, or join by name or time",
                )

    def gathers(self, port: str) -> bool:
        """Only the motion needs the photographs, beside their times."""
        return self.offset == "auto"

    def run(self, file_path: Path, images: Sequence[Product]) -> Product:
        from dicflow.io.logs.log import read_log

        log = read_log(file_path, self._selection())
        self._check_names(log)
        steps = tuple(getattr(images, "steps", map(str, range(len(images)))))
        joined = self._joined(log, images, steps)
        channels = {
            name: self._channel(name, column.values, column.unit, column.title, log, joined)
            for name, column in log.columns.items()
        }
        channels = {**_time(joined), **channels, **self._rates(log, joined)}
        load = self._load(log)
        phases = () if load is None else _phases(channels[load].values, joined.at)
        facts = {"summary": _summary(channels, load, joined), "warnings": _warnings(log, channels, load, joined)}
        return ChannelTable.write(channels, steps, load, phases, facts)

    def _selection(self) -> Selection:
        from dicflow.io.logs.log import Selection

        return Selection(self.columns, self.units, self.decimal)

    def _check_names(self, log: Log) -> None:
        """Raise InputError for a load, unit or uncertainty of a channel that the log does not have."""
        from dicflow.io.logs.log import RESERVED

        if not log.columns:
            advice = "; ".join(log.remarks) or "name them under columns, and their units"
            raise InputError(log.where, "has no column with a known unit", advice)
        known = ", ".join(log.columns)
        given = {"load": filter(None, [self.load]), "u": self.u, "units": set(self.units).difference(RESERVED)}
        for parameter_name, names in given.items():
            for name in names:
                if name not in log.columns:
                    problem = f"has no channel '{name}', which {parameter_name} names"
                    raise InputError(log.where, problem, f"its channels are: {known}; name its column under columns")
        if self.load is not None and (unit := log.columns[self.load].unit) != "N":
            raise InputError(log.where, f"the load, {self.load}, is in {unit}", "expected a force or a weight")

    def _load(self, log: Log) -> str | None:
        """Name of the channel with the load; None without one, or if several are loads and none is called force."""
        forces = [name for name, column in log.columns.items() if column.unit == "N"]
        if self.load is not None:
            return self.load
        return "force" if "force" in forces else forces[0] if len(forces) == 1 else None

    def _joined(self, log: Log, images: Sequence[Product], steps: Sequence[str]) -> JoinedRows:
        from dicflow.stages._joined_log import joined_by_name, joined_by_order, joined_by_time

        way = self.join or ("name" if log.steps is not None and self.offset is None else None)
        if way == "name":
            return joined_by_name(log, steps)
        if way == "order":
            return joined_by_order(log, steps)
        clock = _step_clock(images)
        if way is None and self.offset is None and (log.clock is None or clock is None):
            return joined_by_order(log, steps)
        moves = _moves(images, clock) if self.offset == "auto" and clock is not None else None
        offset = None if self.offset == "auto" else self.offset
        return joined_by_time(log, clock, offset, moves)

    def _channel(self, name: str, values: np.ndarray, unit: str, title: str, log: Log, joined: JoinedRows) -> Channel:
        """One column at the steps."""
        import numpy as np

        if joined.rows is not None:
            found = np.where(joined.rows >= 0, values[joined.rows], np.nan)
            return Channel(
                found, unit, title, self._u(name, found, np.zeros_like(found)), _row_reasons(log, joined, found)
            )
        from dicflow.core.channels.join import interpolate

        assert joined.seconds is not None
        at_steps = interpolate(joined.seconds, values, joined.at)
        u = self._u(name, at_steps.values, at_steps.slopes * joined.u_offset)
        return Channel(at_steps.values, unit, title, u, _time_reasons(at_steps, joined, log.numbers))

    def _u(self, name: str, values: np.ndarray, by_offset: np.ndarray) -> np.ndarray | None:
        """Standard uncertainty of a channel (step,); None if it is not given."""
        import numpy as np

        if name not in self.u:
            return None
        absolute, share = _uncertainty(self.u[name])
        return np.asarray(np.hypot(absolute + share * np.abs(values), np.nan_to_num(by_offset) + 0.0 * values))

    def _rates(self, log: Log, joined: JoinedRows) -> dict[str, Channel]:
        """Velocity of each length at the steps, and the nominal strain rate."""
        if joined.seconds is None:
            return {}
        found = {}
        for name, column in log.columns.items():
            if column.unit == "mm":
                speed = _velocity(column.values, joined)
                found[f"{name}_velocity"] = Channel(speed, "mm/s", f"velocity of {column.title}")
                if self.length is not None and "nominal_strain_rate" not in found:
                    title = f"nominal strain rate, {column.title} over {self.length:g} mm"
                    found["nominal_strain_rate"] = Channel(speed / self.length, "1/s", title)
        return found


def _uncertainty(text: str) -> _Uncertainty:
    """An uncertainty as users write it. Raises ValueError for another text."""
    from dicflow.io.logs.numbers import NumberStyle, number_and_unit
    from dicflow.io.logs.units import unit_named

    parsed = number_and_unit(str(text))
    value = NumberStyle(".").read(parsed[0]) if parsed else None
    unit = unit_named(parsed[1]) if parsed else None
    if value is None or unit is None or value < 0:
        raise ValueError(f"'{text}' is not an uncertainty; write a number and a unit, such as 0.5 N or 0.5 %")
    assert parsed is not None
    return _Uncertainty(0.0, value / 100.0) if parsed[1] == "%" else _Uncertainty(value * unit.factor, 0.0)


def _step_clock(images: Sequence[Product]) -> StepClock | None:
    """Times of the steps; None if no photograph has one."""
    import numpy as np

    from dicflow.stages._joined_log import StepClock

    read = [Images.read(product) for product in images]
    if all(one.time is None for one in read):
        return None
    utc = np.array([np.nan if one.time is None else one.time for one in read])
    zones = np.array([np.nan if one.utc_offset is None else one.utc_offset for one in read])
    is_known = bool(np.isfinite(zones[np.isfinite(utc)]).all())
    return StepClock(utc + np.nan_to_num(zones), bool(np.nanmin(utc) > _DATES_FROM), utc if is_known else None)


_DATES_FROM = 1e8
"""Seconds above which a time counts from 1970, rather than from the start of a test."""


def _moves(images: Sequence[Product], clock: StepClock) -> np.ndarray:
    """Change of the picture from step to step, in the order of their times (step − 1,), in grey levels."""
    import numpy as np

    from dicflow.core.channels.offset import change

    found, before = [], None
    for step in np.argsort(clock.seconds, kind="stable"):
        grey = Images.read(images[step]).left
        if before is not None:
            found.append(change(before, grey))
        before = grey
    return np.array(found)


def _velocity(values: np.ndarray, joined: JoinedRows) -> np.ndarray:
    """Velocity (step,) at the steps: over the log from half a step's interval before to as much after."""
    import numpy as np

    from dicflow.core.channels.join import interpolate, rates

    if joined.rows is not None:
        return rates(joined.at, np.where(joined.rows >= 0, values[joined.rows], np.nan))
    assert joined.seconds is not None
    half = 0.5 * float(np.nanmedian(np.diff(joined.at))) if len(joined.at) > 1 else 0.0
    before, after = (interpolate(joined.seconds, values, joined.at + sign * half).values for sign in (-1.0, 1.0))
    here = interpolate(joined.seconds, values, joined.at).values
    sides = (
        [(after - before) / (2.0 * half), (after - here) / half, (here - before) / half]
        if half > 0.0
        else [here * np.nan]
    )
    return np.where(np.isfinite(sides[0]), sides[0], np.where(np.isfinite(sides[-2]), sides[-2], sides[-1]))


def _time(joined: JoinedRows) -> dict[str, Channel]:
    """Time of each step since the first one that has one."""
    import numpy as np

    known = np.isfinite(joined.at)
    return {"time": Channel(joined.at - joined.at[known][0], "s", "time")} if known.any() else {}


def _phases(load: np.ndarray, at: np.ndarray) -> list[str]:
    """Loading or unloading at each step, in the order of their times where these are known."""
    import numpy as np

    from dicflow.core.channels.phases import is_loading

    order = np.argsort(at, kind="stable")
    loading = np.empty(len(load), dtype=bool)
    loading[order] = is_loading(load[order])
    return ["loading" if one else "unloading" for one in loading]


def _row_reasons(log: Log, joined: JoinedRows, found: np.ndarray) -> list[str]:
    """Why a step has no value, where steps belong to rows."""
    import numpy as np

    assert joined.rows is not None
    return [
        ""
        if np.isfinite(value)
        else f"line {log.numbers[row]} of the log has no value"
        if row >= 0
        else "no row of the log has the name of the step"
        for row, value in zip(joined.rows, found, strict=True)
    ]


def _time_reasons(found: Joined, joined: JoinedRows, lines: Sequence[int]) -> list[str]:
    """Why a step has no value, where steps have times. lines : of the log's rows"""
    import numpy as np

    from dicflow.core.channels.join import Missing

    assert joined.seconds is not None
    first, last = float(np.nanmin(joined.seconds)), float(np.nanmax(joined.seconds))
    texts = {
        Missing.KNOWN: "",
        Missing.UNTIMED: "the photograph has no time",
        Missing.BEFORE: "the log begins {before:.3g} s after the step",
        Missing.AFTER: "the log ends {after:.3g} s before the step",
        Missing.GAP: "the log has a gap at the step, {gap}",
    }
    return [
        texts[Missing(int(code))].format(before=first - at, after=at - last, gap=_gap(joined.seconds, at, lines))
        for code, at in zip(found.missing, joined.at, strict=True)
    ]


def _gap(seconds: np.ndarray, at: float, lines: Sequence[int]) -> str:
    """Where a log has no row about a time [s], and for how long."""
    import numpy as np

    before, after = np.flatnonzero(seconds <= at), np.flatnonzero(seconds > at)
    if not (before.size and after.size):
        return "with no row"
    lacking = seconds[after[0]] - seconds[before[-1]]
    return f"of {lacking:.6g} s after line {lines[before[-1]]}; if its clock was set there, correct the times below"


def _summary(channels: Mapping[str, Channel], load: str | None, joined: JoinedRows) -> dict[str, float]:
    import numpy as np

    summary: dict[str, float] = {}
    if joined.offset is not None:
        summary |= {"offset_s": joined.offset, "u_offset_s": joined.u_offset}
    if load is not None and np.isfinite(channels[load].values).any():
        summary[f"max_{load}_{channels[load].unit}"] = float(np.nanmax(channels[load].values))
    return summary


def _warnings(log: Log, channels: Mapping[str, Channel], load: str | None, joined: JoinedRows) -> list[str]:
    """What a user must know: what is left out of the log, and steps without load."""
    found = [f"{Path(log.where).name}: {remark}" for remark in log.remarks]
    name = load or next(iter(log.columns))
    lacking = [reason for reason in channels[name].reasons if reason]
    if lacking:
        steps = f"{len(lacking)} of {len(channels[name].reasons)} steps"
        found.append(f"{Path(log.where).name}: {steps} have no {name}: {lacking[-1]}")
    return found


def sentence(stage: Channels, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    text = "Channels of the machine's log were joined to the photographs"
    if product is None:
        return f"{text}."
    table = ChannelTable.read(product)
    offset = table.summary.get("offset_s")
    names = ", ".join(name.replace("_", " ") for name in table.names)
    clocks = "" if offset is None else f", by their clocks, {offset:.4g} s apart"
    found = (
        f", found by the motion with an uncertainty of {table.summary['u_offset_s']:.2g} s"
        if stage.offset == "auto"
        else ""
    )
    return f"{text}{clocks}{found}: {names}."
