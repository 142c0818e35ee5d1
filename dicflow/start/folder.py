"""What a folder of photographs holds: the specimen, the boards, the two cameras, tables, and where to measure."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from dicflow.core.calibration.board import Board
from dicflow.core.calibration.identify import identify_board
from dicflow.core.photographs.polygon import Polygon
from dicflow.engine.files import FilePart
from dicflow.engine.graph import EARLY_STEPS
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, DicflowError, InputError, StageError
from dicflow.io.calibrations.read import parse_calibration
from dicflow.io.images import ALL_SUFFIXES, RAW_SUFFIXES, read_grey
from dicflow.io.images.search import MOST_ENTRIES
from dicflow.kinds.images import Images
from dicflow.kinds.region import Region
from dicflow.start.choice import Candidate, Choice, Undecided, decide, is_named
from dicflow.start.contents import See, Subjects, board_in, subjects_of
from dicflow.start.facts import Facts
from dicflow.start.gauge import Gauge, gauge_over, in_8bit
from dicflow.start.layouts import Series, series_of, step_folders
from dicflow.start.patterns import listed, patterns_of
from dicflow.start.photographs import Photographs, maker, photographs_of
from dicflow.start.question import question
from dicflow.start.sorting import copies_in, parted_by_counter
from dicflow.start.videos import SHARPEST, frames_to_see
from dicflow.start.ways import possible_way

__all__ = ["Caliper", "Found", "Photographs", "Survey", "look", "photographs_in", "survey"]

Say = Callable[[str], None]

_SKIPPED = frozenset({"results", "export", "truth", "__macosx", "thumbs", "thumbnails", "@eadir"})
_MAX_PHOTOGRAPHS = 20_000
_CALIBRATION_SUFFIXES = frozenset({".xml", ".yaml", ".yml", ".json", ".caldat", ".z3d", ".csv", ".mat"})
_TABLE_SUFFIXES = frozenset({".csv", ".txt", ".tsv"})
_MAX_BYTES = 1_000_000
"""Size of a table or a calibration."""
_QUICK_PIXELS = 600_000


class Caliper(NamedTuple):
    """A caliper table: its name, and why it cannot be compared; empty if it can."""

    name: str
    obstacle: str


class Found(NamedTuple):
    """Content of a folder.

    board : what the boards' photographs show
    calibration : name of a file with the rig; None where boards give it
    region : name of a file with the region
    """

    photos: Photographs
    boards: Photographs | None = None
    board: Board | None = None
    calibration: str | None = None
    region: str | None = None
    caliper: Caliper | None = None
    gauge: Gauge | None = None


class Survey(NamedTuple):
    """The series in a folder, and which of them may be measured.

    paths : of all photographs, relative to the folder
    copies : photographs that are there twice, which belong to no series
    subjects : the series by what they show
    candidates : what may be measured; the first is the most likely
    undecided : why the others are as likely; None where the first is certain
    calibration : name of a file with the rig; None without one, or where boards give it
    """

    paths: list[PurePosixPath]
    copies: list[PurePosixPath]
    subjects: Subjects
    candidates: Sequence[Candidate]
    undecided: Undecided | None
    calibration: str | None


def survey(folder: Path, choice: Choice, see: See | None = None) -> Survey:
    """Find the series of photographs in a folder, and the cameras that took them.

    choice : what the user names
    see : looks at photographs; None for a new one
    Raises InputError without photographs of a specimen, and ConfigurationError if what is named is not there.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the folder that holds the photographs")
    paths, facts = photographs_in(folder), Facts(folder)
    copies = copies_in(folder, paths, facts.camera, facts.taken)
    series = _series(folder, [path for path in paths if path not in set(copies)], choice, facts)
    if steps := step_folders(series):
        raise InputError(
            f"{folder}: {len(steps)} folders hold one photograph each, as {steps[0].files[0]} and {steps[1].files[0]}, "
            "but steps are named by files; copy those of each camera into one folder, under the names of the steps"
        )
    subjects = _subjects(folder, series, choice, see or _see(folder))
    calibration = None if subjects.boards else _calibration(folder)
    try:
        chosen = decide(subjects.specimen, subjects.boards, choice, calibration is not None)
    except Undecided as undecided:
        return Survey(paths, copies, subjects, undecided.candidates, undecided, calibration)
    return Survey(paths, copies, subjects, [chosen], None, calibration)


