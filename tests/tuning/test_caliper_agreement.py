"""Settings against a caliper: the strain of the table, that of a total, and the words."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dicflow.io.caliper import Caliper
from dicflow.tuning import caliper as module
from dicflow.tuning.caliper import Agreement, Reading
from dicflow.views.tuning import caliper_words


@pytest.mark.parametrize(("lengths", "scale"), [((60.0, 61.25), 0.01), ((60.0, 61.0), 1.0), ((60.1, 60.125), 0.001)])
def test_a_caliper_is_certain_to_one_step_of_its_scale(lengths, scale):
    table = Caliper(("loading",) * 2, np.zeros(2), np.array(lengths))
    found = module._by_caliper(table, 1)
    assert found.strain == pytest.approx(lengths[1] / lengths[0] - 1.0)
    assert found.u == pytest.approx(math.sqrt(2.0) * scale / lengths[0])


def test_agreement_is_within_twice_the_uncertainty_of_both():
    settings = {"present": Reading(0.0114, 0.0), "recommended": Reading(0.0106, 0.0004)}
    found = Agreement("step_2", "extensometer E", Reading(0.01, 0.0003), settings)
    assert not found.agrees("present")
    assert found.agrees("recommended")
    assert found.difference("present") == pytest.approx(0.0014)
    words = caliper_words(found)
    assert words.startswith(
        "against the caliper, 1 % ± 300 µε at step_2 (extensometer E): present 1.14 %, does not agree"
    )
    assert words.endswith("recommended 1.06 % ± 400 µε, agrees (+600 µε)")


def test_a_setting_that_measures_nothing_there_is_said():
    assert caliper_words(Agreement("s", "mean of the field", Reading(0.01, 0.001), {})).endswith("nothing measured")
