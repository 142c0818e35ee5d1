"""dicflow: stereo digital image correlation as a cached graph of stages."""

from dicflow._version import __version__

__all__ = ["__version__"]