def look(folder: Path, choice: Choice, command: Sequence[str], say: Say) -> Found:
    """Find the photographs of the specimen and of boards, their cameras, the kind of board, and a place to measure.

    choice : what the user names
    command : words of the command line, which a question completes
    say : called with each finding
    Raises InputError without photographs of a specimen, and ConfigurationError if the cameras are not certain.
    """
    see = _see(folder)
    paths, copies, subjects, candidates, undecided, calibration = survey(folder, choice, see)
    if undecided is not None:

        def is_settled(brief: Choice, candidate: Candidate) -> bool:
            try:
                found = survey(folder, brief, see)
            except DicflowError:
                return False
            chosen = found.candidates[0]
            same = chosen[:2] == candidate[:2] and (chosen.boards or ())[:2] == (candidate.boards or ())[:2]
            return found.undecided is None and same

        text = question(folder, undecided, command, paths, calibration is not None, is_settled)
        raise ConfigurationError(text) from undecided
    chosen = candidates[0]
    found = _described(folder, chosen, paths, see, choice)
    say(f"specimen: {found.photos}")
    if chosen.right and calibration:
        found = found._replace(calibration=calibration)
        say(f"calibration: {calibration}")
    if found.boards and found.board:
        say(f"boards: {found.boards}, {found.board.text}")
    series = [one for group in subjects for one in group]
    for one, reason in _left_out(subjects, chosen):
        say(f"left out: {len(one.files)} photographs, {listed(patterns_of(one.files, paths))}{reason}")
    if copies:
        what = f"{len(copies)} copies of photographs" if len(copies) > 1 else "1 copy of a photograph"
        say(f"left out: {what}, {listed(list(map(str, copies)))}")
    single = sorted(set(paths) - set(copies) - {path for one in series for path in one.files})
    if single:
        say(f"left out: {len(single)} photographs, {listed(list(map(str, single)))}: their names fit no series")
    return _with_places(folder, found, say)


def photographs_in(folder: Path) -> list[PurePosixPath]:
    """Paths, relative to a folder, of all photographs in it and below that may be measured.

    Raises InputError for too many of them.
    """
    return list(_photographs(folder))


def _photographs(folder: Path) -> Iterator[PurePosixPath]:
    """Relative paths of all photographs that are not hidden, outside hidden folders and those of results."""
    waiting, count, visited = [os.fspath(folder)], 0, 0
    while waiting:
        entries = _visible(waiting.pop())
        visited += len(entries)
        for entry in _photographs_among(entries):
            count += 1
            yield _named(Path(entry.path).relative_to(folder))
        if count > _MAX_PHOTOGRAPHS or visited > MOST_ENTRIES:
            most = f"{_MAX_PHOTOGRAPHS} photographs or {MOST_ENTRIES} files and folders"
            raise InputError(f"{folder}: more than {most}; name the folder of one test")
        folders = [entry for entry in entries if entry.is_dir(follow_symlinks=False)]
        waiting += [entry.path for entry in reversed(folders) if entry.name.lower() not in _SKIPPED]


def _photographs_among(entries: Sequence[os.DirEntry[str]]) -> list[os.DirEntry[str]]:
    """The photographs of one folder: those that a camera has developed, else raw ones."""
    suffixes = [PurePosixPath(entry.name).suffix.lower() for entry in entries]
    found = [
        (entry, suffix in RAW_SUFFIXES)
        for entry, suffix in zip(entries, suffixes, strict=True)
        if suffix in ALL_SUFFIXES and not entry.is_dir()
    ]
    return [entry for entry, is_raw in found if not is_raw] or [entry for entry, _ in found]


def _visible(folder: str) -> list[os.DirEntry[str]]:
    """What is in a folder and not hidden, by name; nothing where it cannot be listed."""
    try:
        with os.scandir(folder) as entries:
            return sorted((one for one in entries if not one.name.startswith(".")), key=lambda one: one.name)
    except OSError:
        return []


def _named(path: Path) -> PurePosixPath:
    """The path with slashes. Raises InputError for a name that no pipeline file can hold."""
    if not _is_text(str(path)):
        raise InputError(f"{path.as_posix()!a}: the name is not Unicode; rename it")
    return PurePosixPath(path.as_posix())


def _is_text(name: str) -> bool:
    """Whether a name is Unicode: bytes that are not stand for themselves as lone surrogates."""
    return not any("\ud800" <= sign <= "\udfff" for sign in name)


def _series(folder: Path, paths: Sequence[PurePosixPath], choice: Choice, facts: Facts) -> list[Series]:
    """The series, none of which is of two cameras, or lies on both sides of what the user named.

    Raises ConfigurationError if a pattern names no photograph.
    """
    for option in ("left", "right", "boards"):
        for pattern in getattr(choice, option):
            if not any(is_named(path, [pattern]) for path in paths):
                raise ConfigurationError(
                    f"--{option} {shlex.quote(pattern)}: matches no photograph in {folder}; name a folder or a pattern"
                )
    groups: dict[tuple[bool, ...], list[PurePosixPath]] = {}
    for path in paths:
        named = tuple(is_named(path, patterns) for patterns in (choice.left, choice.right, choice.boards))
        groups.setdefault(named, []).append(path)
    whole = [one for group in groups.values() for one in series_of(group, facts.label(set(paths)))]
    return whole if choice.one_camera else [part for one in whole for part in parted_by_counter(one, facts.taken)]


def _see(folder: Path) -> See:
    @cache
    def see(path: PurePosixPath, thorough: bool = False) -> Board | None:
        images = (read_grey(file) for file in frames_to_see(folder / path))
        boards = (identify_board(one if thorough else in_8bit(one, _QUICK_PIXELS), thorough) for one in images)
        return next((board for board in boards if board is not None), None)

    return see


