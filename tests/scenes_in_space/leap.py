"""A strip that stretches by 60 % from one photograph to the next."""

from __future__ import annotations

from tests.scenes_in_space import strip

SCENE = strip.SCENE._replace(loads=(1.0, 1.6), reported=(1,), jpeg=None)
