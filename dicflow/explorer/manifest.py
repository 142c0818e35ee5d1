"""What the page reads first: plain JSON that says what is shown and which blob holds which numbers.

Names of blobs are those of :func:`dicflow.explorer.packing.blob_name`. Numbers are codes: a scale ``[low, quantum]``
gives the value low + (code − 1) quantum, that of an error, ``[low, ratio]``, low · ratio^(code − 1). Code 0
is an unknown value.
"""

from __future__ import annotations

from typing import TypedDict

from dicflow.explorer.curves import Curve, Loads, ProbePlace
from dicflow.explorer.fields import FieldFacts, QuantityFacts

__all__ = ["CameraFacts", "Crop", "FirstFacts", "Manifest", "QuantityEntry", "Reason", "StepEntry"]

Scale = tuple[float, float]


class QuantityEntry(QuantityFacts):
    """A quantity, its scales, colours and means.

    scale : low and quantum of its values
    errors : low and ratio of "u", its combined standard uncertainty, of "sigma", its standard deviation by noise, of
        "bias", that of the bias that remains, and of "share", the calibration's share; those that are known
    range, colours : values between which the colours run, and the name of their map
    means : of each step, mean over the points and their standard deviation about it; None if unknown
    """

    scale: Scale
    errors: dict[str, Scale]
    range: tuple[float, float]
    colours: str
    means: list[tuple[float, float] | None]


class StepEntry(TypedDict):
    """A step. A step that was not measured has no blobs.

    name : of the step; number : in the test, 0 for the first photograph
    shape : rows and columns of the grid
    blobs : "status", "value/NAME", "place/left", "place/right", "place/space", and of errors "u/NAME", "sigma/NAME",
        "bias/NAME", "share/NAME" → blob
    photos : "left", "right" → blob with a JPEG
    counts : status code → number of points
    valid : share of the points that have a value
    """

    name: str
    number: int
    shape: tuple[int, int]
    blobs: dict[str, str]
    photos: dict[str, str]
    counts: dict[str, int]
    valid: float | None


class FirstFacts(TypedDict):
    """The first step, over which fields may be drawn too; ``place`` is the blob of the points there."""

    name: str
    place: str
    shape: tuple[int, int]
    photos: dict[str, str]


class Reason(TypedDict):
    """Why a point has no measured value: its status as a word, a sentence, and its colour."""

    code: int
    label: str
    sentence: str
    colour: str


class Crop(TypedDict):
    """The part of a photograph that is shown: its upper left corner and size [px]."""

    origin: tuple[float, float]
    size: tuple[float, float]


class CameraFacts(TypedDict):
    """A camera in the frame of the places: its centre, and the directions to the corners of its photograph."""

    name: str
    centre: list[float]
    corners: list[list[float]]


class Manifest(FieldFacts):
    """All that a page shows, but for the numbers.

    title : of the pipeline
    main : name of the quantity, and place of the step in ``steps``, that are shown first
    places : place → scale of each component
    crops : "left", "right" → part of the photographs
    cameras : empty if the rig is unknown
    palettes : name of a colour map → 256 colours, six hexadecimal digits each
    curves : :class:`dicflow.explorer.curves.Curve` of the pipeline's probes
    probes : :class:`dicflow.explorer.curves.ProbePlace` of the pipeline's probes that are given in pixels
    load : :class:`dicflow.explorer.curves.Loads`; None if unknown
    rig : whether the rig is still calibrated, as a sentence; empty where the points do not tell it
    left_out : sentences on what had to be left out
    meaning : sentences on what ± means; none without uncertainties
    """

    title: str
    main: tuple[str, int]
    steps: list[StepEntry]
    first: FirstFacts | None
    quantities: list[QuantityEntry]
    reasons: list[Reason]
    places: dict[str, list[Scale]]
    crops: dict[str, Crop]
    cameras: list[CameraFacts]
    palettes: dict[str, str]
    curves: list[Curve]
    probes: list[ProbePlace]
    load: Loads | None
    rig: str
    left_out: list[str]
    meaning: list[str]
