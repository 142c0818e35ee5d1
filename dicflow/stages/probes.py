"""Points, lines, extensometers and areas: values at every step with their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, model_validator

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.channels import Channels
from dicflow.kinds.probes import ProbeTable, Reading, StepReadings, gauge_facts
from dicflow.kinds.quantities import ERRORS, QUANTITIES, unit_of
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total, gradient_measures
from dicflow.stages._probed import beside, probe_error
from dicflow.stages._unmeasured import extent_text, has_value, missing_facts, probes_text

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.probes.weights import ErrorCorrelation, Probe
    from dicflow.core.uncertainty.overlap import Overlap
    from dicflow.engine.looks import Looks

__all__ = ["Probes"]

Place = tuple[float, float]
Line = tuple[Place, Place]
Ring = Annotated[tuple[Place, ...], Field(min_length=3)]
Quantity = Literal["U", "V", "W", "exx", "eyy", "gxy"]

Readings = dict[str, Reading]
"""Reading by quantity."""

_UNKNOWN = Reading(math.nan, math.nan, math.nan, math.nan)
_SAMPLES = 101
_AREA_SAMPLES = 200
_LENGTHS = ("length", "elongation", "strain")


def _corners(value: Any) -> Any:
    """A rectangle [x0, y0, x1, y1] as its four corners."""
    if isinstance(value, list | tuple) and len(value) == 4 and all(isinstance(number, int | float) for number in value):
        x0, y0, x1, y1 = value
        return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    return value


class Probes(Node):
    """Read the total at places that the user names, at every step.

    A point's value is that of the parabola through the points around it, a line's the mean over it, an area's the mean
    of its points. An extensometer is the straight distance in space of two points: its length, the elongation since
    the first step, and elongation per first length. Each has its standard deviation, from those of the points and from
    how much the subsets and windows of neighbours overlap, the bias that remains, which the points of a mean share,
    both combined as its uncertainty u, and beside it the calibration's share, if the uncertainty of the rig is known.
    A place belongs to the material and moves with it; one at which no step has a measured point has no value, which a
    warning says. Channels of a machine stand beside the readings of each step;
    with their times extensometers have a strain rate.
    """

    title: ClassVar = "probes"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {
        "total": Port("total", at=At.ALL),
        "rig": Port("rig", optional=True),
        "channels": Port("channels", optional=True),
    }
    gives: ClassVar = "probes"

    stage: Literal["probes"] = "probes"
    points: dict[str, Place] = parameter({}, "name: [x, y]")
    lines: dict[str, Line] = parameter({}, "name: [[x, y], [x, y]], from one end to the other")
    extensometers: dict[str, Line] = parameter({}, "name: [[x, y], [x, y]], the two gauge points")
    areas: dict[str, Annotated[Ring, BeforeValidator(_corners)]] = parameter(
        {}, "name: [x0, y0, x1, y1], or a list of corners [x, y]"
    )
    unit: Literal["px", "mm"] = parameter(
        "px", "of all places: pixels of the left photograph, or the results' X and Y, both at the first step"
    )
    quantities: Annotated[tuple[Quantity, ...], Field(min_length=1)] = parameter(
        ("U", "V", "W", "exx", "eyy", "gxy"), "quantities to read at points, lines and areas"
    )

    @model_validator(mode="after")
    def _named_once(self) -> Probes:
        names = [name for group in (self.points, self.lines, self.extensometers, self.areas) for name in group]
        if not names:
            raise ValueError("give at least one of points, lines, extensometers and areas")
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"each name stands for one probe, but {', '.join(twice)} for several")
        return self

    def look(self, total: Product, rig: Product | None = None) -> Product:
        """The readings at one step."""
        field = Total.read(total)
        step = _Step(field, self.unit, None if rig is None else CalibratedRig.read(rig))
        along = {name: [step.at(place) for place in _samples(line)] for name, line in self.lines.items()}
        found = dict(self._read(step, along))
        lengths = {name: found.pop(name) for name in self.extensometers}
        facts = {"gauge": gauge_facts(total), "scaled": field.relative_u_of_scale is not None, "extent": step.extent}
        return StepReadings.write((found, lengths), self._profiles(step, along), facts)

    def run(self, total: Looks, rig: Product | None = None, channels: Product | None = None) -> Product:
        if not len(total):
            raise StageError("expected two or more steps, found one; give more photographs")
        steps = ["reference", *total.steps]
        seen = [StepReadings.read(product) for product in total]
        readings: list[dict[str, Readings]] = [one.readings for one in seen]
        missing = self._unmeasured(readings, [one.facts["extent"] for one in seen])
        readings.insert(0, _at_first_step(readings, missing))
        facts, parts = {**seen[0].facts["gauge"], **missing_facts(missing)}, ["", *ERRORS]
        if not seen[0].facts["scaled"] and (rig is None or CalibratedRig.read(rig).covariance is None):
            parts.remove("calibration_")
        rows = [
            {"probe": name, "kind": kind, "step": step, **_columns(reading[name], facts["unit"], parts)}
            for kind, names in self._kinds().items()
            for name in names
            for step, reading in zip(steps, readings, strict=True)
        ]
        variables = self._variables(readings, facts["unit"], parts)
        variables |= self._profile_variables([one.profiles for one in seen], facts["unit"])
        if channels is not None:
            variables |= beside(Channels.read(channels), steps, list(self.extensometers), variables, rows)
        return ProbeTable.write(variables, steps, self._kinds(), rows, {**facts, "summary": _summary(readings)})

    def _kinds(self) -> dict[str, list[str]]:
        """Names of the probes by sort."""
        return {
            "point": list(self.points),
            "line": list(self.lines),
            "area": list(self.areas),
            "extensometer": list(self.extensometers),
        }

    def _read(self, step: _Step, along: Mapping[str, list[Probe | None]]) -> Iterator[tuple[str, Readings]]:
        """Readings of every probe at one step.

        along : for each line the probes on it
        """
        from dicflow.core.photographs.polygon import Polygon
        from dicflow.core.photographs.region import contains
        from dicflow.core.probes.weights import area_probe, mean_probe, sample_probes

        for name, place in self.points.items():
            probe = step.at(place)
            yield name, step.values(probe, self.quantities, [probe])
        for name, parts in along.items():
            yield name, step.values(mean_probe(parts), self.quantities, parts)
        for name, ring in self.areas.items():
            inside = contains([Polygon(_array(ring))], step.grid)
            area = area_probe(inside, step.known)
            yield (
                name,
                step.values(area, self.quantities, sample_probes(area, _AREA_SAMPLES) if area is not None else []),
            )
        for name, line in self.extensometers.items():
            yield name, step.extension(line)

    def _profiles(self, step: _Step, along: Mapping[str, list[Probe | None]]) -> dict[str, np.ndarray]:
        """Each quantity along the lines, (line, sample)."""
        import numpy as np

        from dicflow.core.probes.weights import value_of

        names: Sequence[str] = self.quantities if self.lines else ()
        found = {name: np.full((len(self.lines), _SAMPLES), np.nan) for name in names}
        for number, parts in enumerate(along.values()):
            for sample, probe in enumerate(parts):
                if probe is not None:
                    for name, profile in found.items():
                        profile[number, sample] = value_of(probe, step.total[name])
        return found

    def _unmeasured(self, readings: Sequence[dict[str, Readings]], extents: Sequence[list[float]]) -> dict[str, str]:
        """Probes without a value at any step, and why. Raises StageError if all are.

        extents : of the measured points at each step
        """
        names = [name for name in readings[0] if not any(map(has_value, (reading[name] for reading in readings)))]
        reason = f"lies where no step has a measured point; {extent_text(extents, self.unit)}"
        if len(names) == len(readings[0]):
            raise StageError(f"{probes_text(names)} {reason}")
        return dict.fromkeys(names, reason)

    def _variables(self, readings: list[dict[str, Readings]], unit: str, parts: Sequence[str]) -> dict[str, Variable]:
        """Values and σ: (probe, step) of points, lines and areas in this order, (extensometer, step) of lengths."""
        import numpy as np

        groups: dict[str, tuple[list[str], Sequence[str]]] = {
            "probe": ([*self.points, *self.lines, *self.areas], self.quantities),
            "extensometer": (list(self.extensometers), _LENGTHS),
        }
        variables: dict[str, Variable] = {}
        for dim, (names, quantities) in groups.items():
            for quantity in quantities if names else ():
                found = [[reading[name][quantity].parts() for reading in readings] for name in names]
                variables |= {
                    f"{part}{quantity}": Variable(
                        (dim, "step"),
                        np.array([[one[part] for one in line] for line in found]),
                        unit_of(quantity, unit),
                        ERRORS[part].format(title=quantity) if part else quantity,
                    )
                    for part in parts
                }
        return variables

    def _profile_variables(self, profiles: list[dict[str, np.ndarray]], unit: str) -> dict[str, Variable]:
        """Each quantity along the lines, (line, step, sample), from the first photograph but one."""
        import numpy as np

        return {
            f"profile_{name}": Variable(
                ("line", "later_step", "sample"),
                np.stack([profile[name] for profile in profiles], axis=1),
                unit_of(name, unit),
                f"{name} along the line",
            )
            for name in profiles[0]
        }


class _Step:
    """One step of the total, ready to be read at places.

    grid : (row, col, 2) — where the points lay at the first step, in the unit of the places
    known : (row, col) bool — points with a value
    kinds : for each shape function its shares (3,) in the variances of U, V and W, and the correlation of its errors
    spacing : distance of the points, in the same unit
    error : of the rig; None if unknown
    """

    def __init__(self, total: Total, unit: str, rig: CalibratedRig | None) -> None:
        import numpy as np

        from dicflow.core.strain.surface_strain import jacobian
        from dicflow.core.tensors import symmetric
        from dicflow.core.uncertainty.overlap import overlap

        if not total.has_uncertainty:
            raise StageError("this total has no uncertainty to read; give one of a stage 'deformation'")
        self.total = total
        self.known = np.isfinite(total["U"])
        self.kinds = [
            (np.array(share), overlap(total.subset_size, total.step_size, name))
            for name, share in total.shape_shares.items()
        ]
        self.spacing = total.step_size
        self.grid = total["xy_reference"]
        if unit == "mm":
            if total.gauge is None or total.gauge.side_mm is None:
                raise StageError("places in mm need two cameras or a scale; give them in px, with unit: px")
            self.grid = total["xyz_reference"][..., :2]
            self.spacing *= total.gauge.side_mm / total.gauge.side_px
        self.covariance = symmetric(total["covariance"])
        self.gradient = total["gradient"]
        self.slopes = jacobian(total["xyz_reference"], (3, 3), 1)
        self.error = probe_error(total, rig)

    @property
    def extent(self) -> list[float]:
        """Of the points with a value: least x and y, largest x and y; empty without one."""
        places = self.grid[self.known]
        return [*places.min(axis=0).tolist(), *places.max(axis=0).tolist()] if len(places) else []

    def at(self, place: Any) -> Probe | None:
        """The probe at a place."""
        from dicflow.core.probes.weights import point_probe

        return point_probe(self.grid, self.known, place, self.spacing)

    def values(self, probe: Probe | None, quantities: Sequence[str], parts: Sequence[Probe | None]) -> Readings:
        """Quantities of one probe.

        parts : probes at the places over which it is a mean
        """
        from dicflow.core.probes.weights import bias_of, sigma_of, value_of

        if probe is None:
            return dict.fromkeys(quantities, _UNKNOWN)
        sources = {name: QUANTITIES[name].sources for name in quantities}
        correlations = {
            **{name: self.rho(weights) for name, weights in sources.items()},
            **self._strain_correlations(probe),
        }
        shares = self.error.mean_sigmas([part for part in parts if part is not None]) if self.error is not None else {}
        return {
            name: Reading(
                float(value_of(probe, self.total[name])),
                sigma_of(probe, self.total.sigma(name), correlations[name]),
                bias_of(probe, self.total.bias(name)),
                shares.get(name, math.nan),
            )
            for name in quantities
        }

    def extension(self, line: Line) -> Readings:
        """Lengths between two places."""
        import numpy as np

        from dicflow.core.probes.weights import difference, extension, extension_bias, value_of

        first, second = (self.at(place) for place in line)
        if first is None or second is None:
            return dict.fromkeys(["first", *_LENGTHS], _UNKNOWN)
        places = (self.total["xyz"], self.total["xyz_reference"])
        along = value_of(difference(first, second), places[0]) ** 2 * self._variances(first)
        found = extension((first, second), *places, self.covariance, self.rho(along))._asdict()
        bias = extension_bias((first, second), *places, np.stack([self.total.bias(name) for name in "UVW"], axis=-1))
        shares = self.error.length_sigmas(first, second) if self.error is not None else [math.nan] * len(found)
        return {
            name: Reading(pair[0], pair[1], one, float(share))
            for (name, pair), one, share in zip(found.items(), bias, shares, strict=True)
        }

    def rho(self, weights: Any) -> Overlap:
        """Correlation of the errors of neighbours in a quantity that depends on U, V and W with these weights (3,)."""
        from dicflow.core.uncertainty.overlap import mixed

        part = _array(weights)
        return mixed([(float(share @ part / part.sum()), rho) for share, rho in self.kinds])

    def _variances(self, probe: Probe) -> np.ndarray:
        """Mean variance (3,) of U, V and W of a probe's points."""
        import numpy as np

        sigma = _array([self.total.sigma(name)[probe.rows, probe.cols] for name in "UVW"])
        return np.asarray((sigma**2).mean(axis=1))

    def _strain_correlations(self, probe: Probe) -> dict[str, ErrorCorrelation]:
        """Correlation of the errors of a probe's points in each strain."""
        from dicflow.core.probes.weights import complete_mean, strain_correlation
        from dicflow.core.strain.measures import strain_slope_coefficients

        total = self.total
        gradient, slopes = (complete_mean(field[probe.rows, probe.cols]) for field in (self.gradient, self.slopes))
        shares = strain_slope_coefficients(gradient, slopes, *gradient_measures(total)[:2])
        return {
            name: strain_correlation(self.rho(QUANTITIES[name].sources), total.window_points, total.degree, share)
            for name, share in shares._asdict().items()
        }


