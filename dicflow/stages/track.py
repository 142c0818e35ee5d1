"""The region and its points followed from step to step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.matches import Matches
from dicflow.kinds.region import Region
from dicflow.kinds.track import Track as TrackProduct

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np

    from dicflow.core.matching.tracking import SubsetGrid, TrackedSubsets
    from dicflow.core.photographs.polygon import Polygon

    Pairs = tuple[np.ndarray, np.ndarray]

__all__ = ["Track"]

Count = Annotated[int, Field(ge=1)]

OUTLINE_STEPS = 4  # material steps between the points of the carried outline


class State(NamedTuple):
    """Material points (rows, cols, 2) with their status (rows, cols), and the region, at one step [px]."""

    points: np.ndarray
    status: np.ndarray
    polygons: Sequence[Polygon]


class Track(Node):
    """Follow the region: one plane transform per subset, estimated from the matches in it by MSAC.

    The material points, a regular grid at the first step, and the region's outline are carried from step to step. By
    default they follow the transforms, blended between the subsets' centres, plus the deviation of the matches around
    each point from these; without refined matches ``follow: blend`` is less noisy. A subset with too few matches, or a
    folding transform, gets the transform of its neighbours' matches; its points have the status FILLED from then on.
    Points that leave the photograph are lost.
    """

    title: ClassVar = "track subsets"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "matches": Port("matches", optional=True),
        "region": Port("region"),
        "track_before": Port("track", at=At.PREVIOUS, own=True),
    }
    gives: ClassVar = "track"

    stage: Literal["track"] = "track"
    transform: Literal["similarity", "affine", "projective"] = parameter("projective", "transform of each subset")
    subsets: tuple[Count, Count] = parameter((3, 3), "rows and columns of subsets over the region's bounding box")
    overlap: float = parameter(0.25, "share of its size by which each side of a subset reaches over", ge=0, le=1)
    threshold: float = parameter(1.5, "distance from which a match counts as wrong", unit="px", gt=0)
    confidence: float = parameter(0.99, "probability of having tried a sample without wrong matches", gt=0, lt=1)
    min_inliers: int = parameter(8, "a subset with fewer fitting matches is filled from its neighbours", ge=4)
    seed: int = parameter(0, "of the random samples", ge=0)
    follow: Literal["matches", "blend", "subset"] = parameter(
        "matches",
        "points follow the matches around them, the transforms blended between subsets, or their own subset's alone",
    )
    step_size: float = parameter(5.0, "distance of the material points at the first step", unit="px", ge=1)

    def run(self, region: Product, matches: Product | None = None, track_before: Product | None = None) -> Product:
        if track_before is None:
            return self._first(Region.read(region))
        if matches is None:
            raise StageError("no matches from the previous step; add a stage 'match' and name it as 'matches'")
        return self._next(Matches.read(matches), TrackProduct.read(track_before))

    def _first(self, region: Region) -> Product:
        """The material grid on the region of the first step, and identity transforms."""
        import numpy as np

        from dicflow.core.photographs.region import bounding_box, carry, contains
        from dicflow.core.status import Status

        polygons = carry(region.polygons, lambda ring: ring, spacing_px=OUTLINE_STEPS * self.step_size)
        x0, y0, x1, y1 = bounding_box(polygons)
        axes = (np.arange(np.ceil(low), high, self.step_size) for low, high in ((x0, x1), (y0, y1)))
        points = np.stack(np.meshgrid(*axes), axis=-1)
        inside = contains(polygons, points)
        if not inside.any():
            raise StageError(
                f"the region of {x1 - x0:.0f} × {y1 - y0:.0f} px contains no point of a grid of {self.step_size} px; "
                "use a smaller step_size or a larger region"
            )
        points[~inside] = np.nan
        status = np.where(inside, Status.VALID, Status.OUTSIDE).astype(np.uint8)
        return self._product(State(points, status, polygons), None)

    def _next(self, matches: Matches, before: TrackProduct) -> Product:
        """Points, outline and transforms, carried from the previous step to this one."""
        from dicflow.core.matching.tracking import nearest_subset, subset_grid
        from dicflow.core.photographs.region import bounding_box

        state = State(before["points"], before["status"], before.polygons)
        grid = subset_grid(bounding_box(state.polygons), self.subsets, self.overlap)
        tracked = self._transforms(grid, state.polygons, matches)
        mapping = self._mapping(grid, tracked, _inside(state.polygons, matches))
        filled = tracked.filled[nearest_subset(grid, state.points)]
        return self._product(_carried(state, mapping, filled, matches.image_size), tracked)

    def _transforms(self, grid: SubsetGrid, polygons: Sequence[Polygon], matches: Matches) -> TrackedSubsets:
        """Transforms of all subsets. Raises StageError if no subset has enough inliers."""
        from dicflow.core.matching.tracking import Estimation, track_subsets

        estimation = Estimation(self.transform, self.threshold, self.confidence, self.min_inliers, self.seed)
        tracked = track_subsets(grid, polygons, *matches.pairs, matches.features, estimation)
        if tracked is None:
            if len(matches.pairs.source) == 0:
                raise StageError(
                    "no feature of the previous step is found again: this photograph or the previous one shows no "
                    "speckles; check light, exposure and focus, or leave that step out"
                )
            raise StageError(self._too_few_inliers(len(_inside(polygons, matches)[0])))
        return tracked

    def _mapping(self, grid: SubsetGrid, tracked: TrackedSubsets, pairs: Pairs) -> Callable[[np.ndarray], np.ndarray]:
        """The mapping of points (..., 2) from the previous step to this one [px].

        pairs : positions (n, 2) of the matches in the region at both steps [px]
        """
        from dicflow.core.matching.tracking import carry_points, follow_matches

        if self.follow == "matches":
            return lambda points: follow_matches(grid, tracked.transforms, *pairs, points)
        return lambda points: carry_points(grid, tracked.transforms, points, blend=self.follow == "blend")

    def _too_few_inliers(self, matches: int) -> str:
        """The message for a region whose matches fit no transform."""
        return (
            f"{matches} matches in the region, but in none of its {self.subsets[0]} × {self.subsets[1]} subsets do "
            f"{self.min_inliers} fit one {self.transform} transform; use smaller load steps, fewer subsets or another "
            "detector"
        )

    def _product(self, state: State, tracked: TrackedSubsets | None) -> Product:
        subsets = tracked or _identity(self.subsets)
        return TrackProduct.write(
            state.points, state.status, state.polygons, subsets, self.step_size, _summary(state, tracked)
        )


def _inside(polygons: Sequence[Polygon], matches: Matches) -> Pairs:
    """Positions (n, 2) at both steps of the matches in the region at the previous step [px]."""
    from dicflow.core.photographs.region import contains

    source, target = matches.pairs
    inside = contains(polygons, source)
    return source[inside], target[inside]


def _carried(
    state: State, mapping: Callable[[np.ndarray], np.ndarray], filled: np.ndarray, image_size: Sequence[int]
) -> State:
    """The state at the next step.

    mapping : carries points (..., 2) there
    filled : (rows, cols) — points in subsets whose transform is that of their neighbours
    """
    import numpy as np

    from dicflow.core.photographs.region import carry
    from dicflow.core.status import Status

    points, status = mapping(state.points), state.status.copy()
    alive, placed = status <= Status.FILLED, np.isfinite(points).all(axis=-1)
    with np.errstate(invalid="ignore"):
        seen = ((points >= 0) & (points <= np.asarray(image_size) - 1)).all(axis=-1)
    status[alive & filled] = Status.FILLED
    status[alive & ~placed] = Status.UNTRACKED
    status[alive & placed & ~seen] = Status.OUTSIDE
    points[status > Status.FILLED] = np.nan
    return State(points, status, carry(state.polygons, mapping))


def _identity(shape: tuple[int, int]) -> TrackedSubsets:
    """The identity in every subset, without matches: the transforms of the first step."""
    import numpy as np

    from dicflow.core.matching.tracking import TrackedSubsets

    none, no = np.zeros(shape, dtype=np.int32), np.zeros(shape, dtype=bool)
    identity = np.broadcast_to(np.eye(3), (*shape, 3, 3)).copy()
    return TrackedSubsets(identity, none, none, none, np.full(shape, np.nan), no, no)


def _summary(state: State, tracked: TrackedSubsets | None) -> dict[str, Any]:
    """Number of followed points, and from the second step on counts and residual over the subsets."""
    import numpy as np

    from dicflow.core.status import Status

    followed = {"points": int((state.status <= Status.FILLED).sum())}
    if tracked is None:
        return followed
    measured = np.isfinite(tracked.residual_px)
    inliers = tracked.inliers[measured]
    residual = float(np.sqrt(np.average(tracked.residual_px[measured] ** 2, weights=inliers)))
    return {
        **followed,
        "subsets": int((~tracked.empty).sum()),
        "subsets_filled": int(tracked.filled.sum()),
        "matches": int(tracked.matches[~tracked.empty].sum()),
        "inliers": int(inliers.sum()),
        "residual_px": residual,
    }
