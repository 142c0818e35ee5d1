"""The part of the photograph that is measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from dicflow.engine.node import At, InputFile, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.engine.share import free_threads
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.region import Region as RegionProduct
from dicflow.kinds.rig import CalibratedRig
from dicflow.stages._selected import Selected

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    import numpy as np

    from dicflow.core.cameras.camera import Rig
    from dicflow.core.photographs.polygon import Polygon
    from dicflow.core.photographs.texture import Texture

__all__ = ["Region"]

SLACK_PX = 1.0  # a region may touch the outermost pixels' outer edges
OUTLINE_PX = 20.0  # a longer edge would deviate from its image, which lens distortion curves
_MAX_CUT_PLACES = 1000
SOURCES = ("rectangle", "polygons", "file")

Ring = Annotated[list[tuple[float, float]], Field(min_length=3)]


Coordinate = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Line = Annotated[list[tuple[Coordinate, Coordinate]], Field(min_length=2)]


class Outline(BaseModel):
    """One part of a region: its outline and the outlines of its holes, corners [x, y] in px."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    exterior: Ring
    holes: list[Ring] = []


def _outline(value: Any) -> Any:
    """A bare list of corners is an outline without holes."""
    return {"exterior": value} if isinstance(value, list | tuple) else value


def _ordered(value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    x0, y0, x1, y1 = value
    if not (x0 < x1 and y0 < y1):
        raise ValueError("a rectangle is [x0, y0, x1, y1] with x0 < x1 and y0 < y1")
    return value


class Region(Node):
    """Choose the region of interest on the first photograph: a rectangle, polygons with holes, a file, or auto.

    If none of the three is given, the region is the largest speckled part of the image, without its openings and
    without what stands still behind a specimen that moves, such as a speckled wall. That shows in a later photograph:
    of those that follow the first one by 1, 2, 4, 8 and 16 steps, the first in which something has moved by 2 px or
    more; photographs above 2 Mpx, or with coarse speckles, are reduced before, and their pixels are larger. So the
    region of a test under way stays as it is, once something has moved. Where nothing moves, everything stays. A still
    part that the motion of the specimen comes down to smoothly, such as its end at a grip, is part of it. A part that
    stands still because the specimen is torn apart cannot be distinguished from a wall; give the region then.

    Pixels that do not count, such as transparent ones, are in no region. The tracked transforms carry the region to the
    later steps.
    """

    title: ClassVar = "region of interest"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {
        "images": Port("rectified", "plane", "images", at=At.FIRST),
        "images_early": Port("rectified", "plane", "images", at=At.EARLY, optional=True),
        "rig": Port("rig", optional=True),
    }
    gives: ClassVar = "region"
    impl_version: ClassVar = 2
    is_quick: ClassVar = True

    stage: Literal["region"] = "region"
    rectangle: Annotated[tuple[float, float, float, float], AfterValidator(_ordered)] | None = parameter(
        None, "[x0, y0, x1, y1]", unit="px"
    )
    polygons: list[Annotated[Outline, BeforeValidator(_outline)]] | None = parameter(
        None, "outlines: each a list of corners [x, y], or {exterior: corners, holes: [corners, …]}", unit="px"
    )
    file: InputFile | None = parameter(
        None, "GeoJSON polygons in px, with lines to cut along, or an image that is white inside the region"
    )
    cut: list[Line] = parameter(
        [], "lines across which nothing is compared, such as cracks: each a list of places [x, y]", unit="px"
    )
    auto: bool = parameter(False, "find the speckled specimen; the default if nothing else is given")
    frame: Literal["photograph", "tracked"] = parameter(
        "photograph", "what the coordinates and the mask refer to: the left photograph, or the rectified image"
    )
    window: int = parameter(
        32, "auto: side of the window that sees speckles; several should fit in it", unit="px", ge=8
    )

    @model_validator(mode="before")
    @classmethod
    def _auto_alone(cls, values: Any) -> Any:
        """Set auto if no source is given, so that both have one key."""
        if isinstance(values, dict) and all(values.get(source) is None for source in SOURCES):
            return {**values, "auto": values.get("auto", True)}
        return values

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        given = [source for source in SOURCES if getattr(self, source) is not None] + ["auto"] * self.auto
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(SOURCES)} and auto, found {', '.join(given) or 'none'}")
        return self

    def check(self, path: Path) -> dict[str, Any]:
        from dicflow.io.region import is_geojson, read_geojson, read_mask

        if is_geojson(path):
            read_geojson(path)
        else:
            read_mask(path)
        return {}

    def joins(self, port: str) -> bool:
        return port != "images_early" or self.auto

    def run(
        self,
        images: Product,
        images_early: Sequence[Product] | None = None,
        rig: Product | None = None,
        file_path: Path | None = None,
    ) -> Product:
        from dicflow.core.photographs.region import carry, cut_apart

        photographs = Images.read(images)
        cameras = None if rig is None else CalibratedRig.read(rig).cameras
        polygons: Sequence[Polygon]
        drawn: Sequence[np.ndarray] = ()
        if self.auto:
            polygons = self._specimen(photographs, map(Images.read, images_early or ()))
        else:
            chosen = self._chosen(photographs, cameras, file_path)
            _check_inside(chosen)
            polygons, drawn = chosen.polygons, chosen.cuts
            if self.frame == "photograph" and not photographs.as_taken:
                polygons = carry(polygons, _to_tracked(photographs, cameras), spacing_px=OUTLINE_PX)
        polygons = _counting(polygons, photographs)
        _check_texture(photographs.left, polygons)
        cuts = self._cuts(photographs, cameras, drawn)
        try:
            return RegionProduct.write([cut_apart(polygon, cuts) for polygon in polygons], cuts)
        except ValueError as error:
            raise StageError(str(error)) from error

    def _cuts(self, images: Images, cameras: Rig | None, drawn: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        """The lines across which nothing is compared [px of the image that is followed]. drawn : those of the file"""
        import numpy as np

        from dicflow.core.photographs.region import densify_line, simplified

        lines = [*(np.array(line) for line in self.cut), *drawn]
        places = sum(len(line) for line in lines)
        if places > _MAX_CUT_PLACES:
            raise StageError(f"the cuts have {places:,} places, at most {_MAX_CUT_PLACES:,}; simplify the lines")
        lines = [simplified(line) for line in lines]
        if min(map(len, lines), default=2) < 2:
            raise StageError("a cut has one place only; give a line of two different places or more")
        if not lines or self.frame == "tracked" or images.as_taken:
            return lines
        mapping = _to_tracked(images, cameras)
        return [mapping(densify_line(line, OUTLINE_PX)) for line in lines]

    def _specimen(self, photographs: Images, early: Iterable[Images]) -> Sequence[Polygon]:
        """Outlines of the speckled specimen [px]. Raises StageError if the photograph shows no speckles."""
        from dicflow.core.photographs.region import speckled_region
        from dicflow.core.photographs.texture import texture

        image = photographs.left
        if self.window > min(image.shape) / 2:
            raise StageError(
                f"a window of {self.window} px is too large for a photograph of "
                f"{image.shape[1]} × {image.shape[0]} px; use {min(image.shape) // 2} px at most"
            )
        found = texture(image, self.window)
        polygons = speckled_region(found, _background(photographs, early, found))
        if not polygons:
            raise StageError(
                f"found no speckled specimen in the first photograph; {_texture_sentence(image)}, "
                "or give the region as rectangle, polygons or file"
            )
        return polygons

    def _chosen(self, images: Images, cameras: Rig | None, file_path: Path | None) -> Selected:
        """The region that the user gave."""
        size, name = images.size, "the image"
        if self.frame == "photograph" and not images.as_taken:
            size, name = _require_rig(cameras).left.size, "the left photograph"
        return self.given(size, name, file_path)

    def given(self, size: tuple[int, int], name: str, file_path: Path | None) -> Selected:
        """The region that the user gave, in an image of a size with a name, not with ``auto``."""
        import numpy as np

        from dicflow.core.photographs.polygon import Polygon
        from dicflow.core.photographs.region import rectangle

        if self.rectangle is not None:
            return Selected([rectangle(*self.rectangle)], size, name)
        if self.polygons is not None:
            outlines = [Polygon(np.array(o.exterior), tuple(np.array(hole) for hole in o.holes)) for o in self.polygons]
            return Selected(outlines, size, name)
        assert file_path is not None
        return _from_file(file_path, size, name)


def _background(photographs: Images, early: Iterable[Images], texture: Texture) -> np.ndarray:
    """Points (rows, cols) of the texture's grid that do not count, or stand still while something else moves."""
    from dicflow.core.matching.background import still_background
    from dicflow.core.photographs.texture import speckled_points

    hidden = _hidden(photographs, texture)
    seen = speckled_points(texture) & ~hidden
    still = still_background(photographs.left, [later.left for later in early], seen, free_threads())
    return hidden if still is None else hidden | still


def _hidden(photographs: Images, texture: Texture) -> np.ndarray:
    """Points (rows, cols) of the texture's grid that do not count."""
    import numpy as np

    counts, stride = photographs.counts("left"), texture.stride_px
    return np.zeros(texture.strength.shape, dtype=bool) if counts is None else ~counts[::stride, ::stride]


def _counting(polygons: Sequence[Polygon], photographs: Images) -> Sequence[Polygon]:
    """The part of a region whose pixels count."""
    from dicflow.core.photographs.region import mask_polygons, rasterise

    counts = photographs.counts("left")
    if counts is None:
        return polygons
    inside = rasterise(polygons, counts.shape)
    return polygons if counts[inside].all() else mask_polygons(inside & counts)


def _from_file(path: Path, size: tuple[int, int], name: str) -> Selected:
    from dicflow.core.photographs.region import mask_polygons
    from dicflow.io.region import is_geojson, read_geojson, read_mask

    if is_geojson(path):
        drawing = read_geojson(path)
        return Selected(drawing.polygons, size, name, drawing.cuts)
    mask = read_mask(path)
    if mask.shape[::-1] != tuple(size):
        raise StageError(
            f"{path.name}: the mask has {mask.shape[1]} × {mask.shape[0]} px but {name} has {size[0]} × {size[1]}; "
            "paint the mask on that photograph"
        )
    polygons = mask_polygons(mask)
    if not polygons:
        raise StageError(f"{path.name}: the mask has no white area of useful size; paint the region white")
    return Selected(polygons, size, name)


def _require_rig(cameras: Rig | None) -> Rig:
    """The rig. Raises StageError if it is missing."""
    if cameras is None:
        raise StageError(
            "a region given in the photograph needs the rig to carry it into the rectified image; name the stage that "
            "calibrates as 'rig', or set frame: tracked"
        )
    return cameras


def _to_tracked(images: Images, cameras: Rig | None) -> Callable[[np.ndarray], np.ndarray]:
    """The mapping from pixels of the left photograph to those of the image that is tracked."""
    from dicflow.core.cameras.camera import undistort
    from dicflow.core.cameras.rectification import raw_to_rectified, rectification

    rig = _require_rig(cameras)
    camera = rig.left
    if images.product.kind == "plane":
        return lambda points: undistort(camera, points) @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    view = rectification(rig)
    return lambda points: raw_to_rectified(points, camera, view.rotation_left, view.matrix_left)


def _check_inside(chosen: Selected) -> None:
    """Raise StageError if the region reaches outside the image."""
    from dicflow.core.photographs.region import bounding_box

    x0, y0, x1, y1 = bounding_box(chosen.polygons)
    width, height = chosen.size
    if min(x0, y0) < -SLACK_PX or x1 > width - 1 + SLACK_PX or y1 > height - 1 + SLACK_PX:
        raise StageError(
            f"the region spans x {x0:g} … {x1:g} and y {y0:g} … {y1:g} px, but {chosen.name} has x 0 … {width - 1} and "
            f"y 0 … {height - 1}; choose the region inside it"
        )


def _check_texture(image: np.ndarray, polygons: Sequence[Polygon]) -> None:
    """Raise StageError if the region shows too little texture."""
    from dicflow.core.photographs.region import rasterise
    from dicflow.core.photographs.texture import MIN_TEXTURE, mean_intensity_gradient

    mask = rasterise(polygons, image.shape)
    if not mask.any():
        raise StageError("the region covers no pixel of the image; choose a larger one")
    if mean_intensity_gradient(image, mask) < MIN_TEXTURE:
        raise StageError(f"the region shows too little texture; {_texture_sentence(image, mask)}, or move the region")


def _texture_sentence(image: np.ndarray, mask: np.ndarray | None = None) -> str:
    from dicflow.core.photographs.texture import MIN_TEXTURE, mean_intensity_gradient

    return (
        f"the mean intensity gradient is {mean_intensity_gradient(image, mask):.2f} grey levels per px and a pattern "
        f"needs {MIN_TEXTURE} or more: check light, exposure and focus"
    )
