"""Whole experiments with exact truth: photographs, boards, caliper table, region and truth in one folder."""

from dicflow.synth.experiment import Experiment, latex_experiment, sample_experiment
from dicflow.synth.folder import write_experiment, write_sample

__all__ = ["Experiment", "latex_experiment", "sample_experiment", "write_experiment", "write_sample"]
