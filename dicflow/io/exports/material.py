"""Constants of fitted models as lines for finite-element programs, each with its convention.

One text file per product. Stresses are in MPa, for models in mm and N. Every form is written for an incompressible
material: bulk terms are 0 (Abaqus: hybrid elements; Ansys: mixed u-P; FEniCS and felupe: add a volumetric part).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from dicflow._version import __version__
from dicflow.errors import ConfigurationError
from dicflow.io.exports.items import Item, place
from dicflow.kinds.material import FittedModel, Material

__all__ = ["BESIDE", "DESCRIPTION", "KINDS", "PROGRAMS", "lines_of", "write"]

DESCRIPTION = "constants for FEniCS, felupe, Abaqus and Ansys"
KINDS = ("material",)
BESIDE = ("material",)


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One text per product: of each model the conventions, then lines for every program that has it."""
    for item in items:
        if item.quantities:
            raise ConfigurationError("constants have no quantities; leave --quantity out")
        found = Material.read(item.product)
        text = "\n".join([*_head(item.stem, found), *(line for model in found.models for line in _model_lines(model))])
        place(folder, f"{item.stem}.txt").write_text(text + "\n", encoding="utf-8")


def _head(stem: str, found: Material) -> list[str]:
    tests = ", ".join(f"{curve.name} ({curve.mode})" for curve in found.curves)
    return [
        f"{stem}: hyperelastic constants, dicflow {__version__}",
        f"fitted to {tests}; the best model first",
        "units: N, mm, MPa; bulk terms are 0 (incompressible): use hybrid or mixed elements, or add a volumetric part",
        *found.verdict,
        "",
    ]


def _model_lines(model: FittedModel) -> list[str]:
    constants = [
        f"  {one.name} = {one.value:.10g}"
        + (" MPa" if one.unit == "MPa" else "")
        + (" (stopped at a limit of the search)" if one.at_limit else f" ± {one.half_width:.3g} (95 %)")
        for one in model.constants
    ]
    programs = [line for program in PROGRAMS for line in _program_lines(program, model)]
    return [f"== {model.title}: {model.formula}", *constants, *programs, ""]


def _program_lines(program: str, model: FittedModel) -> list[str]:
    found = lines_of(program, model.name, model.values)
    if not found:
        return [f"-- {program}: has no such model of its own"]
    convention, lines = found
    return [f"-- {program}: {convention}", *lines]


def lines_of(program: str, model: str, values: Sequence[float]) -> tuple[str, list[str]] | None:
    """The convention of a program, and its lines for a model; None if it has no such model.

    program : one of PROGRAMS
    values : of dicflow's constants
    """
    form = PROGRAMS[program].get(model)
    return None if form is None else form(values)


Form = Callable[[Sequence[float]], tuple[str, list[str]]]


def _number(value: float) -> str:
    return f"{value:.10g}"


def _listed(values: Iterable[float]) -> str:
    return ", ".join(map(_number, values))


def _pairs(values: Sequence[float]) -> list[tuple[float, float]]:
    """Factors and exponents of Ogden's terms."""
    return list(zip(values[0::2], values[1::2], strict=True))


# Abaqus


def _abaqus(kind: str, values: Sequence[float], convention: str, bulk: int) -> tuple[str, list[str]]:
    """A keyword with its data, eight to a line; D terms of 0 mean incompressible."""
    data = [*map(_number, values), *["0"] * bulk]
    rows = [", ".join(data[start : start + 8]) for start in range(0, len(data), 8)]
    return convention, [f"*HYPERELASTIC, {kind}", *rows]


