"""The rig as the photographs of the specimen show it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from dicflow.engine.node import At, Degrees, Joined, Node, Odd, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.engine.share import free_threads
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig
from dicflow.stages._parameters import large_subset
from dicflow.stages._subsets import photograph_of

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Rig
    from dicflow.core.cameras.relative_orientation import MatchedPoints, Motion, Refined

__all__ = ["Refine", "sentence"]

_MOVED_GAIN = 6.0
"""Logarithm of the evidence for a motion from which the cameras are said to have moved."""
_WRONG_SIGMAS = 5.0
_MAX_WRONG_SHARE = 0.3
_MAX_MISFIT_PX = 0.1
"""Median distance from the epipolar lines from which the refined rig is doubtful too."""


class Refine(Node):
    """Refine a rig whose cameras have moved since the calibration, from the photographs of the specimen.

    Points are matched between the left and the right photographs of the first step and of those that follow it by 1, 2,
    4, 8 and 16. They show the relative orientation of the cameras: how far they are from their epipolar lines, at
    any depth. What the points do not show stays as it was calibrated, above all the length of the baseline, and has
    the uncertainty of the calibration and of a motion as large as the one that they show. Where ``free`` names them,
    focal lengths and principal points are estimated too.

    Every other stage takes the refined rig, unless it names the calibrated one.
    """

    title: ClassVar = "refine the rig"
    scope: ClassVar = Scope.RIG
    takes: ClassVar = {
        "rig": Port("rig"),
        "images": Port("images", at=At.FIRST),
        "images_early": Port("images", at=At.EARLY, optional=True),
    }
    gives: ClassVar = "rig"

    stage: Literal["refine"] = "refine"
    turn: Degrees = parameter(
        0.1,
        "how far a camera may have turned where the photographs do not show it, standard deviation; shifts that move "
        "the picture as far are as likely; 0 if only what they show has moved",
        unit="deg",
        ge=0,
        le=5,
    )
    free: list[Literal["focal_length", "principal_point"]] = parameter(
        [], "what has changed besides the relative orientation, as after refocusing"
    )
    subset_size: Odd = parameter(31, "side of the squares that are compared, side by side; odd", unit="px", ge=9)

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        return large_subset(self.subset_size, joined["images"])

    def run(self, rig: Product, images: Product, images_early: Sequence[Product] | None = None) -> Product:
        from dicflow.core.cameras.relative_orientation import MIN_POINTS, motion_since, refine_rig

        calibrated = CalibratedRig.read(rig)
        cameras = calibrated.cameras
        steps = [Images.read(product) for product in (images, *(images_early or ()))]
        points = _joined([self._points(cameras, photographs) for photographs in steps])
        if len(points.left) < MIN_POINTS:
            raise StageError(
                f"only {len(points.left)} points of the left photographs are found in the right ones, and {MIN_POINTS} "
                "are needed; check that both show the specimen at one moment, or take a smaller subset_size"
            )
        try:
            refined = refine_rig(cameras, calibrated.covariance, points, self.turn, self.free)
        except ValueError as error:
            raise StageError(f"the rig cannot be refined: {error}") from error
        found = _Found(cameras, refined, points, motion_since(cameras, refined), len(steps))
        covariance = refined.covariance
        return calibrated.refined(
            refined.rig, covariance, found.verdict, found.summary, found.warnings(calibrated.covariance is not None)
        )

    def _points(self, cameras: Rig, images: Images) -> MatchedPoints:
        """Points that both photographs of a step show."""
        from dicflow.core.correlation.pair_points import pair_points

        images.check_sizes(cameras)
        left, right = (photograph_of(images, side) for side in ("left", "right"))
        try:
            return pair_points(cameras, left, right, self.subset_size, free_threads())
        except ValueError as error:
            raise StageError(f"the rig cannot be refined: {error}") from error


class _Found(NamedTuple):
    """A refined rig with the points that it was refined from, and its motion since the calibration.

    steps : pairs of photographs with the points
    """

    before: Rig
    refined: Refined
    points: MatchedPoints
    motion: Motion
    steps: int

    @property
    def wrong(self) -> np.ndarray:
        """Which points (n,) are matched wrongly."""
        import numpy as np

        sigma = 1.4826 * np.median(np.abs(self.refined.residual))
        return np.asarray(np.abs(self.refined.residual) > _WRONG_SIGMAS * sigma)

    @property
    def distances(self) -> tuple[float, float]:
        """Median distance of the points from their epipolar lines, before and after [px]."""
        import numpy as np

        from dicflow.core.cameras.epipolar import epipolar_distance

        rigs = self.before, self.refined.rig
        before, after = (np.nanmedian(epipolar_distance(rig, self.points.left, self.points.right)) for rig in rigs)
        return float(before), float(after)

    @property
    def verdict(self) -> str:
        """What has happened to the cameras, in a sentence."""
        from dicflow.core.cameras.relative_orientation import unseen_motions

        before, after = self.distances
        turn, sigma_turn, shift, sigma_shift = self.motion
        pairs = "1 pair" if self.steps == 1 else f"{self.steps} pairs"
        shown = (
            f"as after a turn of the right camera by {self.refined.apparent_turn_deg:.2g}° since the calibration"
            if self.refined.gain > _MOVED_GAIN
            else "which shows no motion of the cameras since the calibration"
        )
        return (
            f"refined from {len(self.points.left):,} points of {pairs} of photographs: they were {before:.2g} px from "
            f"their epipolar lines (median), {shown}, and are {after:.2g} px from those of the refined rig; its right "
            f"camera stands turned by {turn:.2g}° ± {sigma_turn:.1g}° and shifted by {shift:.2g} mm ± "
            f"{sigma_shift:.1g} mm against the calibrated one; the photographs do not show "
            f"{', '.join(unseen_motions(self.refined))}"
        )

    @property
    def summary(self) -> dict[str, Any]:
        """Scalars by name."""
        from dicflow.core.cameras.rig_parameters import KEY_FIGURES, key_figure_sigmas, key_figures

        figures, sigmas = key_figures(self.refined.rig), key_figure_sigmas(self.refined.rig, self.refined.covariance)
        before, after = self.distances
        return {
            **dict(zip(KEY_FIGURES, map(float, figures), strict=True)),
            **{f"sigma_{name}": float(sigma) for name, sigma in zip(KEY_FIGURES, sigmas, strict=True)},
            **self.motion._asdict(),
            "apparent_turn_deg": self.refined.apparent_turn_deg,
            "points": len(self.points.left),
            "wrong_share": float(self.wrong.mean()),
            "distance_before_px": before,
            "distance_px": after,
            "noise_ratio": self.refined.noise,
        }

    def warnings(self, has_covariance: bool) -> list[str]:
        """What is doubtful. has_covariance : whether that of the calibration is known"""
        found = []
        if self.distances[1] > _MAX_MISFIT_PX:
            found.append(
                f"the refined rig leaves points {self.distances[1]:.2g} px from their epipolar lines (median); if a "
                "lens was refocused or exchanged, set free: [focal_length, principal_point], or calibrate anew"
            )
        if self.wrong.mean() > _MAX_WRONG_SHARE:
            found.append(f"{self.wrong.mean():.0%} of the points that refine the rig disagree with the others")
        if not has_covariance:
            found.append(
                "the calibration came without its uncertainty, so that the share of the calibration in σ counts the "
                "relative orientation of the cameras alone"
            )
        return found


def _joined(steps: Sequence[MatchedPoints]) -> MatchedPoints:
    """The points of all steps."""
    import numpy as np

    from dicflow.core.cameras.relative_orientation import MatchedPoints

    return MatchedPoints(*(np.concatenate(parts) for parts in zip(*steps, strict=True)))


def sentence(stage: Refine, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    freed = "".join(f", {name.replace('_', ' ')}s" for name in stage.free)
    text = (
        f"The relative orientation{freed} of the cameras was estimated from subsets of the specimen that both "
        "photographs of a step show, by their distances from the epipolar lines [hartley2004], with the calibration as "
        "prior and a motion of the cameras of greatest evidence [mackay1992]"
    )
    if product is None:
        return text + "."
    found = CalibratedRig.read(product).summary
    return f"{text}; {found['points']:,} points lay {found['distance_px']:.2g} px from their lines (median)."
