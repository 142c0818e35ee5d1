"""One result minus another: the numbers, the reasons, and where there is no difference."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.core.status import Status
from dicflow.explorer.differences import DifferenceFields, obstacle
from dicflow.explorer.pack import pack
from dicflow.explorer.packing import LinearScale, unpacked
from dicflow.explorer.reading import read_source
from tests.explorer.waves import Bare, Waves


class Other(Waves):
    """The waves with half the strain, other gaps, one step less, a quantity less and an angle more."""

    def __init__(self, **options):
        super().__init__(**options)
        self.steps = self.steps[1:]

    def quantities(self):
        exx, w, _ = super().quantities()
        return [exx | {"title": "engineering strain εxx, VSG 60 px"}, w, exx | {"name": "angle", "unit": "deg"}]

    def read(self, step):
        found = Waves().read(step)
        status = found.status.copy()
        status[5, 5] = Status.MISFIT
        exx = np.where(status > Status.FILLED, np.nan, 0.5 * found.values["exx"])
        return found._replace(values={**found.values, "exx": exx}, status=status)


class Shifted(Waves):
    """The waves on a grid that lies elsewhere."""

    def at_first(self):
        return super().at_first() + 0.25


class Unfollowed(Waves):
    """Waves whose points are other ones at every step."""

    def first_sources(self):
        return None


@pytest.fixture(scope="module")
def difference():
    return DifferenceFields(Waves(), Other())


def test_values_are_those_of_one_minus_the_other(difference):
    assert list(difference.steps) == Other().steps
    for step in difference.steps:
        one, found = Waves().read(step), difference.read(step)
        known = np.isfinite(found.values["exx"])
        np.testing.assert_allclose(found.values["exx"][known], 0.5 * one.values["exx"][known], rtol=1e-12)
        assert not known[5, 5]
        assert (found.status[~known] > Status.FILLED).all()
        assert (found.status[5, 5], found.status[1, 0]) == (Status.MISFIT, Status.HIDDEN)
        np.testing.assert_array_equal(found.values["W"][known], 0.0)
        np.testing.assert_array_equal(found.places["left"], one.places["left"])
        assert found.errors == {}


def test_a_point_reads_the_difference_without_an_uncertainty(difference):
    step, k = difference.steps[1], 15 * 40 + 20
    value, error = difference.at_point(step, "exx", k)
    assert value == pytest.approx(difference.read(step).values["exx"].flat[k], rel=1e-12)
    assert value != 0.0
    assert np.isnan(error)


def test_facts_are_those_of_the_first_but_for_form_and_directions(difference):
    assert difference.facts == {**Waves.facts, "form": "difference", "directions": ""}


def test_quantities_are_those_of_both_and_no_angles(difference):
    titles = {one["name"]: (one["symbol"], one["title"], one["signed"]) for one in difference.quantities()}
    assert titles == {
        "exx": (
            "Δεxx",
            "difference of engineering strain εxx, VSG 40 px and engineering strain εxx, VSG 60 px",
            True,
        ),
        "W": ("ΔW", "difference of displacement W", True),
    }


def test_exchanged_sides_have_the_other_sign():
    one, other = Waves(), Other()
    there, back = (DifferenceFields(*pair).read("step_003").values for pair in ((one, other), (other, one)))
    np.testing.assert_array_equal(there["exx"], -back["exx"])


def test_the_page_has_colours_about_zero_and_the_numbers(difference):
    reading = read_source(Bare(Waves()), difference, lambda _sources, make: make(), 400)
    found = pack(reading, "difference", lambda _sources, make: make(), 7e6)
    exx, w = found.manifest["quantities"]
    assert exx["range"][0] == -exx["range"][1] < 0
    assert w["range"] == (-0.5e-6, 0.5e-6)
    assert exx["colours"] == "RdBu_r"
    assert found.manifest["curves"] == []
    step = found.manifest["steps"][2]
    scale = LinearScale(*exx["scale"])
    back = scale.values(unpacked(found.blobs[step["blobs"]["value/exx"]], tuple(step["shape"])))
    truth = difference.read(step["name"]).values["exx"]
    assert np.nanmax(np.abs(back - truth)) <= scale.quantum / 2 * (1 + 1e-9)
    assert (np.isnan(back) == np.isnan(truth)).all()


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (Other(), ""),
        (Shifted(), "grids differ"),
        (Waves(rows=29), "grids differ"),
        (Unfollowed(), "not the same material"),
    ],
)
def test_why_there_is_no_difference(other, words):
    found = obstacle(Waves(), other)
    assert words in found
    assert bool(found) == bool(words)


def test_nothing_in_common_is_said():
    late, bare = Waves(), Waves()
    late.steps = [f"late_{step}" for step in late.steps]
    assert "No step" in obstacle(Waves(), late)
    bare.quantities = lambda: [one | {"unit": "px"} for one in Waves().quantities()]
    assert "No quantity" in obstacle(Waves(), bare)
