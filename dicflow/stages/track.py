"""The region and its points followed from step to step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.features import FeatureSet
from dicflow.kinds.images import Images
from dicflow.kinds.matches import Matches
from dicflow.kinds.parts import with_parts
from dicflow.kinds.region import Region
from dicflow.kinds.status import known_or_nan
from dicflow.kinds.track import Track as TrackProduct
from dicflow.kinds.track import TrackedPoints, last_sight, lost_track
from dicflow.stages._lost import lost_status, lost_warning

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from dicflow.core.matching.part_tracking import FollowedRegion, MaterialGrid, Tracking
    from dicflow.core.matching.steps import Sight
    from dicflow.core.matching.tracking import TrackedSubsets

__all__ = ["Track", "sentence"]

Count = Annotated[int, Field(ge=1)]

OUTLINE_STEPS = 4  # material steps between the points of the carried outline


class _Photographed(NamedTuple):
    """Features and photographs of this step and of the one before; None if the ports are open."""

    features: Product | None = None
    features_before: Product | None = None
    images: Product | None = None
    images_before: Product | None = None

    def here(self) -> Sight | None:
        """What this step shows."""
        return _sight(self.images, self.features)

    def last(self, before: TrackProduct) -> Sight | None:
        """What the last step in which points were found shows."""
        return last_sight(before.product) if before.is_lost else _sight(self.images_before, self.features_before)


class Track(Node):
    """Follow the region: one plane transform per subset, estimated from the matches in it by MSAC.

    The material points, a regular grid at the first step, and the region's outline are carried from step to step. By
    default they follow the transforms, blended between the subsets' centres, plus the deviation of the matches around
    each point from these; without refined matches ``follow: blend`` is less noisy. A subset with too few matches, or a
    folding transform, gets the transform of its neighbours' matches; its points have the status FILLED from then on.
    Points that leave the photograph are lost.

    Each polygon of the region, and each part that its cuts leave, has subsets of its own and follows its own matches;
    beside a cut that ends inside a part, ``follow: matches`` takes those on the same side. Where a window of the
    matches would reach across the gap between parts, points follow the matches farther away, and are FILLED.

    A step in which no point is found loses all points there and no more: the next one is matched with the last in which
    they were found.
    """

    title: ClassVar = "track subsets"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "matches": Port("matches", optional=True),
        "features": Port("features", optional=True, of="matches"),
        "features_before": Port("features", at=At.PREVIOUS, optional=True),
        "images": Port("rectified", "plane", "images", optional=True, of="matches"),
        "images_before": Port("rectified", "plane", "images", at=At.PREVIOUS, optional=True),
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

    def run(
        self,
        region: Product,
        matches: Product | None = None,
        track_before: Product | None = None,
        **photographed: Product | None,
    ) -> Product:
        """``photographed`` has the ports of features and images."""
        first, material = self._first(Region.read(region))
        if track_before is None:
            summary = _summary(first.status, None)
            track = TrackProduct.write(first, _identity(self.subsets), self.step_size, summary)
        elif matches is None:
            raise StageError("no matches from the previous step; add a stage 'match' and name it as 'matches'")
        else:
            before = TrackProduct.read(track_before)
            track = self._next(material, Matches.read(matches), before, _Photographed(**photographed))
        return with_parts(track, material.parts)

    def _first(self, region: Region) -> tuple[TrackedPoints, MaterialGrid]:
        """The material grid on the region of the first step, and its parts."""
        import numpy as np

        from dicflow.core.matching.part_tracking import MaterialGrid
        from dicflow.core.photographs.region import bounding_box, carry, contains, parts_of_region
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
        parts = parts_of_region(polygons, region.cuts, points)
        return TrackedPoints(points, status, polygons), MaterialGrid(parts, polygons)

    def _next(self, material: MaterialGrid, matches: Matches, before: TrackProduct, shown: _Photographed) -> Product:
        """Points, outline and transforms, carried to this step from the last one in which points were found."""
        from dicflow.core.matching.part_tracking import RegionPlaces, beside_gaps, follow_region
        from dicflow.core.status import Status

        last = before.last
        pairs, features = _pairs(material, matches, before, shown)
        found = follow_region(material, RegionPlaces(last.points, last.polygons), pairs, features, self._tracking())
        found = found._replace(filled=found.filled | beside_gaps(material, last.points, matches.matching))
        status = _status(last.status, found, matches.image_size)
        followed = status <= Status.FILLED
        if not followed.any():
            return self._lost(before, status, shown)
        state = TrackedPoints(known_or_nan(followed, found.places.points), status, found.places.polygons)
        return TrackProduct.write(state, found.tracked, self.step_size, _summary(status, found.tracked))

    def _lost(self, before: TrackProduct, status: np.ndarray, shown: _Photographed) -> Product:
        """The product of a step in which no point is found."""
        import numpy as np

        from dicflow.core.matching.tracking import unknown_subsets
        from dicflow.core.status import Status

        last, check, here = before.last, self._advice(), shown.here()
        if (status[last.status <= Status.FILLED] == Status.OUTSIDE).any():
            check = "the region has left it"
        warning = f"no point is followed to this step; {check}"
        if here is not None:
            status, warning = (
                lost_status(status, here.image, (Status.UNTRACKED,)),
                lost_warning(here.image, "left", check),
            )
        state = TrackedPoints(np.full(last.points.shape, np.nan), status, last.polygons)
        subsets = unknown_subsets(before["transforms"].shape[:2])
        track = TrackProduct.write(state, subsets, self.step_size, _summary(status, None), [warning])
        return lost_track(track, last, shown.last(before))

    def _tracking(self) -> Tracking:
        from dicflow.core.matching.part_tracking import Tracking
        from dicflow.core.matching.tracking import Estimation

        estimation = Estimation(self.transform, self.threshold, self.confidence, self.min_inliers, self.seed)
        return Tracking(self.subsets, self.overlap, estimation, self.follow)

    def _advice(self) -> str:
        """What to do where the matches fit no transform."""
        return (
            f"in none of the region's {self.subsets[0]} × {self.subsets[1]} subsets do {self.min_inliers} matches fit "
            f"one {self.transform} transform: use smaller load steps, fewer subsets or another detector"
        )


def _sight(images: Product | None, features: Product | None) -> Sight | None:
    from dicflow.core.matching.steps import Sight

    if images is None or features is None:
        return None
    return Sight(Images.read(images).left, FeatureSet.read(features).features)


def _pairs(
    material: MaterialGrid, matches: Matches, before: TrackProduct, shown: _Photographed
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Positions (m, 2) of matches from the last step in which points were found to this one, and its features (n, 2).

    They are matched again after a lost step, and in a region of several parts. There are none after a lost step whose
    photograph is unknown.
    """
    import numpy as np

    from dicflow.core.matching.part_tracking import match_parts
    from dicflow.core.matching.steps import match_steps

    if material.parts.is_single and not before.is_lost:
        return matches.pairs, matches.features
    last, here = shown.last(before), shown.here()
    if last is None or here is None:
        return ((np.zeros((0, 2)),) * 2, np.zeros((0, 2))) if before.is_lost else (matches.pairs, matches.features)
    features = last.features.xy.astype(float)
    if not material.parts.is_single:
        return match_parts(material, before.last.points, last, here, matches.matching), features
    found = match_steps(last, here, matches.matching)
    return (found.source, found.target), features


