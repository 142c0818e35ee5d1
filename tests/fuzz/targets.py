"""The readers of files that users bring, each with valid files to start from."""

from __future__ import annotations

import csv
import io
import json
import random
import re
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from dicflow.engine.files import FilePart
from dicflow.engine.product import Product
from dicflow.io.calibrations.draft import Calibration
from dicflow.io.calibrations.read import read_calibration
from dicflow.io.caliper import read_caliper
from dicflow.io.configuration import parse
from dicflow.io.crate import METADATA, Contents, Crate, Described, read_crate
from dicflow.io.images import page_count, probe, read_photograph, time_taken, video_of
from dicflow.io.images.png import chunks
from dicflow.io.logs.log import read_log
from dicflow.io.points_table import read_points
from dicflow.io.region import read_geojson, read_mask
from dicflow.io.results import csv_text
from dicflow.io.rig import read_covariance, read_rig
from dicflow.io.stress_table import read_stresses
from dicflow.io.table import plain_text
from dicflow.pipeline.pipeline import Pipeline
from dicflow.pipeline.sweep import variants, with_settings
from dicflow.pipeline.wiring import wire
from tests.fuzz.harness import Target
from tests.io.calibration_files import FILES, SIZE, made_rig, vic3d_xml
from tests.io.photograph_files import bitmap, png, tiff, tiff_of_samples
from tests.log_files import balance_log, logger_log, machine_log

__all__ = ["targets"]

_ROOT = Path(__file__).parents[2]
_SWEEP = b"sweep:\n  grid: {strain.window: [[3, 3], [5, 5]], smooth.degree: [1, 2]}\n  exclude: [{smooth.degree: 2}]\n"
_CALIPER = b"# by hand\nphase,load_g,length_mm\nloading,0,59.95\nloading,68.53,64.4\nunloading,0,60.02\n"
_STRESSES = b"# by hand\nphase,stretch,u_stretch,nominal_stress_kPa\nloading,1.1,0.01,98.5\nunloading,1.05,0.01,44\n"
_POINTS = (
    b"x_image,y_image,X,Y,Z,U,V,W,exx,eyy,exy,e1,e2\n10,20,1,2,3,0.1,0.2,0.3,0.01,0.02,0.004,0.02,0.01\n11,20,,,,,,,,,,,\n",
    b"# U: mm\nrow,col,U,V,W,exx,eyy,gxy,sigma_U,reference_x,reference_y\n0,0,0.1,0.2,0.3,0.01,0.02,0.008,0.5,10,20\n",
    b"X;Y;Z;U;V;W;sigma;x;y;exx;eyy;exy\n1;2;3;0,125;0,25;0,5;0,01;10;20;0,01;0,02;0,004\n1;2;3;1,5;2,5;3;-1;10;20;0;0;0\n",
    b"x,y,ref_x,ref_y,ref_z,tar_x,tar_y,tar_z,exx\n10,20,1,2,3,1.1,2.2,3.3,0.01\n",
    b"Coordinates.Image X [Pixel]\tCoordinates.Image Y [Pixel]\tdisp.Horizontal Displacement U [mm]\n10\t20\t0.1\n",
)
_SQUARE = [[0, 0], [90.5, 0], [90, 80], [0, 80], [0, 0]]
_GEOJSON = (
    {"type": "Polygon", "coordinates": [_SQUARE, [[20, 20], [40, 20], [40, 40]]]},
    {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [_SQUARE]}}],
    },
    {"type": "GeometryCollection", "geometries": [{"type": "MultiPolygon", "coordinates": [[_SQUARE]]}]},
    {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [_SQUARE]}},
            {"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[0, 0], [20.5, 30], [40, 40]]}},
            {"type": "Feature", "geometry": {"type": "MultiLineString", "coordinates": [[[0, 9], [9, 0]]]}},
        ],
    },
)
_SETTINGS = (
    b"strain.window=[3, 3]",
    b"smooth.degree=1,2",
    b"corners.size=[9, 6]",
    b"photos.left='a b/*.png'",
)
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_NAMES = (
    b"point 1\n=cmd|' /C calc'!A0\n+1\n-1.5\n@SUM(A1)\n\xce\xb5, a\n'=x\n\ta\n\r=1\n a\n;=2\n,=3",
    b"a\nb\n<script>\n../x",
)