def _array(places: Any) -> np.ndarray:
    import numpy as np

    return np.array(places, dtype=float)


def _samples(line: Line) -> np.ndarray:
    """Places along a line, ends included."""
    import numpy as np

    start, end = _array(line)
    return np.asarray(np.linspace(start, end, _SAMPLES))


def _at_first_step(readings: list[dict[str, Readings]], missing: Collection[str]) -> dict[str, Readings]:
    """Readings at the first step: zero, and the lengths themselves. missing : probes without a value at any step"""
    zero = Reading(0.0, 0.0, 0.0, 0.0)

    def first(name: str) -> Readings:
        lengths = (reading[name]["first"] for reading in readings)
        length = next((length for length in lengths if math.isfinite(length.value)), _UNKNOWN)
        return {"length": length, "elongation": zero, "strain": zero}

    return {
        name: first(name) if "first" in values else dict.fromkeys(values, zero)
        for name, values in readings[0].items()
        if name not in missing
    } | {name: dict.fromkeys(readings[0][name], _UNKNOWN) for name in missing}


def _columns(readings: Readings, unit: str, parts: Sequence[str]) -> dict[str, float | None]:
    """A row of the table: each value with its errors, named with their unit."""
    row: dict[str, float | None] = {}
    for quantity, found in readings.items():
        if quantity != "first":
            ending = "" if unit_of(quantity, unit) == "1" else f"_{unit}"
            for part, value in found.parts().items():
                if part in parts:
                    row[f"{part}{quantity}{ending}"] = value if math.isfinite(value) else None
    return row


def _summary(readings: list[dict[str, Readings]]) -> dict[str, float]:
    """Strain of each extensometer at the last step that has one, and its σ."""
    summary: dict[str, float] = {}
    for name, values in readings[0].items():
        if "strain" in values:
            found = (reading[name]["strain"] for reading in reversed(readings))
            strain = next((reading for reading in found if math.isfinite(reading.value)), None)
            if strain is not None:
                summary |= {f"{name}_strain": strain.value, f"{name}_sigma_strain": strain.sigma}
    return summary
