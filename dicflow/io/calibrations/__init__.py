"""Calibrations that other programs have made, one module per format.

A format is recognised by what the file holds, not by its name. The rig as a file gives it is a
:class:`~dicflow.io.calibrations.draft.Draft`; checked and with the size of the photographs it becomes a
:class:`~dicflow.io.calibrations.draft.Calibration`. A module of this package, or an entry point of the group
``dicflow.calibrations``, is a format if it has

- ``PROGRAM``: the program that writes the files, as messages name it;
- ``recognises(source)``: whether a :class:`~dicflow.io.calibrations.draft.Source` is such a file;
- ``parse(source)``: the draft. Raises InputError that names the file, the place in it and the remedy;
- ``GENERAL = True`` if it also recognises files of more specific formats, which are then preferred.
"""

from __future__ import annotations

from dicflow.discovery import Registry

__all__ = ["FORMATS", "calibration_modules"]

FORMATS = Registry("calibration format", __name__, "dicflow.calibrations", ("PROGRAM", "recognises", "parse"))


def calibration_modules() -> tuple[str, ...]:
    """Names of the modules of all formats, none of which is imported."""
    return tuple(member.module for member in FORMATS.members())
