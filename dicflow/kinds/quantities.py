"""The table of quantities of a deformation, which stages, maps, exports and reports read.

A further quantity, or measure of strain, is one entry and the function that it names: here, or as an entry point
``dicflow.quantities`` of another package. ``deformation`` computes it if its parameters name it.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from dicflow.discovery import Registry, nearest
from dicflow.errors import ConfigurationError

if TYPE_CHECKING:
    from dicflow.core.strain.measures import GradientFunction, StretchFunction

__all__ = [
    "BASIC",
    "DISPLACEMENTS",
    "ERRORS",
    "LENGTH",
    "MEASURES",
    "QUANTITIES",
    "REPORTED",
    "STRAINS",
    "UNCERTAINTY",
    "Quantity",
    "StrainMeasure",
    "figure_in_words",
    "further_quantity",
    "gradient_functions",
    "is_signed",
    "of_field",
    "strain_function",
    "strain_measure",
    "symbol_of",
    "unit_of",
]

_PLUGINS = Registry("quantity", "", "dicflow.quantities")
_Entry = TypeVar("_Entry", "Quantity", "StrainMeasure")

LENGTH = "length"
"""Unit of a quantity that is given in the measurement's unit of length: mm, or px with one camera."""

Use = Literal["probes", "noise_floor", "report", "sweep"]

UNCERTAINTY = "uncertainty u"
"""Name of the combined standard uncertainty, by noise and the bias that remains."""

ERRORS = {
    "sigma_": "σ of the {title}",
    "bias_": "remaining bias of the {title}",
    "u_": f"{UNCERTAINTY} of the {{title}}",
    "calibration_": "calibration's share in σ of the {title}",
}
"""What arrays of these prefixes hold of a quantity: standard deviation by noise, standard deviation of the bias that
remains, both combined, and the calibration's share beside them."""


@dataclass(frozen=True)
class Quantity:
    """One quantity of a total.

    name : of its array
    symbol : as in a formula
    title : name at a colour bar; ``{measure}`` stands for the measure of strain
    definition : one sentence
    unit : of its values: LENGTH, "deg", "px²" …; "1" for a pure number
    positive : what a positive value means; "" for values that are never negative
    sources : which of U, V and W its errors come from, and to what share; None if unknown
    calibrated : whether the calibration's share in its σ is computed
    uses : where it is shown or read, apart from maps and exports
    function : ``module:function`` that computes it from deformation gradients (..., 2, 2); "" for those that
        :mod:`dicflow.core.strain.measures` computes itself
    """

    name: str
    symbol: str
    title: str
    definition: str
    unit: str = "1"
    positive: str = ""
    sources: tuple[float, float, float] | None = None
    calibrated: bool = True
    uses: tuple[Use, ...] = ()
    function: str = ""

    @property
    def is_displacement(self) -> bool:
        """Whether it is a component of the displacement, which belongs to a point and not to a gauge around it."""
        return self.unit == LENGTH

    def unit_in(self, length: str) -> str:
        """Unit of its values if lengths have the given unit."""
        return length if self.unit == LENGTH else self.unit


@dataclass(frozen=True)
class StrainMeasure:
    """One measure of strain.

    name : in pipeline files
    title : as a caption names it
    definition : one sentence, or a formula of the stretch λ
    function : ``module:function`` of the principal stretches λ (...); "" for engineering strain, which is that of
        fibres
    """

    name: str
    title: str
    definition: str
    function: str


_EVERYWHERE: tuple[Use, ...] = ("probes", "noise_floor", "report", "sweep")
_NO_SWEEP: tuple[Use, ...] = ("probes", "noise_floor", "report")

