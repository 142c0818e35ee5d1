"""What a file holds, by its first bytes: the name of a file says nothing."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Literal

from dicflow.errors import InputError

__all__ = ["ALL_SUFFIXES", "RAW_SUFFIXES", "SUFFIXES", "VIDEO_SUFFIXES", "Format", "format_of", "is_video"]

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
"""Suffixes that a pattern finds, in lower case."""
VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")
"""The same of videos."""
RAW_SUFFIXES = (".heic", ".heif", ".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".rw2", ".orf")
"""The same of photographs that need a decoder of their own. Cameras also save them beside JPEG files."""
ALL_SUFFIXES = (*SUFFIXES, *RAW_SUFFIXES, *VIDEO_SUFFIXES)
"""The suffixes of all photographs and videos."""

Format = Literal["PNG", "JPEG", "BMP", "TIFF", "HEIC", "raw", "video"]

_FIRST_BYTES: dict[bytes, Format] = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"BM": "BMP",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",
    b"MM\0+": "TIFF",
}
_CONVERT = "save it as PNG or TIFF"
_DEVELOP = "develop it to TIFF with 16 bits, or let the camera save TIFF or JPEG"
_FRAMES = "save its frames as PNG or TIFF"
_DECODED: tuple[tuple[int, bytes, Format], ...] = (
    *((4, first, "HEIC") for first in (b"ftyphei", b"ftyphev", b"ftypmif1", b"ftypmsf1")),
    (4, b"ftypcrx", "raw"),
    *((0, first, "raw") for first in (b"FUJIFILMCCD-RAW", b"IIU\0", b"IIRO", b"IIRS")),
)
"""Place [bytes], first bytes and format of photographs that need a decoder of their own."""
_VIDEOS = ((8, b"AVI "), (4, b"ftyp"), (4, b"moov"), (4, b"mdat"), (4, b"wide"), (4, b"free"), (0, b"\x1aE\xdf\xa3"))
"""Place [bytes] and first bytes of videos: AVI, MP4 and MOV, MKV and WebM."""
_OTHERS: tuple[tuple[int, bytes, str, str], ...] = (
    (0, b"GIF8", "a GIF image", _FRAMES),
    (8, b"WEBP", "a WebP image", _CONVERT),
    (4, b"ftypavif", "an AVIF image", _CONVERT),
    (4, b"jP  \r\n", "a JPEG 2000 image", _CONVERT),
    (0, b"\xff\x4f\xff\x51", "a JPEG 2000 image", _CONVERT),
    (0, b"\xff\x0a", "a JPEG XL image", _CONVERT),
    (4, b"JXL \r\n", "a JPEG XL image", _CONVERT),
    (0, b"\0MRM", "a camera's raw file (MRW)", _DEVELOP),
    (0, b"FOVb", "a camera's raw file (X3F)", _DEVELOP),
    (0, b"%!PS", "a PostScript drawing", _CONVERT),
    (0, b"\xc5\xd0\xd3\xc6", "a PostScript drawing", _CONVERT),
    (0, b"%PDF", "a PDF document", "save its pictures as PNG or TIFF"),
    (0, b"8BPS", "a Photoshop document", _CONVERT),
    (0, b"DDS ", "a DDS texture", _CONVERT),
    (0, b"\0\0\1\0", "an icon", _CONVERT),
    (0, b"v/1\1", "an OpenEXR image", "save it as TIFF with 16 bits"),
    (0, b"SIMPLE  =", "a FITS image", "save it as TIFF with 16 bits"),
    (0, b"\x89HDF", "an HDF5 file", "save its images as TIFF"),
    (0, b"PK\3\4", "a ZIP archive", "unpack it"),
    (0, b"Rar!", "a RAR archive", "unpack it"),
    (0, b"7z\xbc\xaf", "a 7z archive", "unpack it"),
    (0, b"\x1f\x8b", "a compressed file (gzip)", "unpack it"),
    (0, b"P5", "a PGM image", _CONVERT),
    (0, b"P6", "a PPM image", _CONVERT),
    (0, b"<svg", "an SVG drawing", _CONVERT),
    (0, b"<?xml", "XML text or an SVG drawing", "leave it out, or save the drawing as PNG"),
    (0, b"version https://git-lfs", "a pointer of Git LFS", "fetch the file itself with 'git lfs pull'"),
)
"""Place [bytes], first bytes, name and remedy of formats that are not read."""
_LOOKED_AT = 512


def format_of(file: BinaryIO) -> Format:
    """Format of an open photograph. Raises InputError that says what else it is, without its name, and OSError."""
    start = file.read(_LOOKED_AT)
    for first, form in _FIRST_BYTES.items():
        if start.startswith(first):
            return form
    for place, first, form in _DECODED:
        if start.startswith(first, place):
            return form
    is_other = any(start.startswith(first, place) for place, first, _, _ in _OTHERS)
    if not is_other and any(start.startswith(first, place) for place, first in _VIDEOS):
        return "video"
    raise InputError(_refusal(start))


def is_video(path: Path) -> bool:
    """Whether a file is a video by its first bytes; False where it cannot be read."""
    if not path.is_file():
        return False  # opening a pipe would wait for ever
    try:
        with path.open("rb") as file:
            return format_of(file) == "video"
    except (InputError, OSError):
        return False


def _refusal(start: bytes) -> str:
    if not start:
        return "the photograph is empty; copy it again from the camera or leave it out"
    for place, first, name, remedy in _OTHERS:
        if start.startswith(first, place):
            return f"{name}, not a photograph in PNG, TIFF, JPEG or BMP; {remedy}, or leave it out"
    if _is_text(start):
        return "text, not a photograph in PNG, TIFF, JPEG or BMP; leave it out"
    return (
        "not a photograph in PNG, TIFF, JPEG or BMP, or damaged at its start; "
        "save it in one of these formats, copy it again from the camera, or leave it out"
    )


def _is_text(start: bytes) -> bool:
    """Whether the first bytes are printable ASCII."""
    return all(byte in b"\t\r\n" or 32 <= byte < 127 for byte in start)
