"""Grey levels of photographs: PNG, TIFF, JPEG and BMP with 8 or 16 bits, colour or grey, with or without opacity.

Frames of videos are read in the same way.

The check of a photograph and the stage that uses it call :func:`read_photograph`. Its first bytes say which format a
file has; a file of another format is handed to no library.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from dicflow.engine.files import FilePart, Stamp, stamp
from dicflow.engine.hashing import digest_array, digest_json
from dicflow.engine.whole_file import read_file
from dicflow.errors import InputError
from dicflow.io.images.extras import read_heic, read_raw
from dicflow.io.images.formats import Format, format_of, is_video
from dicflow.io.images.libraries import library, opencv, opened, pillow
from dicflow.io.images.metadata import jpeg_segments
from dicflow.io.images.orientation import exif_orientation
from dicflow.io.images.png import animation, without_metadata
from dicflow.io.images.quiet import quiet
from dicflow.io.images.tiff import Page, Tiff
from dicflow.io.images.video import video_of
from dicflow.io.images.video_stream import read_frame

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

__all__ = ["Photograph", "page_count", "probe", "read_grey", "read_photograph"]

_MOST_BITS, _BITS_OF_PILLOW = 16, 8
_JPEG_END, _JPEG_SCAN = b"\xff\xd9", b"\xff\xda"
"""Markers of JPEG (ITU-T T.81, table B.1): end of image, start of scan."""
_MOST_PIXELS_PER_BYTE = 8 * 1032
"""Of a PNG: eight pixels of one bit in a byte, packed as well as deflate can (RFC 1951)."""
_MOST_ANIMATED_PIXELS = 1_000_000_000
_MOST_SCANS = 100
"""Passes over the whole picture in one file; programs write 10 at most."""
_REMEMBERED = 20_000
"""Files whose pages are counted once."""


class Photograph(NamedTuple):
    """A decoded photograph, as the sensor lies.

    grey : (row, col) uint8 or uint16; colour is weighted to luma (ITU-R BT.601). Transparent pixels have the mean grey
        level of the others
    orientation : of EXIF or TIFF, 1 … 8; 1 if the file does not give it. It is not applied
    counts : (row, col) bool — False for pixels without any opacity; None if there are none
    """

    grey: np.ndarray
    orientation: int
    counts: np.ndarray | None = None


def read_photograph(file: Path | FilePart) -> Photograph:
    """Decode a photograph, or a page of a file.

    Raises InputError that names the file if it is missing, has another format, is truncated or damaged, is transparent
    everywhere, or does not hold integers of 8 or 16 bits.
    """
    path, number = (file.path, file.number) if isinstance(file, FilePart) else (file, 1)
    with _naming(file):
        with _open(path) as start:
            form = format_of(start)
        samples = _READERS[form](path, number)
        if samples.opacity is None or samples.opacity.all():
            return Photograph(samples.grey, samples.orientation)
        counts = samples.opacity > 0
        if not counts.any():
            raise InputError("transparent everywhere; save it without opacity (alpha)")
        hidden = samples.grey[counts].mean().round().astype(samples.grey.dtype)
        return Photograph(np.where(counts, samples.grey, hidden), samples.orientation, counts)


def page_count(path: Path) -> int:
    """The number of photographs in a file: pages of a TIFF, frames of a video or an animated PNG, else 1.

    1 also for a file that cannot be used, which :func:`read_photograph` refuses. Counted once while it is unchanged.
    """
    try:
        return _counted(path, stamp(path))
    except InputError:
        return 1


@lru_cache(maxsize=_REMEMBERED)
def _counted(path: Path, _unchanged: Stamp) -> int:
    try:
        with _open(path) as file:
            form = format_of(file)
            if form == "TIFF":
                tiff = Tiff(file)
                return 1 if tiff.is_raw() else len(tiff.photographs())
            if form == "video":
                return len(video_of(path).times)
            return animation(file).frames if form == "PNG" else 1
    except (InputError, OSError, ValueError):
        return 1


def probe(file: Path | FilePart) -> dict[str, Any]:
    """Width and height [px], bits per grey level, orientation and mosaic of a photograph as the sensor lies.

    ``mosaic`` is the pattern of colour filters that the grey levels show, None for a usual photograph; a page of a file
    has the ``digest`` of its contents too, but no frame of a video, which would have to be decoded for it. Raises
    InputError as :func:`read_photograph` does.
    """
    from dicflow.core.photographs.mosaic import colour_filters

    path = file.path if isinstance(file, FilePart) else file
    if is_video(path):
        video = video_of(path)
        size = {"width": video.width, "height": video.height, "bits": 8}
        return {**size, "orientation": video.orientation, "mosaic": None}
    grey, orientation, counts = read_photograph(file)
    height, width = grey.shape
    facts = {
        "width": width,
        "height": height,
        "bits": 8 * grey.itemsize,
        "orientation": orientation,
        "mosaic": colour_filters(grey),
    }
    if isinstance(file, FilePart):
        contents = [digest_array(array) for array in (grey, counts) if array is not None]
        facts["digest"] = digest_json([orientation, *contents])
    return facts


def read_grey(file: Path | FilePart) -> np.ndarray:
    """Grey levels of a photograph, (row, col) uint8 or uint16. Raises InputError as :func:`read_photograph` does."""
    return read_photograph(file).grey


def _open(path: Path) -> BinaryIO:
    """An open file. Raises InputError for what is not a regular one: reading a pipe would wait for ever."""
    if path.exists() and not path.is_file():
        raise InputError("not a regular file; name a photograph")
    return path.open("rb")


class _Samples(NamedTuple):
    """What a file holds: grey levels, orientation, and the opacity of each pixel, None without an alpha channel."""

    grey: np.ndarray
    orientation: int
    opacity: np.ndarray | None = None


def _tiff(path: Path, number: int) -> _Samples:
    if _is_raw(path, stamp(path)):
        return _raw(path, number)
    pages = _pages(path, stamp(path))
    with path.open("rb") as file:
        tiff = Tiff(file)
        page = pages[number - 1]
        bits, other = tiff.bits(page), tiff.other_numbers(page)
        if bits > _MOST_BITS or other:
            raise InputError(f"holds {other or f'numbers of {bits} bits'}; save it as PNG or TIFF with 8 or 16 bits")
        orientation, has_opacity = tiff.orientation_of(page), tiff.has_opacity(page)
        if tiff.is_planar(page) and (bits > _BITS_OF_PILLOW or tiff.samples(page) > 3):  # OpenCV mixes the planes
            planes = [_by_opencv(tiff.plane(page, k)) for k in range(tiff.samples(page))]
            return _Samples(_luma(np.dstack(planes)), orientation, planes[-1] if has_opacity else None)
        if bits > _BITS_OF_PILLOW and tiff.samples(page) == 2:
            raise InputError("grey levels of 16 bits with a second value each; save it as PNG, or without opacity")
        data = tiff.alone(page)
    with opened(BytesIO(data), "TIFF") as image:
        tiles: Any = image.tile
        with library(), quiet():
            image.load()  # OpenCV passes over damage in a compressed TIFF
        if has_opacity:
            levels = np.asarray(image) if bits <= _BITS_OF_PILLOW else _by_opencv(data, whole=True)
            return _Samples(_luma(levels), orientation, levels[..., -1])
        if tiles[0][3][0] == "L":  # grey levels of 8 bits, which OpenCV expands to colour and back
            return _Samples(np.array(image), orientation)
    return _Samples(_by_opencv(data), orientation)


@lru_cache(maxsize=4)
def _is_raw(path: Path, unchanged: Stamp) -> bool:
    """Whether a file with the form of TIFF is a camera's raw file, looked up once. unchanged : the stamp of the file"""
    with path.open("rb") as file:
        return Tiff(file).is_raw()


