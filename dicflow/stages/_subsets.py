"""Parameters of the search for subsets, which the stages of both cameras share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from dicflow.engine.node import Node, Pixels, parameter
from dicflow.engine.share import free_threads
from dicflow.kinds.images import Images

if TYPE_CHECKING:
    from dicflow.core.correlation.material import Updating
    from dicflow.core.correlation.search import Search
    from dicflow.core.photographs.exposure import Photograph

__all__ = ["ReferenceUpdate", "ShapeFunction", "SubsetSearch", "photograph_of"]

ShapeFunction = Literal["affine", "quadratic"]
_SPLINE_DEGREE = {"bicubic": 3, "biquintic": 5}


class ReferenceUpdate(BaseModel):
    """When points are followed from a reference step instead of the first photograph."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    update: Literal["on_demand", "every", "never"] = parameter(
        "on_demand", "when to take a reference step: when too many points are lost, every so many steps, or never"
    )
    steps: int = parameter(10, "update: every takes a reference step after this many steps", ge=1)
    lost: float = parameter(
        0.002, "share of points lost since the previous step above which a reference step is taken", ge=0, le=1
    )
    znssd: float = parameter(
        0.1, "median ZNSSD against the reference step above which a later one replaces it", gt=0, le=4
    )

    def updating(self) -> Updating:
        """These settings for :mod:`dicflow.core.correlation.material`."""
        from dicflow.core.correlation.material import Updating

        every = self.steps if self.update == "every" else 0
        return Updating(self.update != "never", self.lost, self.znssd, every)


class SubsetSearch(Node):
    """How the subset of a point is searched in another photograph."""

    interpolation: Literal["bicubic", "biquintic"] = parameter("biquintic", "spline between the pixels")
    gaussian: Pixels = parameter(
        0.0, "standard deviation of the weight of a subset's pixels; 0 for equal ones", unit="px", ge=0
    )
    max_znssd: float = parameter(
        0.3, "a point with a larger ZNSSD is lost (the zero-mean cross-correlation is 1 − ZNSSD/2)", gt=0, le=4
    )
    min_share: float = parameter(0.4, "share of a subset's pixels that must lie in the region", gt=0, le=1)
    max_iterations: int = parameter(30, "of the Gauss-Newton search", ge=1)
    tolerance: float = parameter(
        1e-3,
        "largest correction left in a subset when the search ends; rounding does not allow less than 1e-5",
        unit="px",
        ge=1e-5,
    )
    smoothing: Pixels = parameter(
        0.0, "standard deviation of a Gaussian low pass against the bias of interpolation; 0 for none", unit="px", ge=0
    )
    misfit: bool = parameter(
        True, "count the misfit of subsets beyond the noise in the uncertainties: patterns too sharp, or changed"
    )
    reference: ReferenceUpdate = parameter(ReferenceUpdate(), "when points are followed from a reference step")
    threads: Literal["auto"] | Annotated[int, Field(ge=1)] = parameter(
        "auto",
        "threads that share the points of a step; auto takes the cores that no other task can use",
        affects="speed",
    )

    @property
    def spline_degree(self) -> int:
        """Degree of the spline between the pixels."""
        return _SPLINE_DEGREE[self.interpolation]

    @property
    def thread_count(self) -> int:
        """Threads that share the points."""
        return free_threads() if self.threads == "auto" else self.threads

    def search(self, subset_size: int, noise: float, shape_function: ShapeFunction) -> Search:
        """The search for subsets.

        subset_size : side of a subset [px]
        noise : of the photographs after the low pass [grey levels]
        """
        from dicflow.core.correlation.search import Search
        from dicflow.core.correlation.subsets import Subset

        subset = Subset(subset_size, shape_function, self.gaussian, self.min_share, self.max_iterations, self.tolerance)
        return Search(
            subset,
            self.spline_degree,
            self.smoothing,
            self.max_znssd,
            noise,
            threads=self.thread_count,
            counts_misfit=self.misfit,
        )


def photograph_of(images: Images, side: str) -> Photograph:
    """The left or right photograph with the pixels that are measured: neither clipped nor masked."""
    from dicflow.core.photographs.exposure import photograph

    return photograph(images.right if side == "right" else images.left, images.counts(side))
