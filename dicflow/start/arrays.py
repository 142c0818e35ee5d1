"""A measurement of photographs that are arrays in memory."""

from __future__ import annotations

import json
import shutil
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import ArrayLike

from dicflow.errors import ConfigurationError, StageError
from dicflow.io.rig import write_rig
from dicflow.pipeline import Pipeline, Result

if TYPE_CHECKING:
    from dicflow.core.cameras.camera import Rig

__all__ = ["measure"]

_GREY = (np.uint8, np.uint16)
_ONE_CAMERA = """\
dicflow: 1
stages:
  photos: {{stage: images, left: "left/*.png"}}
  region: {{stage: region, images: photos{region}}}
  features: {{stage: features, images: photos, detector: AKAZE}}
  matches: {{stage: match, images: photos, guided: false, refine: false}}
  correlation: {{stage: correlate, images: photos}}
  total: {{stage: deformation, points: correlation}}
"""
_TWO_CAMERAS = """\
dicflow: 1
stages:
  photos: {{stage: images, left: "left/*.png", right: "right/*.png"}}
  rig: {{stage: rig_file, images: photos, file: {rig}}}
  region: {{stage: region, images: photos{region}}}
  features: {{stage: features, images: photos, detector: AKAZE}}
  matches: {{stage: match, images: photos, guided: false, refine: false}}
  correlation: {{stage: correlate, images: photos}}
  stereo: {{stage: stereo, images: photos}}
  points: {{stage: triangulate}}
  total: {{stage: deformation, points: points}}
"""


def measure(
    left: Sequence[ArrayLike],
    right: Sequence[ArrayLike] | None = None,
    rig: Rig | str | Path | None = None,
    region: Sequence[Sequence[ArrayLike]] | None = None,
    *,
    settings: Sequence[str] = (),
    folder: str | Path | None = None,
) -> Result:
    """Measure displacement and strain from photographs in memory.

    left : photographs of the left camera, (row, col) uint8 or uint16, the reference first
    right : those of the right camera at the same moments; None for one camera, whose results are in px
    rig : both cameras, or a file of a calibration; with ``right`` only
    region : outlines, each a list of corners (x, y) in px of the first left photograph; None finds the speckled part
    settings : as after ``--set``: ``["correlation.subset_size=21", "total.window=40 px"]``
    folder : for photographs, pipeline file and store, which may be run again; None for one that is deleted as soon as
        nobody uses the result
    Returns the result with the stages photos, region, correlation, total, and with two cameras rig, stereo, points.
    Raises ConfigurationError for photographs that are not grey levels or no series, for a missing rig, and as
    :meth:`dicflow.Pipeline.load`; StageError if a stage fails.
    """
    if (right is None) != (rig is None):
        raise ConfigurationError("measure: photographs of a right camera and a rig belong together; give both or none")
    if len(left) < 2 or (right is not None and len(right) != len(left)):
        counts = f"{len(left)} left" + ("" if right is None else f" and {len(right)} right")
        raise ConfigurationError(f"measure: got {counts} photographs; give two or more, and as many of each camera")
    place = Path(tempfile.mkdtemp(prefix="dicflow-")) if folder is None else Path(folder)
    try:
        pipeline = _written(place, {"left": left, "right": right or ()}, rig, region, settings)
        if folder is None:
            weakref.finalize(pipeline.store, shutil.rmtree, place, ignore_errors=True)
        return _measured(pipeline)
    except BaseException:
        if folder is None:
            shutil.rmtree(place, ignore_errors=True)
        raise


def _measured(pipeline: Pipeline) -> Result:
    """The result of a run. Raises StageError with the message of the first task that failed."""
    result = pipeline.run(scheduler="threads")
    assert result.outcome is not None
    if result.outcome.errors:
        raise StageError(result.outcome.errors[0])
    return result


def _written(
    folder: Path,
    series: dict[str, Sequence[ArrayLike]],
    rig: Rig | str | Path | None,
    region: Sequence[Sequence[ArrayLike]] | None,
    settings: Sequence[str],
) -> Pipeline:
    """The pipeline over photographs that are written to a folder."""
    for side, photographs in series.items():
        for step, photograph in enumerate(photographs):
            _write(folder / side / f"step_{step:04d}.png", np.asarray(photograph))
    outlines = "" if region is None else f", polygons: {json.dumps([np.asarray(one).tolist() for one in region])}"
    template = _ONE_CAMERA if rig is None else _TWO_CAMERAS
    file = folder / "pipeline.yaml"
    file.write_text(template.format(region=outlines, rig=_rig_name(folder, rig)), encoding="utf-8")
    return Pipeline.load(file, settings=settings)


def _rig_name(folder: Path, rig: Rig | str | Path | None) -> str:
    """Name of the file with the rig in the folder, as YAML."""
    if rig is None:
        return ""
    if isinstance(rig, str | Path):
        name = f"rig{Path(rig).suffix}"
        shutil.copyfile(rig, folder / name)
        return json.dumps(name)
    write_rig(folder / "rig.json", rig)
    return "rig.json"


def _write(path: Path, photograph: np.ndarray) -> None:
    """Write grey levels as PNG."""
    if photograph.ndim != 2 or photograph.dtype not in _GREY:
        raise ConfigurationError(
            f"measure: {path.parent.name} photograph {path.stem[-4:]} has shape {photograph.shape} and type "
            f"{photograph.dtype}; give grey levels (row, col) as uint8 or uint16"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    _, encoded = cv2.imencode(".png", photograph)
    path.write_bytes(encoded.tobytes())
