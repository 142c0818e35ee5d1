"""Stress and stretch of a specimen from its load, its section and its length."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from pydantic import model_validator

from dicflow.engine.node import InputFile, Joined, Millimetres, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.channels import Channels
from dicflow.kinds.kind import titles_of
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.sheet import SheetFields
from dicflow.stages._curve import MODES, Measured, curve_product
from dicflow.stages._section import check_uncertainty

if TYPE_CHECKING:
    import numpy as np

    from dicflow.io.caliper import Caliper

__all__ = ["Stress", "sentence"]

_TO_NEWTON = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
_MASSES = {"g": 1e-3, "kg": 1.0}
_PRELOAD = 0.02
"""Load of the first step, relative to the largest one, up to which the specimen counts as unloaded."""
_ALONG = {"y": ("eyy", "exx"), "x": ("exx", "eyy")}


class _Series(NamedTuple):
    """A quantity at every step; u : (step,) — its independent uncertainty, None if unknown; common : relative share"""

    values: np.ndarray
    u: np.ndarray | None = None
    common: float = 0.0
    lateral: np.ndarray | None = None


class Stress(Node):
    """Nominal and true stress over the stretch, with intervals on both axes.

    Nominal stress is load per first section, P = F / (w t); true stress is P λ, since rubber keeps its volume. The load
    comes from ``channels``, or as masses from the caliper's table: F = m g. The stretch is that of a probe, an
    extensometer or an area, else the caliper's length over its first one. An area also gives the stretch across the
    load, and with it Poisson's and Hencky's ratio.

    The uncertainty of width and thickness scales every stress alike, and that of the first length every stretch. These
    **common** shares are kept apart from the **independent** ones of single readings: they do not average out.
    """

    title: ClassVar = "stress from load and section"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {
        "channels": Port("channels", optional=True),
        "probes": Port("probes", optional=True),
        "sheet": Port("sheet", optional=True),
    }
    gives: ClassVar = "curve"

    stage: Literal["stress"] = "stress"
    width: Millimetres | None = parameter(
        None, "of the unloaded section; absent: that of a stage sheet, between the edges of the region", unit="mm", gt=0
    )
    thickness: Millimetres = parameter(..., "thickness of the unloaded section", unit="mm", gt=0)
    u_width: Millimetres | None = parameter(
        None, "standard uncertainty of the width; absent: 0, or that of the stage sheet", unit="mm", ge=0
    )
    u_thickness: Millimetres = parameter(..., "standard uncertainty of the thickness", unit="mm", ge=0)
    mode: Literal["uniaxial", "planar", "equibiaxial", "biaxial"] = parameter("uniaxial", MODES)
    caliper: InputFile | None = parameter(None, "CSV table with the columns phase, load_g, length_mm; one row per step")
    u_length: Millimetres = parameter(0.05, "standard uncertainty of one caliper reading", unit="mm", ge=0)
    u_mass: float = parameter(0.1, "standard uncertainty of one mass of the table [g]", ge=0)
    gravity: float = parameter(9.80665, "acceleration of free fall [m/s²]", gt=9, lt=10)
    probe: str | None = parameter(None, "name of the extensometer or area whose strain is the stretch")
    axis: Literal["y", "x"] = parameter("y", "direction of the load in the image, for an area")

    @model_validator(mode="after")
    def _section(self) -> Stress:
        check_uncertainty("width", self.width, self.u_width)
        check_uncertainty("thickness", self.thickness, self.u_thickness)
        return self

    def check(self, path: Path) -> dict[str, Any]:
        from dicflow.io.caliper import read_caliper

        return {"rows": len(read_caliper(path).phase)}

    def joins(self, port: str) -> bool:
        return port != "sheet" or self.width is None

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        """A width, load or stretch that nobody gives."""
        if self.width is None and "sheet" not in joined:
            yield "width", "is missing; give it, or a stage sheet, which takes it from the edges of the region"
        if self.caliper is None and "channels" not in joined:
            yield "channels", "the load is missing; name a table with caliper: …, or a stage that gives channels"
        if self.probe is None and self.caliper is None:
            yield "probe", "the stretch is missing; name a probe, or a table with caliper: …"
        if self.probe is not None and "probes" not in joined:
            yield "probe", f"'{self.probe}' needs a stage 'probes'; add one"

    def run(
        self,
        caliper_path: Path | None = None,
        channels: Product | None = None,
        probes: Product | None = None,
        sheet: Product | None = None,
    ) -> Product:
        from dicflow.io.caliper import read_caliper

        caliper = None if caliper_path is None else read_caliper(caliper_path)
        steps, phases, load = self._load(caliper, channels)
        stretch = self._stretch(caliper, probes)
        if len(load.values) != len(stretch.values):
            raise StageError(
                f"{len(load.values)} loads for {len(stretch.values)} stretches; give one of each per step, the first "
                "for the unloaded specimen"
            )
        warnings = _of_first(load.values)
        width, u_width = self._width(sheet)
        area = width * self.thickness
        measured = Measured(
            steps,
            phases,
            stretch.values,
            load.values / area,
            stretch.u,
            None if load.u is None else load.u / area,
            stretch.lateral,
            load.values,
        )
        section = math.hypot(u_width / width, self.u_thickness / self.thickness)
        return curve_product(measured, self.mode, (math.hypot(section, load.common), stretch.common), warnings)

    def _width(self, sheet: Product | None) -> tuple[float, float]:
        """Width and its standard uncertainty [mm]."""
        if self.width is not None:
            return self.width, self.u_width or 0.0
        assert sheet is not None
        facts = SheetFields.read(sheet).facts
        return facts.width, facts.u_width if self.u_width is None else self.u_width

    def _load(self, caliper: Caliper | None, channels: Product | None) -> tuple[Sequence[str], Sequence[str], _Series]:
        """Names of the steps, their phases, and the load [N]; of the channels if there are any."""
        import numpy as np

        if channels is None:
            assert caliper is not None
            to_newton = 1e-3 * self.gravity
            load = caliper.load_g * to_newton
            u = np.where(load > 0.0, self.u_mass * to_newton, 0.0)
            steps = [str(number) for number in range(1, len(load) + 1)]
            return steps, (), _Series(load, np.maximum(u, 1e-9))
        table = Channels.read(channels)
        found = table.of(table.load)
        factor = _TO_NEWTON.get(found.unit, _MASSES.get(found.unit, 0.0) * self.gravity)
        if not factor:
            known = ", ".join([*_TO_NEWTON, *_MASSES])
            raise StageError(f"the load '{table.load}' has the unit '{found.unit}'; expected one of {known}")
        errors = None if found.u is None else found.u * factor
        return table.steps, table.phases, _Series(found.values * factor, errors)

    def _stretch(self, caliper: Caliper | None, probes: Product | None) -> _Series:
        import numpy as np

        if self.probe is not None:
            assert probes is not None
            return _of_probe(ProbeTable.read(probes), self.probe, self.axis)
        assert caliper is not None
        length = caliper.length_mm
        u = np.full(len(length), self.u_length / length[0])
        u[0] = 0.0
        return _Series(length / length[0], u, self.u_length / float(length[0]))


def _of_first(load: np.ndarray) -> list[str]:
    """A warning if the first step is under load. Raises StageError if that is the largest one."""
    import numpy as np

    size = np.abs(load)
    if not size[0] > _PRELOAD * np.nanmax(size):
        return []
    if size[0] == np.nanmax(size) and np.nanmin(size) < size[0]:
        raise StageError(
            f"the first step has the largest load, {load[0]:.4g} N, but stretches count from the first step, which is "
            "the unloaded specimen; look at the order of the steps"
        )
    return [
        f"the first step is under a load of {load[0]:.4g} N: the stretch counts from there, and is too small; measure "
        "the unloaded specimen first"
    ]


def _of_probe(table: ProbeTable, name: str, axis: str) -> _Series:
    """Stretch of an extensometer or an area at every step."""
    if name in table.extensometers:
        return _strained(partial(table.of_extensometer, name), "strain", table)
    along, across = _ALONG[axis]
    if not (title := titles_of(table.product).get(along, "engineering")).startswith("engineering"):
        raise StageError(f"the area has the {title}, but a stretch is engineering strain + 1; set measure: engineering")
    found = _strained(partial(table.of_area, name), along, table)
    return found._replace(lateral=1.0 + table.of_area(name, across))


def _strained(read: Callable[[str], np.ndarray], quantity: str, table: ProbeTable) -> _Series:
    """A strain as a stretch, with its uncertainty by single points and the calibration's share.

    read : gives an array of the probe by its name
    """
    import numpy as np

    stretch, u = 1.0 + read(quantity), read(f"u_{quantity}")
    common = read(f"calibration_{quantity}") if f"calibration_{quantity}" in table else np.zeros(1)
    return _Series(stretch, np.nan_to_num(u), float(np.nanmax(np.nan_to_num(common) / np.nanmax(stretch))))


def sentence(stage: Stress, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    section = f"of {stage.thickness:g} mm thickness and the width between the edges of the specimen in the photographs"
    if stage.width is not None:
        section = f"of {stage.width:g} × {stage.thickness:g} mm"
    return (
        f"Nominal stress is load per first section {section}; the uncertainty of the section is common to all stresses "
        "and was kept apart from that of single readings."
    )
