import numpy as np
import pytest

from dicflow.core.status import Status
from tests.measured_scenes import QUANTITIES, Measured, MeasuredScene, pooled, row
from tests.scene_bars import MOST_TILT_BIAS_UM, coverage, scene_figures, worst
from tests.scenes_in_space import SCENES, scene
from tests.scenes_in_space.files import draws_of
from tests.scenes_in_space.truth import ring_in_photograph

COUNT = 20_000


def points(places=None, **scale):
    """Errors drawn as they are stated, but for the quantities of which the errors are so many times larger."""
    rng = np.random.default_rng(5)
    places = np.full((COUNT, 2), 400.0) if places is None else places
    n = len(places)
    error = {name: 1e-3 * scale.get(name, 1.0) * rng.normal(size=n) for name in QUANTITIES}
    stated = {name: np.full(n, 1e-3) for name in QUANTITIES}
    return Measured(places, error, stated, np.zeros(n, dtype=np.uint8), np.full(n, 99.0), np.zeros(n, dtype=int), 31)


def verdicts(figures):
    return {figure.quantity.split(": ", 1)[1]: figure.verdict for figure in figures}


def test_errors_as_stated_meet_all_bars_of_coverage():
    assert all(figure.verdict == "ok" for figure in coverage("scene", points()))


@pytest.mark.parametrize("factor", [0.7, 1.5])
def test_one_quantity_that_states_too_much_or_too_little_misses_them(factor):
    figures = list(coverage("scene", points(exx=factor)))
    assert all("(exx)" in figure.quantity for figure in figures[:2])
    assert figures[0].verdict == figures[1].verdict == "MISSED"


def test_a_step_without_a_valid_point_misses_them():
    lost = points()
    lost.status[:] = Status.HIDDEN
    assert all(figure.verdict == "MISSED" for figure in coverage("scene", lost))


def test_the_worst_of_all_steps_is_named():
    found = list(worst({1: points(), 2: points(gxy=2.0), 3: points()}))
    assert [(quantity, step) for *_, quantity, step in found] == [("gxy", 2)] * 3


def test_a_scene_that_is_not_measured_misses_its_bars():
    figures = list(scene_figures("strip", MeasuredScene({}, {"a gauge": np.nan})))
    assert [figure.verdict for figure in figures] == ["MISSED", "MISSED"]


def test_a_biased_tilt_misses_its_bar():
    for bias, verdict in ((0.5, "ok"), (2.0, "MISSED")):
        shifted = points()
        shifted.error["W"][:] += 1e-3 * bias * MOST_TILT_BIAS_UM
        assert verdicts(scene_figures("tilt", MeasuredScene({3: shifted}, {})))["|bias of W|"] == verdict


def cracked(places_off=(0.0, 25.0, 60.0)):
    """Points on a crack, and so many pixels below it; 200 each."""
    line = np.column_stack([np.linspace(-30.0, 5.0, 200), np.zeros(200)])
    at_crack = ring_in_photograph(scene("crack"), line)
    return points(np.concatenate([at_crack + np.array([0.0, off]) for off in places_off]))


def verdict_of(found, words):
    return verdicts(scene_figures("crack", MeasuredScene({1: found}, {})))[words]


def test_wrong_points_that_a_crack_cuts_must_be_lost():
    found, words = cracked(), "points cut by a crack lost or right to 3u"
    found.error["V"][:10] = 1.0
    assert verdict_of(found, words) == "MISSED"
    found.status[:10] = Status.MISFIT
    assert verdict_of(found, words) == "ok"


def test_wrong_strains_beside_a_crack_are_counted():
    found, words = cracked(), "strains beyond 3u beside a crack"
    found.error["eyy"][400:420] = 1.0
    assert verdict_of(found, words) == "ok"
    found.error["eyy"][200:220] = 1.0
    assert verdict_of(found, words) == "MISSED"


def test_lost_points_are_counted_only_away_from_a_crack():
    found, words = cracked(), "valid away from it"
    found.status[:300] = Status.UNTRACKED
    assert verdict_of(found, words) == "ok"
    found.status[400:440] = Status.UNTRACKED
    assert verdict_of(found, words) == "MISSED"


def test_the_points_of_all_draws_count_together():
    draws = [points(exx=factor)._replace(draw=np.full(COUNT, k)) for k, factor in enumerate((0.01, 100.0, 100.0))]
    found = row(pooled(draws), "exx")
    assert found.points == 3 * COUNT
    assert found.within_1 == pytest.approx(100.0 / 3.0, abs=1.0)
    assert found.spread == pytest.approx(100.0 / np.sqrt(3.0), abs=1.0)


def test_small_scenes_are_photographed_more_often():
    draws = {name: draws_of(scene(name)) for name in SCENES}
    assert draws["leap"] > 4 * draws["gentle"]
    assert draws["inner_crack"] > draws["hairline"]
    assert min(draws.values()) >= 4
