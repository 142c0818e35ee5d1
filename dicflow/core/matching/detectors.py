"""The detectors of features by name; OpenCV is not loaded here, so that planning may read the names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

__all__ = ["DETECTORS", "Detector"]


class Detector(NamedTuple):
    """How a detector is made and how it finds features without an orientation.

    make : gives cv2's detector with its usual threshold from cv2, ``upright`` and the number of octaves
    upright : "built in" where the detector has such a mode, "afterwards" where the orientation found is set to 0 before
        the description, "never" where features always have an orientation
    """

    make: Callable[[Any, bool, int], Any]
    upright: Literal["built in", "afterwards", "never"]


def _akaze(cv2: Any, upright: bool, octaves: int) -> Any:
    kind = cv2.AKAZE_DESCRIPTOR_MLDB_UPRIGHT if upright else cv2.AKAZE_DESCRIPTOR_MLDB
    return cv2.AKAZE_create(descriptor_type=kind, nOctaves=octaves)


DETECTORS = {
    "KAZE": Detector(lambda cv2, upright, octaves: cv2.KAZE_create(upright=upright, nOctaves=octaves), "built in"),
    "AKAZE": Detector(_akaze, "built in"),
    "BRISK": Detector(lambda cv2, upright, octaves: cv2.BRISK_create(octaves=octaves), "never"),
    "ORB": Detector(lambda cv2, upright, octaves: cv2.ORB_create(nfeatures=100_000), "afterwards"),
    # without the precise upscale, all positions of SIFT are off by a quarter pixel
    "SIFT": Detector(lambda cv2, upright, octaves: cv2.SIFT_create(enable_precise_upscale=True), "afterwards"),
}
"""Each detector comes with its own descriptor."""
