"""A tensile test as two cameras film it whose clocks and frame rates differ, with exact truth."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.deformation import Deformation, moved_rigidly, position
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, render_board, render_strip
from dicflow.core.synthetic.speckle import Speckles, scatter_speckles
from dicflow.core.synthetic.stand import Stand, board_poses, in_right_frame, verged_stand
from dicflow.io.images.quiet import quiet

__all__ = [
    "DURATION",
    "FIELD",
    "LENGTH",
    "SIDES",
    "SQUARE",
    "START",
    "WIDTH",
    "Film",
    "film",
    "write_boards",
    "write_video",
    "write_videos",
    "write_videos_of_boards",
]

SIZE, FIELD = (480, 360), 60.0
LENGTH, WIDTH, OVERHANG = 44.0, 40.0, 4.0
SQUARE = 4.5
SIDES = ("left", "right")
LOOKS = (GreyLevels(), GreyLevels(paper=205.0))
START, DURATION, STRAIN = 1.5, 16.0, 0.05
"""When the load begins to rise [s], how long it takes [s], and the strain in the end."""
SWAY_MM, SWAY_HZ = 0.06, (0.31, 0.83)


class Film(NamedTuple):
    """What both cameras film.

    offset : when the right one begins, after the left one [s]
    board : held before the cameras, its edges blurred by 1.3 px
    """

    stand: Stand
    speckles: Speckles
    board: Checkerboard
    offset: float

    def state(self, time: float) -> Deformation:
        """The strip, in the left camera's frame; time since the left video's first frame [s]."""
        share = np.clip((time - START) / DURATION, 0.0, 1.0)
        stretch = 1.0 + STRAIN * share**1.5
        sway = SWAY_MM * np.array([np.sin(2.0 * np.pi * f * time + f) * min(time, 1.0) for f in (*SWAY_HZ, 0.47)])
        shift = np.array([0.0, -0.5 * LENGTH * (1.0 + 0.5 * STRAIN), 0.0]) + sway
        strip = Deformation(LENGTH, WIDTH, stretch, inhomogeneity=0.0, bulge=-0.4, translation=shift)
        return moved_rigidly(strip, self.stand.rotation, self.stand.translation)

    def take(self, side: int, time: float, noise: float, number: int) -> np.ndarray:
        """The frame (row, col) uint8 of one camera, left 0 and right 1."""
        camera = (self.stand.rig.left, self.stand.rig.right)[side]
        state = in_right_frame(self.stand.rig, self.state(time)) if side else self.state(time)
        image = render_strip(camera, state, self.speckles, OVERHANG, LOOKS[side], order=2)
        return add_noise_and_round(image, noise, [7, side, number])

    def strain(self, time: float, first: float, ends: np.ndarray) -> float:
        """Engineering strain between two material points (2, 2) [mm] from one time to another."""
        before, after = (np.linalg.norm(np.diff(position(self.state(t), ends), axis=0)) for t in (first, time))
        return float(after / before - 1.0)


def film(offset: float = 0.37, size: tuple[int, int] = SIZE) -> Film:
    """The scene.

    offset : when the right camera begins, after the left one [s]
    size : (width, height) of the pictures [px]
    """
    pixel = FIELD / size[1]
    speckles = scatter_speckles((WIDTH, LENGTH), (4.0 * pixel, 7.0 * pixel), 1.2 * pixel, seed=2)
    return Film(verged_stand(size, FIELD), speckles, Checkerboard(9, 6, square=SQUARE, edge=1.3 * pixel), offset)


def write_videos(
    folder: Path,
    scene: Film,
    frames: tuple[int, int],
    rates: tuple[float, float],
    codec: str = "mp4v",
    noise: float = 1.5,
    suffix: str = ".mp4",
) -> None:
    """Write left.mp4 and right.mp4. frames, rates : of the left and of the right camera [1, 1/s]"""
    for side, name in enumerate(SIDES):
        begin = side * scene.offset
        pictures = (scene.take(side, begin + k / rates[side], noise, k) for k in range(frames[side]))
        write_video(folder / f"{name}{suffix}", pictures, rates[side], codec)


def write_video(path: Path, pictures, rate: float, codec: str = "mp4v") -> None:
    """Write pictures (row, col) uint8 as a video."""
    writer = None
    with quiet():
        for picture in pictures:
            if writer is None:
                code, size = cv2.VideoWriter.fourcc(*codec), picture.shape[::-1]
                writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, rate, size)
                assert writer.isOpened(), f"this OpenCV writes no {codec}"
            writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        writer.release()


def write_boards(folder: Path, scene: Film, count: int = 14) -> None:
    """Write photographs of the board, boards/left/board_00.png and so on."""
    for k, pose in enumerate(poses(scene, count)):
        for side, name in enumerate(SIDES):
            (folder / "boards" / name).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / "boards" / name / f"board_{k:02d}.png"), take_board(scene, pose, side, k))


def write_videos_of_boards(folder: Path, scene: Film, count: int, rates: tuple[float, float]) -> None:
    """Write left.mp4 and right.mp4 of a board that is held still for 0.6 s in each place, and moved in 0.4 s."""
    held = poses(scene, count)
    for side, name in enumerate(SIDES):
        times = side * scene.offset + np.arange(round(rates[side] * (count - 1.5))) / rates[side]
        pictures = (take_board(scene, moving(held, time), side, k) for k, time in enumerate(times))
        write_video(folder / f"{name}.mp4", pictures, rates[side])


def poses(scene: Film, count: int) -> list[Deformation]:
    """Places of the board, in the left camera's frame."""
    return board_poses(scene.stand, scene.board, count, depth=(0.0, 100.0), seed=1)


def moving(held: list[Deformation], time: float) -> Deformation:
    """The board on its way through places, one a second."""
    place, share = int(time), float(np.clip((time % 1.0 - 0.6) / 0.4, 0.0, 1.0))
    one, other = held[place], held[place + 1]
    turn, _ = cv2.Rodrigues(other.rotation @ one.rotation.T)
    rotation = cv2.Rodrigues(share * turn)[0] @ one.rotation
    return one._replace(rotation=rotation, translation=(1.0 - share) * one.translation + share * other.translation)


def take_board(scene: Film, pose: Deformation, side: int, number: int) -> np.ndarray:
    """A picture (row, col) uint8 of the board."""
    camera = (scene.stand.rig.left, scene.stand.rig.right)[side]
    state = in_right_frame(scene.stand.rig, pose) if side else pose
    return add_noise_and_round(render_board(camera, state, scene.board, LOOKS[side], order=2), 1.0, [8, side, number])
