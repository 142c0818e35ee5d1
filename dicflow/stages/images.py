"""Photographs of one or two cameras, one product per step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.files import FilePart
from dicflow.engine.node import InputFile, Node, Scope, Seconds, Steps, parameter
from dicflow.engine.product import Product
from dicflow.errors import InputError
from dicflow.kinds.images import Images as Photographs
from dicflow.stages._selection import MOVED_PX, Place, Select

if TYPE_CHECKING:
    from dicflow.io.images import Photograph

__all__ = ["Images"]

_Fact = Mapping[str, Any]
_Facts = Mapping[Path | FilePart, _Fact]
_NAMED = 3


class Images(Node):
    """Read the photographs as grey levels.

    One step per left photograph, named by its stem; no two may share one. Those of a pattern follow in natural order of
    the names, those of a list as they are listed. Each page of a TIFF is a step of its own, and each frame of an
    animated PNG or a video. With ``right`` the photographs are paired by the numbers in their names, or by the times
    in them, and frames of two videos by their times, once ``offset`` has joined the clocks. ``select`` chooses among
    the steps.

    Photographs are measured as the sensor lies; orientation tags are ignored unless ``orientation`` is upright.
    Transparent pixels are not measured.
    """

    title: ClassVar = "read photographs"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "images"
    impl_version: ClassVar = 3
    is_quick: ClassVar = True

    stage: Literal["images"] = "images"
    left: str | list[str] = parameter(
        ..., "photographs of the left camera: a pattern such as left/*.png, or a list", affects="speed"
    )
    right: str | list[str] | None = parameter(
        None, "photographs of the right camera; absent for a measurement with one camera", affects="speed"
    )
    pair_by: Literal["name", "time", "order"] | None = parameter(
        None,
        "what makes pairs: numbers and words in the names, the nearest times in them, or the order; absent: the names, "
        "and times where numbers never agree",
        affects="speed",
    )
    unpaired: Literal["refuse", "skip"] = parameter(
        "refuse", "photographs without a partner: an error, or left out with their step", affects="speed"
    )
    orientation: Literal["sensor", "upright"] | None = parameter(
        None,
        "orientation tags: ignored (sensor), or followed (upright); absent: ignored, and photographs with different "
        "tags are refused",
    )

    offset: Literal["auto"] | Seconds = parameter(
        "auto",
        "when the first frame of the right video was taken, since the first of the left one; auto finds it from what "
        "both cameras saw",
        unit="s",
        affects="speed",
    )
    select: Literal["auto"] | Select | None = parameter(
        None, f"which steps are measured; auto: one whenever something has moved by {MOVED_PX:g} px", affects="speed"
    )
    reference: Place | None = parameter(
        None, "the step, by number or time, that all others are compared with; absent: the first", affects="speed"
    )
    times: InputFile | None = parameter(
        None, "table of times [s] by name of the file or number of the frame; absent: those of the video, or of EXIF"
    )
    time: Literal["file", "name"] = parameter(
        "file", "where a photograph's time is, without a table: in its file, or the last number in its name [s]"
    )

    def searches(self, folder: Path) -> tuple[Path, ...]:
        from dicflow.io.images import search_start

        patterns = [
            one for side in (self.left, self.right or []) for one in ([side] if isinstance(side, str) else side)
        ]
        return tuple(search_start(folder, pattern)[0] for pattern in patterns)

    def finds(self, folder: Path) -> tuple[Path, ...]:
        return tuple(path for files in self._photographs(folder).values() for path in files.values())

    def steps(self, folder: Path) -> Steps:
        return self._steps_of(self._photographs(folder), self.unpaired, folder)

    def steps_so_far(self, folder: Path, is_whole: Callable[[Path], bool]) -> Steps:
        found = self._photographs(folder)
        whole = {side: {name: path for name, path in files.items() if is_whole(path)} for side, files in found.items()}
        return self._steps_of(whole, "skip", folder) if all(whole.values()) else {}

    def _steps_of(
        self, found: Mapping[str, Mapping[str, Path]], unpaired: Literal["refuse", "skip"], folder: Path
    ) -> Steps:
        from dicflow.io.images import steps_of

        listed = isinstance(self.left, list) and isinstance(self.right, list)
        steps = steps_of(found["left"], found.get("right"), self.pair_by, unpaired, listed, self._offset)
        return self._selected(steps, folder)

    def _selected(self, steps: Steps, folder: Path) -> Steps:
        from dicflow.io.images import Selection, read_times, selected

        if self.select is None and self.reference is None:
            return steps
        auto = Selection(moved=MOVED_PX) if self.select == "auto" else Selection()
        selection = self.select.selection() if isinstance(self.select, Select) else auto
        table = None if self.times is None else read_times(folder / self.times)
        return selected(steps, selection, partial(self._moment, table=table), self.reference)

    def _moment(self, file: Path | FilePart, table: Mapping[str, float] | None) -> float | None:
        from dicflow.io.images import moment_of

        return moment_of(file, self.time == "name", table)

    @property
    def _offset(self) -> float | None:
        return None if self.offset == "auto" else self.offset

    def left_out(self, folder: Path, steps: Steps) -> tuple[str, ...]:
        from dicflow.io.images import video_sentences

        found = self._photographs(folder)
        sentences = tuple(video_sentences(found["left"], found.get("right"), self._offset))
        return sentences if self.right is None or self.select is not None else (*sentences, *_alone(found, steps))

    def _photographs(self, folder: Path) -> dict[str, dict[str, Path]]:
        """Left and right → file name → file."""
        from dicflow.io.images import find_photographs

        patterns = {"left": self.left, "right": self.right}
        return {side: find_photographs(folder, given, side) for side, given in patterns.items() if given is not None}

    def check(self, path: Path | FilePart) -> dict[str, Any]:
        from dicflow.io.images import probe, read_times

        if self._is_table(path):
            return {"rows": len(read_times(Path(path)))}
        return probe(path)

    def _is_table(self, path: Path | FilePart) -> bool:
        return self.times is not None and isinstance(path, Path) and path.name == Path(self.times).name

    def agree(
        self,
        facts: _Facts,
        steps: Steps,
        inputs: Mapping[str, tuple[str, ...]],
    ) -> None:
        if self.orientation is None:
            _check_tags({file: fact for file, fact in facts.items() if not self._is_table(file)})
        cameras = [
            {files[side]: self._as_measured(facts[files[side]]) for files in steps.values() if side in files}
            for side in ("left", "right")
        ]
        for camera in cameras:
            _check_camera(camera)
        _check_depth(*(next(iter(camera.items())) for camera in cameras if camera))

    def run(
        self, left: Path | FilePart, right: Path | FilePart | None = None, times_path: Path | None = None
    ) -> Product:
        from dicflow.io.images import read_photograph, read_times, turned_upright, utc_offset_of

        photographs = {side: read_photograph(file) for side, file in (("left", left), ("right", right)) if file}
        turn = turned_upright if self.orientation == "upright" else lambda image, _: image
        grey = {side: turn(one.grey, one.orientation) for side, one in photographs.items()}
        counts = {s: turn(one.counts, one.orientation) for s, one in photographs.items() if one.counts is not None}
        notes = {side: note for side, one in photographs.items() if (note := self._note(one))}
        table = None if times_path is None else read_times(times_path)
        time, utc_offset = self._moment(left, table), utc_offset_of(left, self.time == "name", table)
        return Photographs.write(grey["left"], grey.get("right"), "images", counts, notes, time, utc_offset)

    def _note(self, photograph: Photograph) -> str:
        """Which way up the pixels count; empty without an orientation tag."""
        from dicflow.io.images import orientation_sentence

        height, width = photograph.grey.shape
        return orientation_sentence(photograph.orientation, width, height, self.orientation == "upright")

    def _as_measured(self, fact: _Fact) -> _Fact:
        """Facts of a photograph with the width and height that it has when it is measured."""
        from dicflow.io.images import upright_size

        if self.orientation != "upright":
            return fact
        width, height = upright_size(fact["orientation"], fact["width"], fact["height"])
        return {**fact, "width": width, "height": height}


def _alone(found: Mapping[str, Mapping[str, Path]], steps: Steps) -> tuple[str, ...]:
    """The sentence about photographs that are in no step, if there are any."""
    listed = (file for files in steps.values() for file in files.values())
    used = {file.path if isinstance(file, FilePart) else file for file in listed}
    alone = [f"{side} {name}" for side, files in found.items() for name, path in files.items() if path not in used]
    lacking = (
        "1 photograph has no partner, and its step is"
        if len(alone) == 1
        else f"{len(alone)} photographs have no partner, and their steps are"
    )
    problem = f"{lacking} left out: {_named(alone)}"
    return (f"{problem}; add the missing ones to measure these steps",) if alone else ()


def _check_tags(facts: _Facts) -> None:
    """Raise InputError if the orientation tags of photographs differ."""
    tags: dict[int, dict[str, None]] = {}
    for file, fact in facts.items():
        path = file.path if isinstance(file, FilePart) else file
        tags.setdefault(fact["orientation"], {})[str(path)] = None
    if len(tags) > 1:
        common, *_, rare = sorted(tags, key=lambda tag: (-len(tags[tag]), tag))
        raise InputError(
            f"{_named(list(tags[rare]))}: tagged as rotated (orientation {rare}) otherwise than "
            f"{next(iter(tags[common]))} (orientation {common}); set orientation: sensor to ignore the tags, if the "
            "cameras did not turn, or orientation: upright to turn every photograph as its tag says"
        )


def _check_camera(facts: _Facts) -> None:
    """Raise InputError if the photographs of one camera differ in size or depth, or are a raw mosaic."""
    first = next(iter(facts), None)
    for file, fact in facts.items():
        assert first is not None
        if any(fact[name] != facts[first][name] for name in ("width", "height", "bits")):
            raise InputError(
                f"{file}: {_size(fact)}, but {Path(first).name} has {_size(facts[first])}; "
                "all photographs of one camera must have one size and depth"
            )
    if first is not None and facts[first]["mosaic"]:
        raise InputError(
            f"{first}: a raw mosaic of colour filters ({facts[first]['mosaic']}): neighbouring pixels saw different "
            "colours; convert the photographs to colour or grey first (demosaic them)"
        )


def _check_depth(left: tuple[Path | FilePart, _Fact], right: tuple[Path | FilePart, _Fact] | None = None) -> None:
    """Raise InputError if the photographs of two cameras differ in depth. left, right : the first ones, with facts"""
    if right is not None and left[1]["bits"] != right[1]["bits"]:
        raise InputError(
            f"{right[0]}: {_size(right[1])}, but {left[0]} has {_size(left[1])}; both cameras must have one depth"
        )


def _named(names: Sequence[str]) -> str:
    """The first few names, and how many more."""
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")


def _size(fact: _Fact) -> str:
    return f"{fact['width']} × {fact['height']} px at {fact['bits']} bit"
