"""dicflow: stereo digital image correlation as a cached graph of stages.

>>> import dicflow
>>> dicflow.Pipeline.load("pipelines/quickstart.yaml", data="data_samples")
<dicflow.Pipeline quickstart.yaml: 14 stages>
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dicflow._version import __version__

if TYPE_CHECKING:
    from dicflow.pipeline import Pipeline, Result
    from dicflow.start.arrays import measure
    from dicflow.views.figures import plot

__all__ = ["Pipeline", "Result", "__version__", "measure", "plot"]


def __getattr__(name: str) -> Any:
    """Load what is asked for only then, so that the command line answers at once."""
    if name in ("Pipeline", "Result"):
        from dicflow import pipeline

        return getattr(pipeline, name)
    if name == "measure":
        from dicflow.start.arrays import measure

        return measure
    if name == "plot":
        from dicflow.views.figures import plot

        return plot
    raise AttributeError(f"module 'dicflow' has no attribute '{name}'")
