"""The steps of a test: the photographs that patterns name, page by page, with those of the other camera.

Each frame of a video is a step, with the frame of the other camera that is nearest in time.
"""

from __future__ import annotations

import filecmp
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path

from dicflow.engine.files import FilePart
from dicflow.errors import InputError
from dicflow.io.images.clocks import joined_clocks, joined_sentence
from dicflow.io.images.formats import RAW_SUFFIXES, SUFFIXES, VIDEO_SUFFIXES, format_of, is_video
from dicflow.io.images.frame_pairs import FramePair, lag_sentence, length_sentence, pair_frames
from dicflow.io.images.pairing import Unpaired, Way, natural_key, pair_names
from dicflow.io.images.reading import page_count
from dicflow.io.images.search import find_files, search_start
from dicflow.io.images.video import video_of

__all__ = ["find_photographs", "steps_of", "video_sentences"]

_TIERS = (SUFFIXES, RAW_SUFFIXES, VIDEO_SUFFIXES)
"""Suffixes that a pattern finds; the later ones only where it finds no earlier ones."""
_DIGITS = 3
"""Least digits of the number of a page in the name of its step."""


def find_photographs(folder: Path, patterns: str | Sequence[str], side: str) -> dict[str, Path]:
    """The files that patterns name, by file name: those of a pattern in natural order, those of a list as listed.

    side : left or right, for messages
    Raises InputError if no file matches, or if two files have one stem.
    """
    by_stem: dict[str, Path] = {}
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        for path in _matching(folder, pattern, side):
            if (other := by_stem.setdefault(path.stem, path)) != path:
                raise InputError(f"{side}: {_one_name(other, path, path.stem)}")
    if not by_stem:
        raise InputError(
            f"{side}: no photograph matches {patterns!r} in {folder}; check the pattern, name the folder with --data, "
            "or start from 'dicflow init'"
        )
    return {path.name: path for path in by_stem.values()}


def steps_of(
    left: Mapping[str, Path],
    right: Mapping[str, Path] | None,
    by: Way | None = None,
    unpaired: Unpaired = "refuse",
    listed: bool = False,
    offset: float | None = None,
) -> dict[str, dict[str, Path | FilePart]]:
    """Step → left or right → photograph. A step has the left file's stem; one of many pages adds the page's number.

    left, right : file name → file, as :func:`find_photographs` gives them
    by, unpaired, listed : as for :func:`~dicflow.io.images.pairing.pair_names`
    offset : of the right video's clock, as for :func:`~dicflow.io.images.frame_pairs.pair_frames`; found if None
    Raises InputError as they do, and where two files that belong together have not as many pages.
    """
    _check_videos(left, right)
    if right is None:
        rows: Iterable[tuple[Path, ...]] = ((path,) for path in left.values())
    else:
        pairs = pair_names(list(left), list(right), by, unpaired, listed).pairs
        rows = [(left[a], right[b]) for a, b in pairs]
        for one, other in rows[:1]:
            _check_apart(one, other)
    steps: dict[str, dict[str, Path | FilePart]] = {}
    for name, files in chain.from_iterable(_parts(row, offset) for row in rows):
        if name in steps:
            raise InputError(_one_name(steps[name]["left"], files[0], name))
        steps[name] = dict(zip(("left", "right"), files, strict=False))
    return steps


def video_sentences(left: Mapping[str, Path], right: Mapping[str, Path] | None, offset: float | None) -> Iterator[str]:
    """What people need to know of the videos among the files, as :func:`steps_of` takes them."""
    files = [*left.values(), *(right or {}).values()]
    if not files or not all(map(is_video, files)):
        return
    for path in files:
        video = video_of(path)
        if video.complaint:
            yield (
                f"{path.name}: damaged ({video.complaint}); {len(video.times)} frames can be read, up to "
                f"{video.times[-1]:.2f} s; copy it again from the camera if the test is longer"
            )
        if not video.is_steady:
            yield (
                f"{path.name}: the time between its frames varies (variable frame rate); each frame has its own time "
                "from the file, on which curves and rates rest"
            )
    if len(files) == 2:
        one, other = files
        if offset is None:
            yield joined_sentence(one, other, joined_clocks(one, other))
        pairs = _paired(one, other, offset)
        yield from filter(None, (length_sentence(one, other, pairs), lag_sentence(one, other, pairs)))


