"""A page of a long series: scalars read once and in parts, fields of some steps, and the numbers of all."""

import pytest

from dicflow.engine.product import Product
from dicflow.explorer import reading
from dicflow.explorer.manifest import StepEntry
from dicflow.kinds.maps import Maps, drawn_at
from dicflow.report.answer import _seen
from dicflow.report.context import Context
from dicflow.report.pieces import Pieces
from dicflow.report.step_summaries import step_summaries

COUNT, LOST = 250, 133


class Long:
    """A result of many steps, one of which was not measured. read : steps whose products were read"""

    def __init__(self, count=COUNT):
        self.names, self.read = tuple(f"s{number}" for number in range(count)), []

    def steps(self, stage):
        return self.names

    def has(self, stage, step):
        return step != f"s{LOST}"

    def digest(self, stage, step):
        return f"digest of {step}"

    def product(self, stage, step):
        self.read.append(step)
        number = int(step[1:])
        share = 0.75 if number == 7 else 1.0
        return Product("total", {}, {"summary": {"number": 0.1 * number, "lost": float("nan"), "valid_share": share}})


def context_of(result, folder):
    return Context(None, result, None, Pieces(folder, "code"), folder)


def test_scalars_of_all_steps_are_read_once_and_of_a_longer_series_in_part(tmp_path):
    result = Long()
    found = step_summaries(context_of(result, tmp_path), "total")
    assert list(found) == [name for name in result.names if name != f"s{LOST}"]
    assert found["s3"]["number"] == 0.1 * 3
    assert found["s3"]["lost"] != found["s3"]["lost"]
    assert len(result.read) == COUNT - 1
    longer = Long(COUNT + 1)
    assert len(step_summaries(context_of(longer, tmp_path), "total")) == COUNT
    assert longer.read == list(longer.names[201:])


def test_the_verdict_counts_steps_that_the_page_does_not_show(tmp_path):
    shown = [StepEntry(name=f"s{number}", valid=1.0) for number in (0, 100, 249)]
    seen = _seen(context_of(Long(), tmp_path), {"stage": "total", "steps": shown})
    assert seen == (COUNT, COUNT - 1, 0.75)


class Source:
    def __init__(self, count):
        self.facts = {"stage": "total"}
        self.steps = [f"s{number}" for number in range(count)]


@pytest.mark.parametrize(
    ("count", "drawn", "expected"),
    [
        (60, range(0, 60, 20), range(60)),
        (250, [0, 17, 249], [0, 17, 249]),
        (250, range(250), [round(k * 249 / 23) for k in range(24)]),
        (250, None, [round(k * 249 / 23) for k in range(24)]),
    ],
)
def test_a_page_shows_the_steps_of_the_maps(monkeypatch, count, drawn, expected):
    """Of a short series all; without maps, or where all have one, evenly chosen ones."""
    maps = None
    if drawn is not None:
        product = Maps.write({}, "xyz", [0.0, 0.0, 1.0, 1.0], "mm", "auto", ["loading"] * count)
        maps = Maps.read(drawn_at(product, list(drawn)))
    monkeypatch.setattr(reading, "maps_of", lambda _result, _stage: maps)
    assert reading._page_steps(None, Source(count)) == [f"s{number}" for number in expected]