@lru_cache(maxsize=4)
def _pages(path: Path, unchanged: Stamp) -> list[Page]:
    """The pages of a TIFF file, looked up once for all of them. unchanged : the stamp of the file"""
    with path.open("rb") as file:
        return Tiff(file).photographs()


def _png(path: Path, number: int) -> _Samples:
    data = read_file(path)
    orientation, series = exif_orientation(BytesIO(data), "PNG"), animation(BytesIO(data))
    with opened(BytesIO(data), "PNG") as image:
        if series.frames > 1:
            _check_animation(image.width * image.height, series.frames, len(data))
            return _frame(image, series.first + number - 1, orientation)
        grey = _grey_by_pillow(image) if image.mode in ("L", "I;16") else _by_opencv(without_metadata(data))
        return _Samples(grey, orientation, _png_opacity(image, grey, data) if image.has_transparency_data else None)


def _check_animation(pixels: int, frames: int, nbytes: int) -> None:
    """Refuse frames that a file of ``nbytes`` cannot hold, and more than can be drawn upon one another."""
    if pixels > _MOST_PIXELS_PER_BYTE * nbytes:
        raise ValueError("its frames cover only a part of the picture")
    if pixels * frames > _MOST_ANIMATED_PIXELS:
        raise InputError(f"an animation of {frames} large frames; save them as single PNG or TIFF files")


