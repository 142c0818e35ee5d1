"""Strains with the bias of the places."""

import numpy as np
import pytest

from dicflow.core.strain.degree_choice import candidate_fits, chosen_gradient
from dicflow.core.strain.place_bias import with_bias_of_places
from tests.core.strain.test_degree_choice import NOISE_PX, SHAPE, WINDOW, X, measured


def chosen_without_bias():
    surface = measured(np.stack([0.01 * X, 0.0 * X], axis=-1))
    chosen = chosen_gradient(surface, candidate_fits(WINDOW, 1))
    return chosen._replace(bias=np.zeros_like(chosen.bias)), surface


def test_a_bias_as_large_as_noise_counts_as_much():
    """Along its axis alone: neighbours share both as far as their subsets overlap."""
    chosen, surface = chosen_without_bias()
    places = np.broadcast_to([NOISE_PX, 0.0, 0.0], (*SHAPE, 3))
    bias, noise = (
        np.diagonal(values, axis1=-2, axis2=-1)
        for values in (with_bias_of_places(chosen, surface, places).bias, chosen.surface.covariance)
    )
    assert bias[..., :2] == pytest.approx(noise[..., :2], rel=1e-6)
    assert bias[..., 2:].max() < 1e-6 * noise.max()


def test_a_small_or_unknown_one_counts_for_nothing():
    chosen, surface = chosen_without_bias()
    for places in (None, np.full((*SHAPE, 3), np.nan), np.full((*SHAPE, 3), 0.1 * NOISE_PX)):
        assert not with_bias_of_places(chosen, surface, places).bias.any()
