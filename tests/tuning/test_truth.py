"""The recommended setting against exact strains: its true error is near the least one of all settings."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.kinds.total import Total
from dicflow.pipeline import Pipeline
from dicflow.tuning.choice import Wish
from dicflow.tuning.tune import tune
from tests.tuning.strained import band, photographed, uniform

NEAR = 1.15

SCENES = {
    "uniform strain": (uniform(0.01), 4.0, True),
    "a band of strain": (band(0.03, 25.0), 3.0, True),
    "a narrow band of strain, nothing at rest": (band(0.05, 10.0), 2.0, False),
}


class Measured:
    """A tuned scene, and the true errors of all that was tried."""

    def __init__(self, folder, scene, noise, still):
        motion, self.truth = scene
        path = photographed(folder, motion, noise, still)
        self.results = []
        self.found = tune(Pipeline.load(path), Wish(), self.run, lambda begun: None)
        self.true = np.array([self.error_of(trial) for trial in self.found.tried])

    def run(self, pipeline):
        self.results.append(pipeline.run(scheduler="sync", keep_going=True))
        return self.results[-1]

    def error_of(self, trial):
        """True root mean square error of εxx and εyy of one setting, over all its points."""
        result, tuned = self.results[-1], self.found.tuned
        values = {**tuned.values(trial.setting), f"{tuned.total}.degree": trial.setting.degree}
        total = Total.read(result.product(tuned.total, self.found.steps.deformed, result.values.index(values)))
        errors = np.stack([total["exx"], total["eyy"]]) - self.truth(total["xy_reference"])
        return float(np.sqrt(np.nanmean(errors**2)))


@pytest.fixture(scope="module", params=SCENES, ids=lambda name: name.replace(", ", "_").replace(" ", "_"))
def measured(request, tmp_path_factory):
    return request.param, Measured(tmp_path_factory.mktemp("scene") / "test", *SCENES[request.param])


@pytest.mark.slow
def test_the_recommended_setting_is_near_the_best(measured):
    _, scene = measured
    chosen = scene.true[scene.found.tried.index(scene.found.choice.trial)]
    assert chosen <= NEAR * scene.true.min()
    assert scene.true.max() > 2.0 * scene.true.min()  # there was something to choose


@pytest.mark.slow
def test_estimated_errors_are_those_of_the_truth(measured):
    _, scene = measured
    estimated = np.array([trial.error for trial in scene.found.tried])
    ratios = estimated / scene.true
    assert 0.8 < np.median(ratios) < 1.25
    assert (np.abs(np.log(ratios)) < np.log(1.6)).mean() > 0.9


@pytest.mark.slow
def test_the_step_at_rest_is_found(measured):
    name, scene = measured
    assert scene.found.steps.still == (None if "nothing at rest" in name else "step_1")
    assert scene.found.steps.deformed == ("step_1" if scene.found.steps.still is None else "step_2")
