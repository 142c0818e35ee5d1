"""The gentle scene with noise that grows with the grey level, σ² = 0.5 + 0.06 g."""

from __future__ import annotations

from tests.scenes_in_space import gentle

SCENE = gentle.SCENE._replace(noise=(0.5, 0.06))
