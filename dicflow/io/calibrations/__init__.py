"""Calibrations that other programs have made, one module per format.

A format is recognised by what the file holds, not by its name. What a file says of a rig is a
:class:`~dicflow.io.calibrations.draft.Draft`; checked and with the size of the photographs it becomes a
:class:`~dicflow.io.calibrations.draft.Calibration`.
"""

from dicflow.io.calibrations.draft import Calibration, Draft, DraftCamera
from dicflow.io.calibrations.opencv import opencv_text, write_opencv
from dicflow.io.calibrations.read import parse_calibration, read_calibration

__all__ = [
    "Calibration",
    "Draft",
    "DraftCamera",
    "opencv_text",
    "parse_calibration",
    "read_calibration",
    "write_opencv",
]
