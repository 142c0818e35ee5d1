"""Scenes with exact truth in space: a specimen in closed form, photographed by two cameras, one file per scene.

``SCENES`` lists them by name; :func:`scene` loads one. Add a scene as a module with a ``SCENE`` and its name here.
"""

from __future__ import annotations

import importlib

from tests.scenes_in_space.specimen import Scene

__all__ = ["SCENES", "scene"]

SCENES = (
    "gentle", "tilt", "nod", "bend", "strip", "hole", "crack", "blur", "compression", "leap", "light", "sensor",
    "meeting_cracks", "bead", "twist", "bulge", "fastener", "shear_band", "mixed_mode", "inner_crack", "hairline",
)  # fmt: skip
"""Names of all scenes."""


def scene(name: str) -> Scene:
    """The scene of a name, one of :data:`SCENES`."""
    found: Scene = importlib.import_module(f"tests.scenes_in_space.{name}").SCENE
    return found
