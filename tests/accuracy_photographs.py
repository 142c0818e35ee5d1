"""How exact subset correlation and triangulation are on real photographs of others, and points that others matched."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.io import loadmat

from dicflow.core.cameras.camera import Camera, Rig
from dicflow.core.cameras.triangulate import triangulate
from dicflow.core.status import Status
from tests.bars import Figure
from tests.data_folder import SHARED
from tests.figures import run_text

NECKING = """\
stages:
  photos: {stage: images, left: "*.tif"}
  region: {stage: region, images: photos}
  features: {stage: features, images: photos, detector: AKAZE}
  matches: {stage: match, images: photos, guided: false, refine: false}
  correlation: {stage: correlate, images: photos}
  total: {stage: deformation, points: correlation}
"""
RIGID_POINTS = SHARED / "rigid_points"


def rigid_points() -> Iterator[Figure]:
    """A cylinder on a stage, moved 15 times by 0 to 2.8 mm; points that another program matched, with its calibration.

    A translation is the length of the points' mean displacement. That of 0 has no error, being the reference.
    """
    stage = loadmat(RIGID_POINTS / "stage_translations.mat")["disp_stage"].ravel()
    matched = np.load(RIGID_POINTS / "RBM_matched_points.npz")
    ours = triangulate(_published_rig(), matched["points_cam1"] - 1.0, matched["points_cam2"] - 1.0).xyz
    for whose, points in (("", ours), (", as that program triangulates", matched["X3d_triangulated"])):
        displacement = points - points[0]
        translation = np.linalg.norm(np.nanmean(displacement, axis=1), axis=-1)
        errors = 1e3 * np.abs(translation - stage)
        name = f"rigid points{whose}"
        yield Figure(f"{name}: mean error of the 15 translations", errors.mean(), None if whose else 1.6, unit="µm")
        yield Figure("  of the 14 that are not zero", errors[1:].mean(), unit="µm")
        each = 1e3 * np.abs(np.linalg.norm(displacement, axis=-1) - stage[:, None])
        yield Figure("  of every point in the 15", float(np.nanmean(each)), unit="µm")


def _published_rig() -> Rig:
    """The calibration that comes with the points, whose pixels are counted from 1."""
    found = np.load(RIGID_POINTS / "stereo_calibration.npz")
    width, height = found["image_size"].astype(int).tolist()
    first_pixel = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    left, right = (
        Camera(found[f"K{side}"] - first_pixel, np.append(found[f"d{side}"], 0.0), (width, height)) for side in (1, 2)
    )
    return Rig(left, right, found["R"], found["t"])


def necking() -> Iterator[Figure]:
    """A tensile bar up to necking, in one camera; its ends leave the photograph."""
    result = run_text("precise_necking", NECKING, SHARED / "necking")
    totals = [result.product("total", step) for step in result.steps("total")]
    laid = np.isfinite(result.product("correlation", 0)["xy"]).all(axis=-1)
    followed = sum(bool(np.isfinite(total["eyy"]).any()) for total in totals)
    yield Figure("necking, precise: photographs followed after the first", followed, 9, at_least=True)
    status, last = result.product("correlation", -1)["status"], totals[-1]
    name = "necking, precise, last photograph"
    yield Figure(f"{name}: share of the points alive", float((status[laid] == Status.VALID).mean()))
    here = status[laid & (status != Status.OUTSIDE)]
    yield Figure(f"{name}: share of those that have not left the frame", float((here == Status.VALID).mean()))
    strain = last["eyy"][np.isfinite(last["eyy"])]
    yield Figure(f"{name}: largest strain, in the neck", float(strain.max()))
    yield Figure(f"{name}: median strain", float(np.median(strain)))
    determinant = np.linalg.det(last["gradient"][np.isfinite(last["eyy"])])
    yield Figure(f"{name}: least determinant of F, no fold", float(determinant.min()), 0.0, at_least=True)