def _status(before: np.ndarray, found: FollowedRegion, image_size: Sequence[int]) -> np.ndarray:
    """Status (rows, cols) of points that had a status before, from where they are found."""
    import numpy as np

    from dicflow.core.status import Status

    points, status = found.places.points, before.copy()
    alive, placed = status <= Status.FILLED, np.isfinite(points).all(axis=-1)
    with np.errstate(invalid="ignore"):
        seen = ((points >= 0) & (points <= np.asarray(image_size) - 1)).all(axis=-1)
    status[alive & found.filled] = Status.FILLED
    status[alive & ~placed] = Status.UNTRACKED
    status[alive & placed & ~seen] = Status.OUTSIDE
    return status


def _identity(shape: tuple[int, int]) -> TrackedSubsets:
    """The identity in every subset, without matches: the transforms of the first step."""
    import numpy as np

    from dicflow.core.matching.tracking import unknown_subsets

    identity = np.broadcast_to(np.eye(3), (*shape, 3, 3)).copy()
    return unknown_subsets(shape)._replace(transforms=identity)


def _summary(status: np.ndarray, tracked: TrackedSubsets | None) -> dict[str, Any]:
    """Number of followed points, and from the second step on counts and residual over the subsets."""
    import numpy as np

    from dicflow.core.status import Status

    followed = {"points": int((status <= Status.FILLED).sum())}
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


def sentence(stage: Track, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    rows, columns = stage.subsets
    return (
        f"The region was divided into {rows} × {columns} parts, each of which moved by the {stage.transform} transform "
        f"that fitted its matches by MSAC [torr2000]; material points at a distance of {stage.step_size:g} px were "
        "carried along from step to step."
    )
