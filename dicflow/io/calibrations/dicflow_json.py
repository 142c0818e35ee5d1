"""dicflow's own calibrations: JSON as :mod:`dicflow.io.rig` writes it."""

from __future__ import annotations

from dicflow.io.calibrations.draft import Draft, DraftCamera, Source
from dicflow.io.rig import read_covariance, read_rig

__all__ = ["PROGRAM", "parse", "recognises"]

PROGRAM = "dicflow (JSON)"


def recognises(source: Source) -> bool:
    """Whether the file is a JSON object with a rig's entries."""
    text = source.text.lstrip()
    return text.startswith("{") and '"rotation"' in text and '"left"' in text


def parse(source: Source) -> Draft:
    """The rig that the file holds, and its covariance."""
    rig, covariance = read_rig(source.path), read_covariance(source.path)
    cameras = DraftCamera(*rig.left), DraftCamera(*rig.right)
    return Draft(PROGRAM, *cameras, rig.rotation, rig.translation, covariance=covariance)
