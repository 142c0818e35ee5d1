"""The exported lines, read back by each program's own documented energy, give the stresses of the fitted model."""

import re

import numpy as np
import pytest

from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.response import stress_in_mode
from dicflow.io.exports.items import Item
from dicflow.io.exports.material import PROGRAMS, lines_of, write
from dicflow.kinds.material import FittedConstant, FittedCurve, FittedModel, Material
from tests.core.material.test_models import CONSTANTS

SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def invariants(x):
    """I1 and I2 of principal stretches (..., 3) by the invariants of C."""
    c = x**2
    return c.sum(axis=-1), (c.sum(axis=-1) ** 2 - (c**2).sum(axis=-1)) / 2


def polynomial(constants, x):
    return sum(c * (invariants(x)[0] - 3) ** i for i, c in enumerate(constants, start=1))


def mooney(constants, x):
    i1, i2 = invariants(x)
    return constants[0] * (i1 - 3) + constants[1] * (i2 - 3)


def arruda_boyce(constants, x):
    mu, limit = constants
    return mu * sum(a / limit ** (2 * i - 2) * (invariants(x)[0] ** i - 3**i) for i, a in enumerate(SERIES, start=1))


def ogden(factor):
    """Ogden's energy with Σ factor(μ, α) (λ1^α + λ2^α + λ3^α − 3)."""
    return lambda pairs, x: sum(factor(m, a) * ((x**a).sum(axis=-1) - 3) for m, a in pairs)


def of_abaqus(lines, x):
    (head, *data), kind = lines, lines[0].split(",")[1].strip()
    numbers = [float(cell) for line in data for cell in line.split(",")]
    assert head.startswith("*HYPERELASTIC, ")
    assert all(len(line.split(",")) <= 8 for line in data)
    if kind == "OGDEN":
        terms = int(head.partition("N=")[2])
        assert numbers[2 * terms :] == [0.0] * terms
        return ogden(lambda m, a: 2 * m / a**2)(np.reshape(numbers[: 2 * terms], (terms, 2)), x)
    count = {"NEO HOOKE": 1, "MOONEY-RIVLIN": 2, "YEOH": 3, "ARRUDA-BOYCE": 2}[kind]
    assert not any(numbers[count:])
    energy = {"MOONEY-RIVLIN": mooney, "ARRUDA-BOYCE": arruda_boyce}.get(kind, polynomial)
    return energy(numbers[:count], x)


def of_ansys(lines, x):
    """TB,HYPER,material,temperatures,NPTS,option."""
    command, (_, _, _, _, terms, kind) = lines[0], lines[0].split(",")
    assert command.startswith("TB,HYPER,1,1,")
    numbers, place = [], 1
    for line in lines[1:]:
        word, start, *cells = line.split(",")
        assert (word, int(start)) == ("TBDATA", place)
        numbers += map(float, cells)
        place += len(cells)
    if kind == "OGDEN":
        assert len(numbers) == 2 * int(terms)
        return ogden(lambda m, a: m / a)(np.reshape(numbers, (-1, 2)), x)
    if kind == "GENT":
        mu, limit = numbers
        return -mu * limit / 2 * np.log(1 - (invariants(x)[0] - 3) / limit)
    if kind == "NEO":
        return numbers[0] / 2 * (invariants(x)[0] - 3)
    return {"MOONEY": mooney, "YEOH": polynomial, "BOYCE": arruda_boyce}[kind](numbers, x)


def of_felupe(lines, x):
    (line,) = lines
    name, given = re.fullmatch(r"umat = felupe\.Hyperelastic\(felupe\.(\w+), (.*)\)", line).groups()
    values = eval(f"dict({given})", {"dict": dict})
    if name == "ogden":
        pairs = list(zip(values["mu"], values["alpha"], strict=True))
        return ogden(lambda m, a: 2 * m / a**2)(pairs, x)
    if name == "neo_hooke":
        return values["mu"] / 2 * (invariants(x)[0] - 3)
    if name == "arruda_boyce":
        return arruda_boyce([values["C1"], values["limit"]], x)
    energy = {"mooney_rivlin": mooney, "yeoh": polynomial}[name]
    return energy([values[key] for key in {"mooney_rivlin": ("C10", "C01"), "yeoh": ("C10", "C20", "C30")}[name]], x)


