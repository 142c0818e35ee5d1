import numpy as np
import pytest

from dicflow.core.material.fit import Curve
from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.prediction import stable_within
from dicflow.core.material.response import stress_in_mode
from dicflow.core.material.stability import is_stable, stable_range


@pytest.mark.parametrize("mode", MODES)
def test_neo_hooke_is_stable_everywhere(mode):
    found = stable_range(MODELS["neo_hooke"], np.array([0.2]), mode)
    assert not found.is_lower_limit
    assert not found.is_upper_limit


def test_mooney_rivlin_with_a_negative_constant_turns_unstable_where_theory_says():
    """In log strains the matrix ∂²W/∂ε² of powers 2 and −2 is 4 C10 (λa² δab + λ3²) + 4 C01 (λa⁻² δab + λ3⁻²)."""
    c, stretch = np.array([0.3, -0.05]), np.linspace(1.0, 4.0, 301)
    x = principal_stretches("planar", stretch)
    terms = 4 * (c[0] * x**2 + c[1] * x**-2)
    expected = (terms[:, 0] + terms[:, 2] > 0) & (
        (terms[:, 0] + terms[:, 2]) * (terms[:, 1] + terms[:, 2]) > terms[:, 2] ** 2
    )
    assert np.array_equal(is_stable(MODELS["mooney_rivlin"], c, x), expected)
    assert 0 < expected.sum() < len(expected)
    end = stretch[~expected][0]
    found = stable_range(MODELS["mooney_rivlin"], c, "planar")
    assert found.is_upper_limit
    assert found.most == pytest.approx(end, rel=0.02)


def test_a_falling_stress_is_unstable():
    model, c = MODELS["yeoh"], np.array([0.2, -0.02, 0.0])
    stretch = np.linspace(1.0, 4.0, 601)
    true = stress_in_mode(model, c, "uniaxial", stretch) * stretch
    falls = stretch[:-1][np.diff(true) < 0][0]
    assert stable_range(model, c, "uniaxial").most <= falls + 0.02


def test_the_measured_range_and_a_tenth_beyond():
    model, c = MODELS["mooney_rivlin"], np.array([0.3, -0.05])
    limit = stable_range(model, c, "planar").most
    for most, is_found in ((1 + (limit - 1) / 1.2, False), (1 + (limit - 1) / 1.05, True)):
        curve = Curve("a", "planar", principal_stretches("planar", np.array([1.1, most])), np.zeros(2))
        assert ("planar" in stable_within(model, c, [curve])) is is_found
