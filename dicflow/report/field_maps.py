"""The small pictures of one step: the photograph, and each quantity as it lies over it."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.kinds.images import Images
from dicflow.kinds.maps import colour_range, joined_range
from dicflow.kinds.total import Total
from dicflow.pipeline import Result
from dicflow.pipeline.places import Places
from dicflow.views.colours import Look

if TYPE_CHECKING:
    import numpy as np

    from dicflow.views.overlay import View

__all__ = ["Frame", "Scene", "as_text", "drawn_step", "overview", "worst_corner"]


class Scene(NamedTuple):
    """What the maps are made of.

    total : the stage whose fields are drawn
    places : where its points lie
    has_grid : whether points are the same at every step; else each step has a grid of its own
    """

    total: str
    places: Places
    has_grid: bool


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
    from dicflow.views.overlay import point_box

    boxes = [point_box(scene.places.at_first_step())] if scene.has_grid else []
    ranges: dict[str, list[tuple[float, float] | None]] = {name: [] for name in names}
    for step in steps:
        total = Total.read(result.product(scene.total, step))
        boxes.append(point_box(scene.places.at_step(total)))
        for name, seen in ranges.items():
            seen.append(colour_range(total[name]))
    height, width = result.shape(scene.places.photographs, "left", steps[0])
    content = {
        "boxes": [box for box in boxes if box is not None],
        "image_size": [width, height],
        "ranges": {name: joined_range(seen) for name, seen in ranges.items()},
    }
    return json.dumps(content).encode()


def drawn_step(result: Result, scene: Scene, step: str, frame: Frame, bare: bool = False) -> bytes:
    """The pictures of one step as JSON. bare : without the photograph"""
    import numpy as np

    from dicflow.core.status import Status
    from dicflow.views.overlay import cell_index, photo_jpeg, reason_png

    total = Total.read(result.product(scene.total, step))
    here = scene.places.at_step(total)
    index = cell_index(here, frame.view)
    photo = b"" if bare else photo_jpeg(Images.read(result.product(scene.places.photographs, step)).left, frame.view)
    content: dict[str, Any] = {
        "photo": as_text(photo),
        "deformed": _overlays(total, index, frame.looks),
    }
    status = total["status"]
    if not scene.has_grid:
        inside = status != Status.OUTSIDE
        content |= {"reasons": as_text(reason_png(status))}
    else:
        grid = scene.places.at_first_step()
        inside = np.isfinite(grid).all(axis=-1)
        index = cell_index(grid, frame.smaller)
        content["reference"] = _overlays(total, index, frame.looks)
        content["reasons"] = as_text(reason_png(worst_corner(status)[index]))
        content["directions"] = _directions(total, grid, here, frame.view)
    return json.dumps(content | {"counts": _counts(status[inside])}).encode()


def _overlays(total: Total, index: Any, looks: Sequence[Look]) -> dict[str, str]:
    from dicflow.views.overlay import field_png

    return {look.quantity: as_text(field_png(total[look.quantity], index, look)) for look in looks}


def worst_corner(status: np.ndarray) -> np.ndarray:
    """The gravest code among the corners of each cell, by the cell's number; measured where there is no cell."""
    import numpy as np

    corners = [status[:-1, :-1], status[1:, :-1], status[:-1, 1:], status[1:, 1:]]
    return np.append(np.maximum.reduce(corners).ravel(), np.uint8(0))


def _directions(total: Total, grid: np.ndarray, here: np.ndarray, view: View) -> dict[str, str]:
    """Lines along the principal direction of the larger strain, over the first step and over this one."""
    import numpy as np

    from dicflow.views.overlay import carried_angle, direction_path

    if "angle" in total:
        angle = total["angle"]
    else:
        angle = np.degrees(0.5 * np.arctan2(total["gxy"], total["exx"] - total["eyy"]))
    if total.directions == "global":  # the angle is that at this step
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
