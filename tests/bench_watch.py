"""A folder that is fed and watched: whether the products are those of a run, and how long a value takes.

``python -m tests.bench_watch [PAIRS]`` writes a pair of small photographs per second, some of them half at first, some
late, and compares all products with those of a run afterwards. Then it lays pairs of 5 megapixels with 12,000 points,
one at a time, and says how long the values take, with two workers.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from statistics import median

from dicflow.pipeline import Pipeline
from tests.bars import Figure
from tests.fed_folder import Arrival, feed, pairs, watched, write_pipeline
from tests.figures import fresh, report

__all__ = ["figures"]

PAIRS, INTERVAL_S = 100, 1.0
PAUSE_S, LATE_S = 0.4, 0.6


def figures(count: int = PAIRS) -> Iterator[Figure]:
    """Products that differ from those of a run, and the time from a small photograph to its value [s]."""
    folder = fresh("bench_watch")
    pipeline = write_pipeline(folder / "watched")
    arrivals = list(_arrivals(pairs(folder / "watched", count)))
    result, measured, _ = watched(pipeline, lambda: feed(arrivals), count, workers=2)
    other = Pipeline.load(pipeline, store=folder / "other").run(scheduler="sync", workers=1)
    found, expected = ({name: ref.digest for name, ref in one.refs.items()} for one in (result, other))
    differing = [name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name)]
    yield Figure("products of a watch unlike those of a run", len(differing), 0)
    yield Figure("steps measured", len({one.step for one in measured}), count, at_least=True)
    yield Figure("value after a small photograph, median", median(one.after_s for one in measured), unit="s")


def _arrivals(taken: Sequence[tuple[Arrival, Arrival]]) -> Iterator[Arrival]:
    """A pair per interval; of each third one the left photograph is half at first, of each fifth the right one late."""
    for number, (left, right) in enumerate(taken):
        pause_s = PAUSE_S if number % 3 == 1 else 0.0
        late_s = LATE_S if number % 5 == 2 else 0.0
        yield left._replace(after_s=INTERVAL_S - pause_s - late_s, pause_s=pause_s)
        yield right._replace(after_s=late_s)


if __name__ == "__main__":
    sys.exit(report(figures(*map(int, sys.argv[1:]))))
