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

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dicflow.core.synthetic.render import add_noise_and_round, render_strip
from dicflow.core.synthetic.stand import in_right_frame
from dicflow.io.rig import write_rig
from dicflow.synth.experiment import Experiment, sample_experiment
from dicflow.synth.pictures import LOOKS, SIDES, Progress, outline_text, take_board, write_photographs
from dicflow.synth.truth import board_truth, field_truth, length_rows, region_outline

__all__ = ["Photograph", "photographs", "take", "write_experiment", "write_sample"]


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
    _write_tables(folder, experiment)
    pictures = {picture.name: partial(take, experiment, picture) for picture in photographs(experiment)}
    write_photographs(folder, pictures, workers, on_progress)


def write_sample(folder: Path, on_progress: Progress | None = None) -> None:
    """Write the reduced experiment of ``data_samples``."""
    write_experiment(folder, sample_experiment(), on_progress=on_progress)


def photographs(experiment: Experiment) -> Iterator[Photograph]:
    """All pictures of an experiment, steps before boards."""
    for side, name in enumerate(SIDES):
        for step in range(len(experiment.deformations)):
            yield Photograph(f"photos/{name}/step_{step:02d}.png", "strip", side, step)
    for side, name in enumerate(SIDES):
        for pair in range(len(experiment.poses)):
            yield Photograph(f"boards/{name}/board_{pair:02d}.png", "board", side, pair)


def take(experiment: Experiment, picture: Photograph) -> np.ndarray:
    """Take one picture: (height, width) uint8."""
    rig, side, number = experiment.stand.rig, picture.side, picture.number
    seed = [experiment.seed, int(picture.subject == "board"), side, number]
    if picture.subject == "board":
        return take_board(rig, experiment.poses[number], experiment.board, side, experiment.noise, seed)
    camera, state = (rig.left, rig.right)[side], experiment.deformations[number]
    state = in_right_frame(rig, state) if side else state
    image = render_strip(camera, state, experiment.speckles, experiment.overhang, LOOKS[side])
    return add_noise_and_round(image, experiment.noise, seed)


def _write_tables(folder: Path, experiment: Experiment) -> None:
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    (folder / "caliper.csv").write_text(_caliper_text(experiment), encoding="utf-8")
    (folder / "region.geojson").write_text(outline_text(region_outline(experiment)), encoding="utf-8")
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
