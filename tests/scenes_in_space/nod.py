"""The plate of the tilt, turned about the horizontal: its disparity shears by 24° between the cameras at the end."""

from __future__ import annotations

from tests.scenes_in_space import tilt
from tests.scenes_in_space.specimen import Part, bounds

SCENE = tilt.SCENE._replace(parts=(Part(tilt.turning(1.0, 0.0), bounds(36.0, 28.0)),))