def _check_videos(left: Mapping[str, Path], right: Mapping[str, Path] | None) -> None:
    """Refuse a video beside other files of its camera, or beside photographs of the other one."""
    for side, files in (("left", left), ("right", right or {})):
        videos = [path for path in files.values() if is_video(path)]
        if videos and len(files) > 1:
            raise InputError(
                f"{side}: {videos[0].name} is a video and one of {len(files)} files; name one video, or join its parts "
                "into one file"
            )
    if right is not None and len({is_video(path) for path in (*left.values(), *right.values())}) > 1:
        one, other = next(iter(left.values())), next(iter(right.values()))
        with suppress(OSError):  # whoever reads it says why it cannot be read
            _check_readable(other if is_video(one) else one)
        raise InputError(f"{one.name} and {other.name}: a video and photographs; both cameras must give the same")


def _check_readable(path: Path) -> None:
    """Raise InputError for a file that is empty, or neither a photograph nor a video; OSError as opening it does."""
    with path.open("rb") as file:
        try:
            format_of(file)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def _check_apart(left: Path, right: Path) -> None:
    """Refuse what one camera took in the place of both."""
    with suppress(OSError):
        if left.samefile(right):
            raise InputError(f"{left.name}: is the left and the right camera's; name the files of the other camera")
        if is_video(left) and filecmp.cmp(left, right, shallow=False):
            raise InputError(f"{right}: is a copy of {left.name}; copy the right camera's files again")


def _parts(files: tuple[Path, ...], offset: float | None) -> Iterator[tuple[str, tuple[Path | FilePart, ...]]]:
    """Name and photographs of each step of one file, or of two that belong together."""
    if len(files) < 2 or not is_video(files[0]):
        yield from _pages(files)
        return
    digits = max(_DIGITS, len(str(len(video_of(files[0]).times))))
    one, other = files
    for pair in _paired(one, other, offset):
        yield f"{one.stem}_{pair.left:0{digits}d}", (FilePart(one, pair.left), FilePart(other, pair.right))


def _paired(left: Path, right: Path, offset: float | None) -> list[FramePair]:
    return pair_frames(left, right, joined_clocks(left, right).offset if offset is None else offset)


def _pages(files: tuple[Path, ...]) -> Iterator[tuple[str, tuple[Path | FilePart, ...]]]:
    """Name and pages of each step, as :func:`_parts`."""
    counts = [page_count(path) for path in files]
    if len(set(counts)) > 1:
        raise InputError(
            f"{files[0]}: {counts[0]} pages, but {files[1]} has {counts[1]}; both cameras must have the same steps: "
            "save both stacks again with equal pages"
        )
    digits = max(_DIGITS, len(str(counts[0])))
    for number in range(1, counts[0] + 1):
        alone = counts[0] == 1
        name = files[0].stem if alone else f"{files[0].stem}_{number:0{digits}d}"
        yield name, tuple(path if alone else FilePart(path, number) for path in files)


def _matching(folder: Path, pattern: str, side: str) -> list[Path]:
    """The file of this name, or the photographs that match a pattern, in natural order."""
    start, parts = search_start(folder, pattern)
    if not parts:
        if start.is_dir():
            raise InputError(
                f"{side}: {pattern!r} is a folder; write a pattern such as {pattern.rstrip('/') or '.'}/*.png"
            )
        return [start]
    found = find_files(start, parts)
    photographs = next(filter(None, (_with_suffix(found, suffixes) for suffixes in _TIERS)), [])
    if found and not photographs:
        raise InputError(
            f"{side}: {pattern!r} matches {found[0].name}{_more(len(found) - 1)}, but no PNG, TIFF, JPEG or BMP, and "
            "no video; save the photographs in one of these formats"
        )
    return sorted(photographs, key=lambda path: (natural_key(path.name), path))


def _with_suffix(found: Sequence[Path], suffixes: Sequence[str]) -> list[Path]:
    return [path for path in found if path.suffix.lower() in suffixes]


def _more(count: int) -> str:
    return f" and {count} more" if count else ""


def _one_name(one: Path | FilePart, other: Path | FilePart, step: str) -> str:
    return f"{one} and {other} would both be step '{step}'; rename one of them, or leave it out of the pattern"
