"""How true the stated uncertainties are in hard scenes: ``python -m tests.accuracy_scenes [SCENE …] [--set …]``.

Rendered scenes with exact truth are measured with the settings that ``dicflow init`` writes. Neighbouring points share
pixels, so that the share of one photograph's errors within u is a matter of chance: every scene is photographed with
several draws of its noise, 0, 1, 2 and so on, and the points of all draws count together. Their number is fixed before
anything is measured: so many that the region has 30,000 points in all, and each scene's cracks 3,000 beside them.

For every scene, step and quantity the table has the share of valid points, the shares of their errors within one and
two and beyond three of the stated uncertainties, the standard deviation over the draws of the share within one (±), the
median and the root mean square of the errors, and the same for the points nearer than one subset to an edge, a hole or
a crack. A line per scene then names the quantities that are furthest from their bars.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence

from tests.bars import Figure, print_figures
from tests.measured_scenes import QUANTITIES, Measured, measured_scene, row
from tests.scene_bars import scene_figures, worst
from tests.scenes_in_space import SCENES

__all__ = ["scenes"]

_COLUMNS = f"{'valid':>7}{'1u':>7}{'±':>6}{'2u':>6}{'> 3u':>7}{'u':>10}{'bias':>10}{'rms':>10}"
_HEADING = f"{'scene':<15}step     {'points':>7}{_COLUMNS}{'rims':>8}{_COLUMNS}"


def scenes(names: Sequence[str] = SCENES, settings: Sequence[str] = ()) -> Iterator[Figure]:
    """Print the table and a line per scene; give the figures of every scene."""
    print(f"\nscenes in space; u as stated, errors in µm and µε\n{_HEADING}")
    lines = []
    for name in names:
        found = measured_scene(name, settings)
        for step, points in found.steps.items():
            print_step(name, step, points)
        lines.append(summary(name, found.steps))
        yield from scene_figures(name, found)
    print("\nfurthest from 68 %, from 95 %, and most beyond 3u", *lines, sep="\n")


def print_step(name: str, step: int, points: Measured) -> None:
    """Print a line per quantity."""
    for quantity in QUANTITIES:
        parts = [row(points, quantity), row(points.of(points.on_rim), quantity)]
        text = "".join(
            f"{r.points:8}{r.valid:7.1f}{r.within_1:7.1f}{r.spread:6.1f}{r.within_2:6.1f}{r.beyond_3:7.2f}"
            f"{r.stated:10.4g}{r.bias:10.3g}{r.rms:10.4g}"
            for r in parts
        )
        print(f"{name:<15}{step:>3} {quantity:<4}{text}", flush=True)


def summary(name: str, steps: dict[int, Measured]) -> str:
    """One line: the least share of valid points, and what is furthest from each bar of coverage."""
    if not steps:
        return f"{name:<15} not measured"
    least = min(100.0 * points.valid.mean() for points in steps.values())
    parts = [
        f"{criterion.words} {share:6.2f} % ({quantity}, step {step})"
        for criterion, share, quantity, step in worst(steps)
    ]
    return f"{name:<15} valid ≥ {least:5.1f} %; " + "; ".join(parts)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}; all by default")
    parser.add_argument("--set", action="append", default=[], metavar="STAGE.PARAMETER=VALUE", help="another setting")
    given = parser.parse_args()
    return print_figures(scenes(given.scenes or SCENES, given.set))


if __name__ == "__main__":
    sys.exit(main())
