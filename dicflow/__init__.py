"""dicflow: stereo digital image correlation as a cached graph of stages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dicflow._version import __version__

if TYPE_CHECKING:
    from dicflow.pipeline import Pipeline, Result

__all__ = ["Pipeline", "Result", "__version__"]


def __getattr__(name: str) -> Any:
    """Load the pipeline only when it is asked for, so that the command line answers at once; with it, what draws."""
    if name in ("Pipeline", "Result"):
        import dicflow.views  # noqa: F401  what draws results makes itself known to them
        from dicflow import pipeline

        return getattr(pipeline, name)
    raise AttributeError(f"module 'dicflow' has no attribute '{name}'")