QUANTITIES = {
    quantity.name: quantity
    for quantity in (
        Quantity(
            "U", "U", "displacement U", "displacement along X since the first step", LENGTH,
            "towards larger X", (1, 0, 0), uses=_EVERYWHERE,
        ),
        Quantity(
            "V", "V", "displacement V", "displacement along Y since the first step", LENGTH,
            "towards larger Y", (0, 1, 0), uses=_EVERYWHERE,
        ),
        Quantity(
            "W", "W", "displacement W", "displacement along Z since the first step", LENGTH,
            "towards larger Z", (0, 0, 1), uses=_NO_SWEEP,
        ),
        Quantity(
            "exx", "εxx", "{measure} εxx", "strain of the direction x", positive="longer", sources=(1, 0, 0),
            uses=_EVERYWHERE,
        ),
        Quantity(
            "eyy", "εyy", "{measure} εyy", "strain of the direction y", positive="longer", sources=(0, 1, 0),
            uses=_EVERYWHERE,
        ),
        Quantity(
            "gxy", "γxy", "{measure} γxy", "decrease of the right angle between x and y", positive="a smaller angle",
            sources=(0.5, 0.5, 0), uses=_NO_SWEEP,
        ),
        Quantity(
            "e1", "ε1", "{measure} ε1", "larger principal strain", positive="longer", uses=("noise_floor", "report"),
        ),
        Quantity(
            "e2", "ε2", "{measure} ε2", "smaller principal strain", positive="longer", uses=("noise_floor", "report"),
        ),
        Quantity(
            "angle", "θ1", "direction of ε1", "direction of the larger principal strain from x", "deg", "towards y",
            calibrated=False,
        ),
        Quantity(
            "rotation", "ω", "rotation in the surface", "rotation of the material in the tangent plane", "deg",
            "from x towards y", calibrated=False,
        ),
        Quantity(
            "von_mises", "εvM", "von Mises strain (logarithmic, incompressible)",
            "equivalent logarithmic strain of an incompressible material: in uniaxial tension that along the load",
        ),
        Quantity(
            "area_change", "ΔA/A", "area change", "relative change of the surface's area", positive="larger",
            uses=("noise_floor",),
        ),
    )
}  # fmt: skip
"""All quantities of dicflow by the name of their array, in the order in which they are listed."""

BASIC = ("U", "V", "W", "exx", "eyy", "gxy")
"""What every total has."""

DISPLACEMENTS = tuple(name for name in BASIC if QUANTITIES[name].is_displacement)
"""The displacements that every total has."""

STRAINS = tuple(name for name in BASIC if not QUANTITIES[name].is_displacement)
"""The strains that every total has."""

REPORTED = (
    *(name for name, quantity in QUANTITIES.items() if "report" in quantity.uses),
    *(f"sigma_{name}" for name in ("exx", "eyy")),
    "znssd",
)
"""Arrays of a total whose maps the report shows, in this order, behind those of the maps stage."""

_CORE = "dicflow.core.strain.measures"
_PRINCIPAL = "along the principal directions"
_FIBRES = "stretch λ − 1 of the fibres along x and y, γ the decrease of their angle"
MEASURES = {
    measure.name: measure
    for measure in (
        StrainMeasure("engineering", "engineering strain", _FIBRES, ""),
        StrainMeasure(
            "green_lagrange", "Green–Lagrange strain", f"(λ² − 1) / 2 {_PRINCIPAL}", f"{_CORE}:green_lagrange_strain"
        ),
        StrainMeasure("hencky", "Hencky strain", f"ln λ {_PRINCIPAL}", f"{_CORE}:hencky_strain"),
        StrainMeasure(
            "euler_almansi", "Euler–Almansi strain", f"(1 − λ⁻²) / 2 {_PRINCIPAL}", f"{_CORE}:almansi_strain"
        ),
        StrainMeasure("biot", "Biot strain", f"λ − 1 {_PRINCIPAL}", f"{_CORE}:biot_strain"),
    )
}
"""All measures of strain of dicflow by their names in pipeline files."""


def strain_measure(name: str) -> StrainMeasure:
    """The measure of a name. Raises ConfigurationError that suggests the nearest for an unknown one."""
    return _entry(name, MEASURES, StrainMeasure, "measure of strain")