def targets() -> tuple[Target, ...]:
    """All of them."""
    readers = (
        Target("pipeline", "p.yaml", _pipelines(), _pipeline),
        Target("settings", "setting", _SETTINGS, _setting, mark="--set"),
        Target("caliper", "lengths.csv", (_CALIPER, _CALIPER.replace(b",", b";").replace(b".", b",")), _caliper),
        Target("log", "log.csv", _logs(), _log),
        Target("stress table", "curve.csv", (_STRESSES, _STRESSES.replace(b",", b";")), _stresses),
        Target("points", "points.csv", _POINTS, _points),
        Target("geojson", "region.geojson", [json.dumps(one).encode() for one in _GEOJSON], _region),
        Target("rig", "rig.json", [_written("dicflow.json"), _rig_with_covariance()], _rig),
        Target("mask", "mask.png", _pictures(), _without_warnings(read_mask), _with_check_sums),
        Target("photograph", "photo.tif", _pictures(), _without_warnings(_photograph), _with_check_sums),
        Target("video", "video.mp4", _files("videos/*.m*"), _video),
        Target("crate", METADATA, (_crate(),), _files_of_crate),
        Target("results", "names", _NAMES, _results),
    )
    if find_spec("pi_heif"):
        readers += (Target("heic", "photo.heic", _files("photographs/*.heic"), _without_warnings(_levels)),)
    return readers + tuple(_calibration(name) for name in FILES)


def _calibration(name: str) -> Target:
    pack = {"vic3d.z3d": _zipped, "matlab.mat": _packed, "matlab_newer.mat": _packed}.get(name)
    seed = vic3d_xml(made_rig(tangential=False), newer=True).encode() if name == "vic3d.z3d" else _written(name)
    target = Target(f"calibration {name}", name, (seed,), _calibrated)
    return target if pack is None else target._replace(pack=pack)


def _calibrated(path: Path) -> Any:
    found: Calibration = read_calibration(path, SIZE)
    return [found.rig.left[:2], found.rig.right[:2], found.rig.rotation, found.rig.translation]


