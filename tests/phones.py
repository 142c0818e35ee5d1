"""The photographs of the sample as two phones leave them: JPEG files with EXIF in one folder, each with its names."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

__all__ = ["ALIKE", "UNLIKE", "Phone", "moments", "taken_by_phones"]

SAMPLES = Path(__file__).resolve().parents[1] / "data_samples"
_MODEL, _EXIF, _TIME, _FRACTION = 272, 34665, 36867, 37521


class Phone(NamedTuple):
    """How a phone names its photographs, and what its clock shows more than the right time [s].

    model : empty where a program has taken the metadata away
    """

    model: str
    name: str
    first: int
    ahead_s: float = 0.0


UNLIKE = Phone("iPhone 12", "IMG_{:04}.jpg", 2301), Phone("NIKON D3500", "DSC_{:04}.jpg", 7, 3713.4)
ALIKE = Phone("iPhone 12", "IMG_{:04}.jpg", 2301), Phone("Pixel 7", "IMG_{:04}.jpg", 412, -95.0)


def moments(count: int, seed: int = 5) -> list[float]:
    """Times [s] at which somebody takes photographs: from 8 to 40 s apart."""
    return np.cumsum(np.random.default_rng(seed).uniform(8.0, 40.0, count)).tolist()


def taken_by_phones(
    folder: Path,
    phones: Sequence[Phone] = UNLIKE,
    steps: int = 8,
    boards: int = 12,
    missing: Sequence[int] = (),
    samples: Path = SAMPLES,
) -> Path:
    """Write boards and then the specimen as both phones took them; the right one within half a second of the left one.

    samples : photographs as ``dicflow synth sample`` makes them
    missing : numbers of photographs, from 0, that the right phone did not take; its counter goes on without them
    """
    folder.mkdir(parents=True, exist_ok=True)
    subjects = [("boards", f"board_{k:02}.png") for k in range(boards)]
    subjects += [("photos", f"step_{k:02}.png") for k in range(steps)]
    lags = np.random.default_rng(6).uniform(0.0, 0.5, len(subjects))
    for side, phone in zip(("left", "right"), phones, strict=True):
        number = phone.first
        for k, ((part, name), moment) in enumerate(zip(subjects, moments(len(subjects)), strict=True)):
            if side == "right" and k in missing:
                continue
            when = moment + phone.ahead_s + (lags[k] if side == "right" else 0.0)
            _write(samples / part / side / name, folder / phone.name.format(number), phone, when)
            number += 1
    lines = (samples / "caliper.csv").read_text().splitlines(keepends=True)
    head = next(k for k, line in enumerate(lines) if line.startswith("phase")) + 1
    (folder / "caliper.csv").write_text("".join(lines[: head + steps]))
    return folder


def _write(source: Path, path: Path, phone: Phone, when_s: float) -> None:
    exif = Image.Exif()
    if phone.model:
        moment = datetime(2026, 3, 1, 10, 0) + timedelta(seconds=when_s)
        exif[_MODEL] = phone.model
        exif.get_ifd(_EXIF).update({_TIME: f"{moment:%Y:%m:%d %H:%M:%S}", _FRACTION: f"{moment.microsecond:06}"[:3]})
    with Image.open(source) as image:
        image.save(path, quality=95, exif=exif)