def figure_in_words(name: str, value: float, length: str) -> str:
    """A value of one of :data:`QUANTITIES` in a sentence: ``0.012 mm for V``. length : unit of lengths"""
    quantity = QUANTITIES[name]
    unit = quantity.unit_in(length)
    return f"{value:.2g}{'' if unit == '1' else f' {unit}'} for {quantity.symbol}"


def further_quantity(name: str) -> Quantity:
    """The quantity of a name that has a function of its own. Raises ConfigurationError for any other."""
    own = {key: quantity for key, quantity in QUANTITIES.items() if quantity.function}
    return _entry(name, own, Quantity, "further quantity")


def strain_function(name: str) -> StretchFunction | None:
    """The function of the stretch by which a measure is defined; None for engineering strain."""
    measure = strain_measure(name)
    function: StretchFunction | None = _loaded(measure.function) if measure.function else None
    return function


def gradient_functions(names: tuple[str, ...]) -> dict[str, GradientFunction]:
    """Name → function of the deformation gradient of further quantities."""
    return {name: _loaded(further_quantity(name).function) for name in names}


def _entry(name: str, own: Mapping[str, _Entry], sort: type[_Entry], what: str) -> _Entry:
    """An entry of ours, or of a package that is installed."""
    if name in own and name in _PLUGINS.names():
        raise ConfigurationError(f"{what} '{name}' is dicflow's, and of {_PLUGINS.find(name).place}; rename that one")
    if name in own:
        return own[name]
    if name not in _PLUGINS.names():
        known = (*own, *(other for other in _PLUGINS.names() if _is_sort(other, sort)))
        raise ConfigurationError(f"unknown {what} '{name}'{nearest(name, known)}; known: {', '.join(known) or 'none'}")
    found, place = _PLUGINS.load(name), _PLUGINS.find(name).place
    if not isinstance(found, sort):
        raise ConfigurationError(
            f"'{name}' of {place} is of type {type(found).__name__}; a {what} is a {sort.__name__}"
        )
    if found.name != name:
        raise ConfigurationError(f"{place} has the name '{found.name}'; give it and its entry point one name")
    _check_function(found.function, place)
    return found


def _is_sort(name: str, sort: type[Any]) -> bool:
    try:
        return isinstance(_PLUGINS.load(name), sort)
    except ConfigurationError:
        return False


def _check_function(function: str, place: str) -> None:
    """Raise ConfigurationError for a function that does not exist, where its module is loaded anyway."""
    module, _, name = function.partition(":")
    if not name or (module in sys.modules and not hasattr(sys.modules[module], name)):
        raise ConfigurationError(f"{place}: function '{function}' does not exist; write package.module:function")


def _loaded(place: str) -> Any:
    """The function of a place ``module:function``."""
    module, _, function = place.partition(":")
    return getattr(importlib.import_module(module), function)


def of_field(name: str) -> Quantity | None:
    """The quantity whose value or error an array holds; None for any other array."""
    for prefix in ERRORS:
        name = name.removeprefix(prefix)
    if name in QUANTITIES or name not in _PLUGINS.names():
        return QUANTITIES.get(name)
    found = _PLUGINS.load(name)
    return found if isinstance(found, Quantity) else None


def symbol_of(name: str) -> str:
    """The symbol of one of :data:`QUANTITIES`; any other name stays as it is."""
    return QUANTITIES[name].symbol if name in QUANTITIES else name


def is_signed(name: str) -> bool:
    """Whether values of both signs mean opposite things; true for an unknown array, false for a standard deviation."""
    quantity = of_field(name)
    return quantity is None or (quantity.name == name and bool(quantity.positive))


def unit_of(name: str, length: str) -> str:
    """Unit of an array of a total, or of what a probe reads; lengths and elongations are in the unit given."""
    quantity = of_field(name)
    if quantity is not None:
        return quantity.unit_in(length)
    return length if name in ("length", "elongation") else "1"
