"""The small pictures of one step: the photograph, and each quantity as it lies over it."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.engine.product import Product
from dicflow.pipeline import Result
from dicflow.views.colours import Look

if TYPE_CHECKING:
    import numpy as np

    from dicflow.views.overlay import View

__all__ = ["Frame", "Scene", "as_text", "drawn_step", "overview", "places", "worst_corner"]

_LEFT_OUT_PERCENT = 0.5


class Scene(NamedTuple):
    """Which stages the maps are made of.

    grid : gives the places of the points at the first step; None where each step has a grid of its own
    photographs : gives the images that the maps lie over
    rig : carries places in rectified images back into the photographs; None where they are tracked there
    """

    total: str
    grid: str | None
    photographs: str
    rig: str | None


class Frame(NamedTuple):
    """What all maps of a test share: the part of the photograph shown, and the look of each quantity."""

    view: View
    looks: tuple[Look, ...]

    @property
    def smaller(self) -> View:
        """The same part at half the size, in which the maps at the first step are drawn."""
        width, height = self.view.size
        size = (max(1, round(width / 2)), max(1, round(height / 2)))
        return self.view._replace(size=size, scale=self.view.scale / 2)


def overview(result: Result, scene: Scene, steps: Sequence[str], names: Sequence[str]) -> bytes:
    """Where the points are over all steps, and between which values each quantity lies."""
    import numpy as np

    from dicflow.views.overlay import point_box

    boxes = [point_box(places(result, scene, 0))] if scene.grid is not None else []
    ranges: dict[str, list[float]] = {}
    for step in steps:
        total = result.product(scene.total, step)
        boxes.append(point_box(places(result, scene, step)))
        for name in names:
            known = total[name][np.isfinite(total[name])]
            if known.size:
                low, high = np.percentile(known, [_LEFT_OUT_PERCENT, 100 - _LEFT_OUT_PERCENT]).tolist()
                before = ranges.get(name, [low, high])
                ranges[name] = [min(low, before[0]), max(high, before[1])]
    height, width = result.shape(scene.photographs, "left", steps[0])
    content = {
        "boxes": [box for box in boxes if box is not None],
        "image_size": [width, height],
        "ranges": {name: _two(*ranges.get(name, [-1.0, 1.0])) for name in names},
    }
    return json.dumps(content).encode()


def _two(low: float, high: float) -> list[float]:
    """A range of two different numbers."""
    return [low, high] if high - low > 1e-12 else [low - 0.5e-6, high + 0.5e-6]


def places(result: Result, scene: Scene, step: str | int) -> np.ndarray:
    """Places of the points in the photograph (row, col, 2) [px]; of step 0, those of the whole grid."""
    import numpy as np

    if step == 0:
        grid = result.product(str(scene.grid), 0)
        tracked = grid["xy"] if "xy" in grid else grid["points"]
    else:
        tracked = result.product(scene.total, step)["xy"]
    if scene.rig is None:
        return np.asarray(tracked)
    from dicflow.core.cameras.rectification import rectification, rectified_to_raw
    from dicflow.kinds.rig import rig_from_json

    rig = rig_from_json(result.product(scene.rig).attrs["rig"])
    rectified = rectification(rig)
    return rectified_to_raw(tracked, rig.left, rectified.rotation_left, rectified.matrix_left)


def drawn_step(result: Result, scene: Scene, step: str, frame: Frame, bare: bool = False) -> bytes:
    """The pictures of one step as JSON. bare : without the photograph"""
    import numpy as np

    from dicflow.core.status import Status
    from dicflow.views.overlay import cell_index, photo_jpeg, reason_png

    total = result.product(scene.total, step)
    here = places(result, scene, step)
    index = cell_index(here, frame.view)
    photo = b"" if bare else photo_jpeg(result.product(scene.photographs, step)["left"], frame.view)
    content: dict[str, Any] = {
        "photo": as_text(photo),
        "deformed": _overlays(total, index, frame.looks),
    }
    status = total["status"]
    if scene.grid is None:
        inside = status != Status.OUTSIDE
        content |= {"reasons": as_text(reason_png(status))}
    else:
        grid = places(result, scene, 0)
        inside = np.isfinite(grid).all(axis=-1)
        index = cell_index(grid, frame.smaller)
        content["reference"] = _overlays(total, index, frame.looks)
        content["reasons"] = as_text(reason_png(worst_corner(status)[index]))
        content["directions"] = _directions(total, grid, here, frame.view)
    return json.dumps(content | {"counts": _counts(status[inside])}).encode()


def _overlays(total: Product, index: Any, looks: Sequence[Look]) -> dict[str, str]:
    from dicflow.views.overlay import field_png

    return {look.quantity: as_text(field_png(total[look.quantity], index, look)) for look in looks}


def worst_corner(status: np.ndarray) -> np.ndarray:
    """The gravest code among the corners of each cell, by the cell's number; measured where there is no cell."""
    import numpy as np

    corners = [status[:-1, :-1], status[1:, :-1], status[:-1, 1:], status[1:, 1:]]
    return np.append(np.maximum.reduce(corners).ravel(), np.uint8(0))


def _directions(total: Product, grid: np.ndarray, here: np.ndarray, view: View) -> dict[str, str]:
    """Lines along the principal direction of the larger strain, over the first step and over this one."""
    import numpy as np

    from dicflow.views.overlay import carried_angle, direction_path

    if "angle" in total:
        angle = total["angle"]
    else:
        angle = np.degrees(0.5 * np.arctan2(total["gxy"], total["exx"] - total["eyy"]))
    if total.attrs.get("directions") == "global":  # the angle is that at this step
        first, now = carried_angle(here, grid, angle), angle
    else:
        first, now = angle, carried_angle(grid, here, angle)
    return {"reference": direction_path(grid, first, view), "deformed": direction_path(here, now, view)}


def _counts(status: np.ndarray) -> dict[str, int]:
    """How many points have each status, by its name."""
    import numpy as np

    from dicflow.core.status import Status

    codes, numbers = np.unique(status, return_counts=True)
    return {Status(code).label: number for code, number in zip(codes.tolist(), numbers.tolist(), strict=True)}


def as_text(picture: bytes) -> str:
    return b64encode(picture).decode()
