"""From a pipeline file to a run and its results."""

from dicflow.pipeline.pipeline import Pipeline
from dicflow.pipeline.result import Result

__all__ = ["Pipeline", "Result"]