def _written(name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        FILES[name](path, made_rig(tangential="vic3d" not in name))
        return path.read_bytes()


def _rig_with_covariance() -> bytes:
    return json.dumps({**json.loads(_written("dicflow.json")), "covariance": (np.eye(24) * 1e-6).tolist()}).encode()


def _zipped(xml: bytes, chance: random.Random) -> bytes:
    """A project with this XML, packed in one of zip's ways; sometimes the archive is changed too."""
    ways = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", chance.choice(ways)) as archive:
        archive.writestr("project.xml", xml)
    data = bytearray(buffer.getvalue())
    if chance.random() < 0.3:
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return bytes(data)


def _packed(data: bytes, chance: random.Random) -> bytes:
    """A file of version 7: what follows the header as compressed elements, in some of the files."""
    if chance.random() < 0.5 or len(data) < 136:
        return data
    inner = zlib.compress(data[128:] + bytes(60_000_000 * (chance.random() < 0.02)), 1)
    return data[:128] + (15).to_bytes(4, "little") + len(inner).to_bytes(4, "little") + inner


@cache
def _pipelines() -> tuple[bytes, ...]:
    texts = [path.read_bytes() for path in sorted((_ROOT / "pipelines").glob("*.yaml"))]
    return (*texts, *(text + _SWEEP for text in texts[:1]))


def _pipeline(path: Path) -> None:
    Pipeline.load(path, data=path.parent)


def _crate() -> bytes:
    """The description of a crate, as dicflow writes it."""
    files = {name: Contents(len(name), 64 * "a") for name in ("p.yaml", "left/a b.png", "left/ä.png")}
    return Described(
        Crate("p.yaml", files), "test", "as said", "20260131-101500-ab12cd", 1e9, {"numpy": ["2"]}
    ).to_json()


def _files_of_crate(path: Path) -> Any:
    found = read_crate(path.parent)
    for name in (found.pipeline, *found.files):
        assert (path.parent / "files" / name).resolve().is_relative_to(path.parent.resolve() / "files")
        assert not any(part.startswith(".") for part in name.split("/"))
    return [len(found.files)]


def _setting(path: Path) -> None:
    """The content as a command line would give it; messages name the setting, here the file in its place."""
    text = path.read_bytes().decode("utf-8", errors="surrogateescape").replace("\0", "")
    document = with_settings(parse(_pipelines()[0].decode(), str(path)), [text])
    for variant in variants(document):
        wire(variant.document)


def _caliper(path: Path) -> Any:
    return read_caliper(path)[1:]


def _logs() -> tuple[bytes, ...]:
    seconds = np.arange(0.0, 3000.0, 217.3)
    return (
        machine_log(seconds, 0.5 * seconds, 0.1 * seconds),
        balance_log(seconds, 1.5 * seconds - 20.0),
        logger_log(seconds, 20.0 + 0.01 * seconds, 1e-4 * seconds),
    )


def _log(path: Path) -> Any:
    log = read_log(path)
    clock = None if log.clock is None else log.clock.seconds / 10.0
    return [[column.values for column in log.columns.values()], clock if clock is not None else 0.0]


def _stresses(path: Path) -> Any:
    found = read_stresses(path)
    return [one for one in found if isinstance(one, np.ndarray)]


def _points(path: Path) -> Any:
    found = read_points(path)
    return [found.xy, *found.values.values(), *found.sigmas.values()]


def _region(path: Path) -> Any:
    found = read_geojson(path)
    return [*(list(polygon.rings) for polygon in found.polygons), found.cuts]


def _rig(path: Path) -> Any:
    read_covariance(path)
    rig = read_rig(path)
    return [rig.left.size]


def _without_warnings(read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """Pillow warns of damaged tags, of which no measurement depends."""

    def quiet(path: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path)

    return quiet


@cache
def _pictures() -> tuple[bytes, ...]:
    """Photographs in every form that is read, so small that most bytes say how to read the others."""
    grey = np.arange(96, dtype=np.uint8).reshape(8, 12)
    deep, opacity = grey.astype(np.uint16) * 200, np.where(grey > 40, 255, 0).astype(np.uint8)
    rgb, rgba = np.dstack([grey] * 3), np.dstack([grey] * 3 + [opacity])
    return (
        *(_saved(samples, form) for samples in (grey, rgb, deep) for form in ("PNG", "TIFF")),
        *(_saved(samples, form) for samples in (np.dstack([grey, opacity]), rgba) for form in ("PNG", "TIFF")),
        *(_saved(grey, form) for form in ("BMP", "JPEG")),
        _saved(rgb, "JPEG"),
        _saved(rgb, "JPEG", progressive=True),
        bitmap(grey, opacity),
        png(np.dstack([deep, opacity.astype(np.uint16) * 257]), 4),
        png(deep, 0, b"\x20\0"),
        _saved(grey, "PNG", transparency=7),
        *_animations(grey),
        *_tagged(grey),
        tiff([grey, grey[::2, ::2], grey], more=[{}, {254: 1}, {274: 6}]),
        tiff([deep, deep], ">", big=True),
        *(tiff_of_samples(samples, extra, planar=True) for samples, extra in ((rgb, None), (rgba, 2))),
        tiff_of_samples(np.dstack([deep] * 3), planar=True),
        _saved(grey, "TIFF", save_all=True, append_images=[Image.fromarray(grey)], compression="tiff_lzw"),
        _saved(rgb, "TIFF", compression="tiff_adobe_deflate", tiffinfo={270: "ImageJ=1.54f\nimages=1\n"}),
    )


def _animations(grey: np.ndarray) -> tuple[bytes, ...]:
    """Animated PNG files, with and without a picture before the animation."""
    others = [Image.fromarray(grey // 2), Image.fromarray(grey // 3)]
    return tuple(_saved(grey, "PNG", save_all=True, append_images=others, default_image=one) for one in (False, True))


def _tagged(grey: np.ndarray) -> tuple[bytes, ...]:
    """Files with an orientation tag in every kind of metadata."""
    exif, text = Image.Exif(), PngInfo()
    exif[0x0112] = 6
    xmp = '<x:xmpmeta><rdf:Description tiff:Orientation="6"/></x:xmpmeta>'
    text.add_itxt("XML:com.adobe.xmp", xmp)
    text.add_text("Raw profile type exif", f"\nexif\n{len(exif.tobytes())}\n{exif.tobytes().hex()}\n", zip=True)
    return (
        _saved(grey, "PNG", exif=exif),
        _saved(grey, "PNG", pnginfo=text),
        _saved(grey, "JPEG", exif=exif),
        _saved(grey, "JPEG", xmp=xmp.encode()),
        _saved(grey, "TIFF", tiffinfo={274: 6}),
    )


def _saved(samples: np.ndarray, form: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(samples).save(buffer, form, **options)
    return buffer.getvalue()


def _with_check_sums(data: bytes, chance: random.Random) -> bytes:
    """A changed PNG file with the right sums of its chunks, in most cases: without, no reader looks further."""
    if not data.startswith(b"\x89PNG\r\n\x1a\n") or chance.random() < 0.2:
        return data
    parts = bytearray(data)
    for _, place, length in chunks(io.BytesIO(data)):
        end = place + length
        if end + 4 <= len(data):
            parts[end : end + 4] = zlib.crc32(parts[place - 4 : end]).to_bytes(4, "big")
    return bytes(parts)


def _photograph(path: Path) -> None:
    """All pages, each as it is looked at before a run."""
    count = page_count(path)
    for number in range(1, count + 1):
        probe(FilePart(path, number) if count > 1 else path)


def _files(pattern: str) -> tuple[bytes, ...]:
    """Contents of the small files that tests of readers keep."""
    return tuple(path.read_bytes() for path in sorted((_ROOT / "tests" / "io").glob(pattern)))


def _video(path: Path) -> Any:
    """Times of all frames, and grey levels of a few."""
    found = video_of(path)
    count = len(found.times)
    levels = [read_photograph(FilePart(path, number)).grey.mean() for number in {1, count // 2 + 1, count}]
    return [found.width, found.height, levels]


def _levels(path: Path) -> Any:
    time_taken(path)
    return read_photograph(path).grey.mean()


def _results(path: Path) -> None:
    """Tables with the file's lines as names: no cell is a formula, and the names come back."""
    names = path.read_bytes().decode("utf-8", errors="replace").split("\n")
    rows = [{"probe": name, name: -1.5} for name in names]
    text = csv_text(Product("noise", {}, {"verdict": names[0], "rows": rows, "summary": {}}), names[-1])
    lines = text.split("\n")
    start = next(number for number, line in enumerate(lines) if not line.startswith("#"))
    in_notes = [cell for line in lines[:start] for cell in line.replace(";", ",").split(",")]
    first = [row[0] for row in csv.reader(io.StringIO("\n".join(lines[start:]), newline=""), strict=True) if row][1:]
    assert not [
        cell for cell in (*in_notes, *first) if cell.startswith(tuple("=+-@\t\r")) and not _NUMBER.fullmatch(cell)
    ]
    assert [plain_text(cell) for cell in first] == names