def _subjects(folder: Path, series: Sequence[Series], choice: Choice, see: See) -> Subjects:
    """The series by what the user named as boards, else by what they show. Raises InputError without a specimen."""
    if choice.boards:
        boards = tuple(one for one in series if is_named(one.files[0], choice.boards))
        subjects = Subjects(tuple(one for one in series if one not in boards), boards)
    else:
        subjects = subjects_of(series, see)
    if subjects.specimen:
        return subjects
    damaged = [path for one in subjects.unreadable for path in one.files]
    if damaged and not subjects.boards:
        raise InputError(f"{folder}: no photograph can be read, such as {damaged[0]}; copy them into it again")
    counts = ", ".join(f"{one.folder}: {len(one.files)}" for one in subjects.boards)
    instead = f"only those of a board ({counts})" if counts else f"expected {', '.join(ALL_SUFFIXES)} in it or below"
    raise InputError(f"{folder}: no photographs of a specimen found, {instead}; name the folder that holds them")


def _left_out(subjects: Subjects, chosen: Candidate) -> Iterator[tuple[Series, str]]:
    """Series that are not measured, and why."""
    used = [chosen.left, chosen.right, *((chosen.boards.left, chosen.boards.right) if chosen.boards else ())]
    reasons = ("", "", ": named like boards, but no board is recognised in them", ": cannot be read")
    for group, reason in zip(subjects, reasons, strict=True):
        yield from ((one, reason) for one in group if one not in used)


def _described(folder: Path, chosen: Candidate, paths: Sequence[PurePosixPath], see: See, choice: Choice) -> Found:
    facts = Facts(folder)
    photos = photographs_of(folder, chosen.left, chosen.right, paths, facts, choice.pair_by)
    if chosen.boards is None:
        return Found(photos)
    both = chosen.boards.left, chosen.boards.right
    board = board_in(both, see)
    way = possible_way(*both, facts.taken, choice.pair_boards_by)
    boards = photographs_of(folder, *both, paths, facts, way, SHARPEST)
    if board is None:
        raise InputError(
            f"{folder}: no checkerboard, ChArUco board or grid of circles is recognised in {boards}; "
            "name others with --boards"
        )
    return Found(photos, boards, board)


def _with_places(folder: Path, found: Found, say: Say) -> Found:
    """The findings with the region, the caliper table and the extensometer."""
    region = next((path.name for path in _small_files(folder, {".geojson"})), None)
    caliper = _caliper(folder, len(found.photos.steps))
    if caliper:
        say(f"caliper table: {caliper.name}" + (f", not compared: {caliper.obstacle}" if caliper.obstacle else ""))
    left = [step["left"] for step in found.photos.steps.values()]
    first = _read(left[0])
    for note in Images.read(first).notes.values():
        say(note)
    try:
        gauge = gauge_over(_polygons(folder, first, left, region), left, read_grey)
        say(
            f"load along {gauge.axis}: {gauge.reason}" if gauge else "no extensometer: the region is too narrow for one"
        )
    except StageError as error:
        gauge = None
        say(f"no extensometer: {error}")
    return found._replace(region=region, caliper=caliper, gauge=gauge)


def _read(file: Path | FilePart) -> Product:
    """A photograph as the stage of the photographs reads it."""
    return maker("images")(left="*").run(left=file)


def _polygons(folder: Path, first: Product, left: Sequence[Path | FilePart], region: str | None) -> list[Polygon]:
    """The region that the pipeline measures."""
    if region:
        product = maker("region")(file=region).run(images=first, file_path=folder / region)
    else:
        product = maker("region")().run(images=first, images_early=_Early(left))
    return Region.read(product).polygons


class _Early(Sequence[Product]):
    """Photographs of the steps that follow the first early, each read when it is used."""

    def __init__(self, files: Sequence[Path | FilePart]) -> None:
        self._files = [files[after] for after in EARLY_STEPS if after < len(files)]

    def __len__(self) -> int:
        return len(self._files)

    def __getitem__(self, index: Any) -> Any:
        return _read(self._files[index])


def _calibration(folder: Path) -> str | None:
    """The first file in the folder that holds a calibrated rig."""
    for path in _small_files(folder, _CALIBRATION_SUFFIXES):
        try:
            parse_calibration(path)
        except DicflowError:
            continue
        return path.name
    return None


def _small_files(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """Regular files in the folder with one of these suffixes, not so large that they cannot be what is looked for."""
    files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in suffixes and path.is_file()]
    return [path for path in files if path.stat().st_size <= _MAX_BYTES and _is_text(path.name)]


def _caliper(folder: Path, steps: int) -> Caliper | None:
    """The first table in the folder that holds a caliper's lengths, and whether it fits the steps."""
    node = maker("compare")
    for path in sorted(_small_files(folder, _TABLE_SUFFIXES), key=lambda path: "caliper" not in path.name.lower()):
        try:
            rows = node(caliper=path.name).check(path)["rows"]
        except DicflowError as error:
            if "caliper" in path.name.lower():
                return Caliper(path.name, str(error))
            continue
        return Caliper(path.name, "" if rows == steps else f"{rows} rows, but {steps} steps; write one row per step")
    return None