def _abaqus_ogden(values: Sequence[float]) -> tuple[str, list[str]]:
    """U = Σ 2 μi/αi² (…): the shear modulus is Σ μi, so μi = μk αk / 2 of dicflow's."""
    changed = [number for mu, alpha in _pairs(values) for number in (mu * alpha / 2.0, alpha)]
    convention = "U = Σ 2 μi/αi² (λ1^αi + λ2^αi + λ3^αi − 3), shear modulus Σ μi: its μi are μk αk/2 of those above"
    return _abaqus(f"OGDEN, N={len(values) // 2}", changed, convention, len(values) // 2)


_ABAQUS: Mapping[str, Form] = {
    "neo_hooke": lambda c: _abaqus("NEO HOOKE", c, "U = C10 (I1 − 3); C10, D1", 1),
    "mooney_rivlin": lambda c: _abaqus("MOONEY-RIVLIN", c, "U = C10 (I1 − 3) + C01 (I2 − 3); C10, C01, D1", 1),
    "yeoh": lambda c: _abaqus("YEOH", c, "U = Σ Ci0 (I1 − 3)^i; C10, C20, C30, D1, D2, D3", 3),
    "ogden_1": _abaqus_ogden,
    "ogden_2": _abaqus_ogden,
    "ogden_3": _abaqus_ogden,
    "arruda_boyce": lambda c: _abaqus("ARRUDA-BOYCE", c, "series of five terms as above; mu, lambda_m, D", 1),
}

# Ansys


def _ansys(option: str, values: Sequence[float], convention: str, order: str = "") -> tuple[str, list[str]]:
    """TB and TBDATA, six values to a line."""
    lines = [f"TB,HYPER,1,1,{order},{option}"]
    for start in range(0, len(values), 6):
        lines.append(",".join(["TBDATA", str(start + 1), *map(_number, values[start : start + 6])]))
    return convention, lines


def _ansys_ogden(values: Sequence[float]) -> tuple[str, list[str]]:
    convention = "W = Σ μi/αi (λ1^αi + λ2^αi + λ3^αi − 3), shear modulus ½ Σ μi αi: μi and αi as above"
    return _ansys("OGDEN", values, convention, str(len(values) // 2))


_ANSYS: Mapping[str, Form] = {
    "neo_hooke": lambda c: _ansys("NEO", [2.0 * c[0]], "W = μ/2 (I1 − 3): μ = 2 C10"),
    "mooney_rivlin": lambda c: _ansys("MOONEY", c, "W = C10 (I1 − 3) + C01 (I2 − 3); C10, C01", "2"),
    "yeoh": lambda c: _ansys("YEOH", c, "W = Σ Ci0 (I1 − 3)^i; C10, C20, C30", "3"),
    "ogden_1": _ansys_ogden,
    "ogden_2": _ansys_ogden,
    "ogden_3": _ansys_ogden,
    "gent": lambda c: _ansys("GENT", c, "W = −μ Jm/2 ln(1 − (I1 − 3)/Jm); mu, Jm"),
    "arruda_boyce": lambda c: _ansys("BOYCE", c, "series of five terms as above; mu, lambda_L = lambda_m"),
}

# felupe


def _felupe(name: str, convention: str, **values: object) -> tuple[str, list[str]]:
    given = ", ".join(f"{key}={_python(value)}" for key, value in values.items())
    return convention, [f"umat = felupe.Hyperelastic(felupe.{name}, {given})"]


def _python(value: object) -> str:
    return f"[{_listed(value)}]" if isinstance(value, list) else _number(float(str(value)))


def _felupe_ogden(values: Sequence[float]) -> tuple[str, list[str]]:
    factors = [mu * alpha / 2.0 for mu, alpha in _pairs(values)]
    convention = "ψ = Σ 2 μi/αi² (λ1^αi + λ2^αi + λ3^αi − 3), shear modulus Σ μi: its μi are μk αk/2 of those above"
    return _felupe("ogden", convention, mu=factors, alpha=list(values[1::2]))


_FELUPE: Mapping[str, Form] = {
    "neo_hooke": lambda c: _felupe("neo_hooke", "ψ = μ/2 (I1 − 3): mu = 2 C10", mu=2.0 * c[0]),
    "mooney_rivlin": lambda c: _felupe("mooney_rivlin", "ψ = C10 (I1 − 3) + C01 (I2 − 3)", C10=c[0], C01=c[1]),
    "yeoh": lambda c: _felupe("yeoh", "ψ = Σ Ci0 (I1 − 3)^i", C10=c[0], C20=c[1], C30=c[2]),
    "ogden_1": _felupe_ogden,
    "ogden_2": _felupe_ogden,
    "ogden_3": _felupe_ogden,
    "arruda_boyce": lambda c: _felupe(
        "arruda_boyce", "ψ = C1 Σ ai (I1^i − 3^i) / limit^(2i−2): C1 = mu, limit = lambda_m", C1=c[0], limit=c[1]
    ),
}

# FEniCS: UFL of the isochoric energy of a right Cauchy–Green tensor with determinant 1

_INVARIANTS = "I1 = tr(C); I2 = (tr(C)**2 - tr(C*C))/2"
_STRETCHES = "l1, l2, l3: principal stretches, square roots of the eigenvalues of C"


def _ufl(convention: str, psi: str) -> tuple[str, list[str]]:
    return convention, [f"psi = {psi}"]


def _ufl_yeoh(values: Sequence[float]) -> tuple[str, list[str]]:
    return _ufl(_INVARIANTS, " + ".join(f"({_number(c)})*(I1 - 3)**{i}" for i, c in enumerate(values, start=1)))


def _ufl_ogden(values: Sequence[float]) -> tuple[str, list[str]]:
    return _ufl(_STRETCHES, " + ".join(_ufl_term(_number(mu), _number(alpha)) for mu, alpha in _pairs(values)))


def _ufl_term(mu: str, alpha: str) -> str:
    powers = " + ".join(f"l{axis}**({alpha})" for axis in (1, 2, 3))
    return f"({mu})/({alpha})*({powers} - 3)"


def _ufl_gent(values: Sequence[float]) -> tuple[str, list[str]]:
    mu, limit = map(_number, values)
    return _ufl(_INVARIANTS, f"-({mu})*({limit})/2*ln(1 - (I1 - 3)/({limit}))")


def _ufl_arruda_boyce(values: Sequence[float]) -> tuple[str, list[str]]:
    mu, limit = map(_number, values)
    series = " + ".join(
        f"{factor}*(I1**{i} - {3**i})/({limit})**{2 * i - 2}"
        for i, factor in enumerate(("1/2", "1/20", "11/1050", "19/7000", "519/673750"), start=1)
    )
    return _ufl(_INVARIANTS, f"({mu})*({series})")


_FENICS: Mapping[str, Form] = {
    "neo_hooke": _ufl_yeoh,
    "mooney_rivlin": lambda c: _ufl(_INVARIANTS, f"({_number(c[0])})*(I1 - 3) + ({_number(c[1])})*(I2 - 3)"),
    "yeoh": _ufl_yeoh,
    "ogden_1": _ufl_ogden,
    "ogden_2": _ufl_ogden,
    "ogden_3": _ufl_ogden,
    "gent": _ufl_gent,
    "arruda_boyce": _ufl_arruda_boyce,
}

PROGRAMS: Mapping[str, Mapping[str, Form]] = {
    "FEniCS (UFL)": _FENICS,
    "felupe": _FELUPE,
    "Abaqus": _ABAQUS,
    "Ansys": _ANSYS,
}
"""Program → model → its convention and lines."""
