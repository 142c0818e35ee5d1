"""An experiment as a folder of files, laid out as a user would lay out a real one, with the truth beside it.

::

    photos/left/step_00.png …     photos/right/…
    boards/left/board_00.png …    boards/right/…
    caliper.csv                   phase, load and length at each step
    region.geojson                outline of the speckled region in the first left photograph
    truth/rig.json                the cameras
    truth/fields.npz              points, strains and pixels of a material grid at each step
    truth/boards.npz              pixels of the boards' corners
    truth/lengths.csv             lengths of the speckled region
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, render_board, render_strip
from dicflow.core.synthetic.stand import in_right_frame
from dicflow.io.rig import write_rig
from dicflow.synth.experiment import Experiment, sample_experiment
from dicflow.synth.truth import board_truth, field_truth, length_rows, region_outline

__all__ = ["Photograph", "photographs", "take", "write_experiment", "write_sample"]

Progress = Callable[[int, int, str], None]

_SIDES = ("left", "right")
_LOOKS = (GreyLevels(), GreyLevels(gain=0.96, light=(0.07, -0.09), phase=1.7))
_BOARD_PAPER, _BOARD_INK = 205.0, 34.0
_PNG = (cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)  # noise repeats nothing worth searching for


class Photograph(NamedTuple):
    """One picture of an experiment: of the strip at a step, or of a board.

    name : path inside the experiment's folder
    subject : "strip" or "board"
    side : 0 — left, 1 — right camera
    number : of the step or the board, from 0
    """

    name: str
    subject: str
    side: int
    number: int


def write_experiment(
    folder: Path, experiment: Experiment, workers: int = 1, on_progress: Progress | None = None
) -> None:
    """Write everything; the same experiment gives the same bytes.

    Photographs that an earlier experiment left in the same folder are removed.

    workers : photographs rendered at once, in threads
    on_progress : called after each photograph with the number done, their total, and the name
    """
    folder = Path(folder)
    pictures = list(photographs(experiment))
    _clear(folder, {picture.name for picture in pictures})
    _write_tables(folder, experiment)
    with ThreadPoolExecutor(max_workers=workers) as pool:
        running = {pool.submit(_write_photograph, folder, experiment, each): each for each in pictures}
        for done, future in enumerate(as_completed(running), start=1):
            future.result()
            if on_progress is not None:
                on_progress(done, len(pictures), running[future].name)


def write_sample(folder: Path, on_progress: Progress | None = None) -> None:
    """Write the reduced experiment of ``data_samples``."""
    write_experiment(folder, sample_experiment(), on_progress=on_progress)


def photographs(experiment: Experiment) -> Iterator[Photograph]:
    """All pictures of an experiment, steps before boards."""
    for side, name in enumerate(_SIDES):
        for step in range(len(experiment.deformations)):
            yield Photograph(f"photos/{name}/step_{step:02d}.png", "strip", side, step)
    for side, name in enumerate(_SIDES):
        for pair in range(len(experiment.poses)):
            yield Photograph(f"boards/{name}/board_{pair:02d}.png", "board", side, pair)


def take(experiment: Experiment, picture: Photograph) -> np.ndarray:
    """Take one picture: (height, width) uint8."""
    rig, look = experiment.stand.rig, _LOOKS[picture.side]
    board = picture.subject == "board"
    state = (experiment.poses if board else experiment.deformations)[picture.number]
    camera = (rig.left, rig.right)[picture.side]
    state = in_right_frame(rig, state) if picture.side else state
    if board:
        look = look._replace(paper=_BOARD_PAPER, ink=_BOARD_INK)
        image = render_board(camera, state, experiment.board, look)
    else:
        image = render_strip(camera, state, experiment.speckles, experiment.overhang, look)
    return add_noise_and_round(image, experiment.noise, [experiment.seed, int(board), picture.side, picture.number])


def _write_photograph(folder: Path, experiment: Experiment, picture: Photograph) -> None:
    _, encoded = cv2.imencode(".png", take(experiment, picture), _PNG)
    (folder / picture.name).write_bytes(encoded.tobytes())


def _clear(folder: Path, names: set[str]) -> None:
    """Make the folders, and remove photographs in them that this experiment will not overwrite."""
    for kind, prefix in (("photos", "step"), ("boards", "board")):
        for side in _SIDES:
            place = folder / kind / side
            place.mkdir(parents=True, exist_ok=True)
            for path in place.glob(f"{prefix}_*.png"):
                if path.relative_to(folder).as_posix() not in names:
                    path.unlink()
    (folder / "truth").mkdir(exist_ok=True)


def _write_tables(folder: Path, experiment: Experiment) -> None:
    (folder / "caliper.csv").write_text(_caliper_text(experiment), encoding="utf-8")
    (folder / "region.geojson").write_text(_region_text(experiment), encoding="utf-8")
    write_rig(folder / "truth" / "rig.json", experiment.stand.rig)
    np.savez_compressed(folder / "truth" / "fields.npz", allow_pickle=False, **field_truth(experiment))
    np.savez_compressed(folder / "truth" / "boards.npz", allow_pickle=False, **board_truth(experiment))
    lines = [f"{k},{a:.6f},{b:.6f},{c:.6f}" for k, (a, b, c) in enumerate(length_rows(experiment))]
    header = "step,imposed_mm,chord_mm,along_y_mm"
    (folder / "truth" / "lengths.csv").write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")


def _caliper_text(experiment: Experiment) -> str:
    caliper = experiment.caliper
    rows = zip(caliper.phase, caliper.load_g, caliper.length_mm, strict=True)
    lines = [f"{phase},{load:.2f},{length:.2f}" for phase, load, length in rows]
    comment = "# One row per step: load on the specimen [g], caliper length of the speckled region [mm]."
    return "\n".join([comment, "phase,load_g,length_mm", *lines]) + "\n"


def _region_text(experiment: Experiment) -> str:
    """GeoJSON of the speckled region, its coordinates raw pixels of a photograph."""
    ring = np.round(region_outline(experiment), 3).tolist()
    feature = {
        "type": "Feature",
        "properties": {"frame": "photograph", "name": "speckled region"},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}) + "\n"