def _frame(image: ImageFile, number: int, orientation: int) -> _Samples:
    """One frame of an animated PNG; each is drawn over those before it."""
    if image.mode.startswith("I"):
        raise InputError("an animation of 16 bits; save its frames as single PNG or TIFF files")
    with library():
        image.seek(number)
        levels = np.asarray(image.convert("RGBA"))
    return _Samples(_luma(levels), orientation, levels[..., 3])


def _png_opacity(image: ImageFile, grey: np.ndarray, data: bytes) -> np.ndarray:
    """Opacity of every pixel of a PNG with an alpha channel or a transparent colour."""
    if grey.dtype == np.uint8:
        with library():
            return np.asarray(image.convert("RGBA"))[..., 3]
    if image.mode == "I;16":
        return np.asarray(grey != image.info["transparency"])
    return _by_opencv(without_metadata(data), whole=True)[..., 3]


def _jpeg(path: Path, number: int) -> _Samples:
    data = read_file(path)
    place = 2
    for _, start, length in jpeg_segments(data):
        place = start + length
    if data.rfind(_JPEG_END) < place:  # a preview inside the header has markers of its own
        raise ValueError("no end-of-image marker")  # OpenCV 4.10 fills the rest with grey
    if data.count(_JPEG_SCAN, place) > _MOST_SCANS:
        raise InputError(f"more than {_MOST_SCANS} scans, which no camera writes; save it as PNG or TIFF")
    with opened(BytesIO(data), "JPEG") as image:
        image.draft("L", image.size)  # the luma that the file holds
        grey = _grey_by_pillow(image) if image.mode == "L" else _by_opencv(data)
        return _Samples(grey, exif_orientation(BytesIO(data), "JPEG"))


def _bmp(path: Path, number: int) -> _Samples:
    data = read_file(path)
    with opened(BytesIO(data), "BMP") as image, library():
        opacity = np.asarray(image)[..., 3] if image.mode == "RGBA" else None
        if opacity is not None and not opacity.any():
            opacity = None  # many programs leave the fourth byte at 0 without a meaning
        return _Samples(_by_opencv(data), 1, opacity)


def _heic(path: Path, number: int) -> _Samples:
    return _Samples(*read_heic(path))


def _raw(path: Path, number: int) -> _Samples:
    return _Samples(*read_raw(path))


def _video(path: Path, number: int) -> _Samples:
    return _Samples(read_frame(path, number), video_of(path).orientation)


_READERS: Mapping[Format, Callable[[Path, int], _Samples]] = {
    "PNG": _png,
    "TIFF": _tiff,
    "JPEG": _jpeg,
    "BMP": _bmp,
    "HEIC": _heic,
    "raw": _raw,
    "video": _video,
}
"""Format → reader of a page of a file. All raise InputError without the file's name, ValueError for damage, OSError."""


def _luma(levels: np.ndarray) -> np.ndarray:
    """Grey levels of red, green and blue or of grey (row, col, sample), without a further sample, the opacity."""
    if levels.shape[2] <= 2:
        return np.ascontiguousarray(levels[..., 0])
    grey: np.ndarray = opencv().cvtColor(np.ascontiguousarray(levels[..., :3]), opencv().COLOR_RGB2GRAY)
    return grey


def _grey_by_pillow(image: ImageFile) -> np.ndarray:
    """Samples of an image of grey levels; Pillow gives the same ones as OpenCV, and prints nothing about damage."""
    with library():
        levels = np.array(image)
    return levels if levels.dtype == np.uint8 else levels.astype(np.uint16)


def _by_opencv(data: bytes, whole: bool = False) -> np.ndarray:
    """Grey levels of a file; if ``whole``, its samples (row, col, 4): red, green, blue, opacity.

    Raises ValueError if it is truncated or cannot be decoded.
    """
    cv2 = opencv()
    grey = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    with library(), quiet():
        levels: np.ndarray | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED if whole else grey)
    if levels is None or (whole and levels.shape[2:] != (4,)):
        raise ValueError("OpenCV cannot decode it")
    if levels.dtype not in (np.uint8, np.uint16):
        raise InputError("expected grey levels of 8 or 16 bits; save the photograph as PNG or TIFF")
    return levels[..., [2, 1, 0, 3]] if whole else levels


@contextmanager
def _naming(file: Path | FilePart) -> Iterator[None]:
    """Raise every error as an InputError that names the file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    except FileNotFoundError as error:
        raise InputError(f"{file}: no such file; check the folder and the pattern") from error
    except PermissionError as error:
        raise InputError(f"{file}: may not be read; get the right to, or leave it out") from error
    except pillow().DecompressionBombError as error:
        raise InputError(f"{file}: larger than any camera's photograph; cut it to the specimen") from error
    except (IndexError, OSError, ValueError) as error:
        raise InputError(
            f"{file}: the photograph is truncated or damaged; copy it again from the camera or leave it out"
        ) from error