def of_fenics(lines, x):
    i1, i2 = invariants(x)
    l1, l2, l3 = np.moveaxis(x, -1, 0)
    scope = {"I1": i1, "I2": i2, "l1": l1, "l2": l2, "l3": l3, "ln": np.log}
    exec("\n".join(lines), scope)
    return scope["psi"]


READERS = {"Abaqus": of_abaqus, "Ansys": of_ansys, "felupe": of_felupe, "FEniCS (UFL)": of_fenics}
PAIRS = [(program, model) for program, models in PROGRAMS.items() for model in models]


@pytest.mark.parametrize(("program", "name"), PAIRS)
@pytest.mark.parametrize("mode", MODES)
def test_each_convention_gives_the_stresses_of_the_model(program, name, mode):
    stretch, constants = np.array([0.8, 1.3, 2.1]), CONSTANTS[name]
    _, lines = lines_of(program, name, constants)

    def energy(x):
        return READERS[program](lines, principal_stretches(mode, x))

    share = 2.0 if mode == "equibiaxial" else 1.0
    found = (energy(stretch + 1e-6) - energy(stretch - 1e-6)) / 2e-6 / share
    np.testing.assert_allclose(found, stress_in_mode(MODELS[name], np.array(constants), mode, stretch), rtol=1e-6)


def test_every_program_has_the_models_it_can():
    assert READERS.keys() == PROGRAMS.keys()
    assert PROGRAMS["FEniCS (UFL)"].keys() == PROGRAMS["Ansys"].keys() == MODELS.keys()
    assert MODELS.keys() - PROGRAMS["Abaqus"].keys() == MODELS.keys() - PROGRAMS["felupe"].keys() == {"gent"}


def fitted(name, at_limit=False):
    listed = zip(MODELS[name].constants, CONSTANTS[name], strict=True)
    constants = [
        FittedConstant(one.name, "MPa" if one.is_stress else "1", value, 0.01, 0.0, 0.02, at_limit)
        for one, value in listed
    ]
    model = MODELS[name]
    return FittedModel(
        name=name, title=model.title, formula=model.formula, constants=constants, covariance=[], correlation=[],
        condition=1.0, aicc=None, rms=[0.01], left_out=[None], rms_all=0.01, scatter=0.0, misfit_ratio=None, freedom=8,
        shear_modulus=(0.4, 0.1), young_modulus=(1.2, 0.3), unstable={}, unsure=[], others=[],
    )  # fmt: skip


def product(*models):
    curves = [FittedCurve("strip", "uniaxial", 12, 0.0)]
    return Material.write(curves, {}, models, {}, ["Nothing is known of other modes."], {})


def test_file(tmp_path):
    write([Item("rubber", None, product(fitted("ogden_2"), fitted("gent", at_limit=True)))], tmp_path, "rubber")
    text = (tmp_path / "rubber.txt").read_text(encoding="utf-8")
    for part in (
        "fitted to strip (uniaxial)",
        "Nothing is known of other modes.",
        "mu1 = 0.5 MPa ± 0.02 (95 %)",
        "alpha1 = 1.7 ± 0.02 (95 %)",
        "Jm = 30 (stopped at a limit of the search)",
        "-- Abaqus: has no such model of its own",
        "*HYPERELASTIC, OGDEN, N=2\n0.425, 1.7, 0.023, -2.3, 0, 0\n",
        "TB,HYPER,1,1,2,OGDEN\nTBDATA,1,0.5,1.7,-0.02,-2.3\n",
    ):
        assert part in text


def test_kind_returns_what_was_written():
    found = Material.read(product(fitted("yeoh")))
    assert found.models == (fitted("yeoh"),)
    assert found.curves == (FittedCurve("strip", "uniaxial", 12, 0.0),)
    assert [row["constant"] for row in found.rows] == ["C10", "C20", "C30"]
    assert found.rows[0]["low_95"] == pytest.approx(0.18)
