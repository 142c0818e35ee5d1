"""The report as a person sees it: in a browser, light and dark, on a desk, on a phone and on paper."""

from pathlib import Path

import pytest
from browser import chromium, opened

pytestmark = pytest.mark.skipif(chromium() is None, reason="needs chromium on the PATH")

PICTURES = Path(__file__).resolve().parents[1] / "build" / "report"
"""For a person's eyes."""


@pytest.fixture(scope="module")
def report(pipeline, measured):
    return pipeline.parent / "results" / "quickstart" / "report.html"


@pytest.fixture(scope="module")
def page(report, tmp_path_factory):
    with opened(tmp_path_factory.mktemp("browser")) as page:
        page.window(1200, 900)
        yield page


@pytest.fixture
def shown(page, report):
    page.open(report)
    return page


def test_it_asks_nobody_and_complains_of_nothing(shown, report):
    assert shown.requests() == [report.resolve().as_uri()]
    assert shown.complaints() == []


def test_a_key_moves_the_step_and_keeps_the_colours(shown):
    first = shown.explorer()
    assert first["photo"].startswith("data:image/jpeg")
    shown.evaluate("document.querySelector('.x-stage').focus()")
    shown.press("ArrowLeft")
    second = shown.explorer()
    assert first["step"] != second["step"]
    assert first["map"] != second["map"]
    assert first["photo"] != second["photo"]
    assert (first["title"], first["bar"]) == (second["title"], second["bar"])
    assert shown.complaints() == []


def test_every_quantity_and_place_has_its_field(shown):
    count = shown.evaluate("document.querySelector('.x-quantity').length")
    seen, titles = set(), set()
    for over in ("step", "first"):
        for number in range(count):
            shown.evaluate(
                f"document.querySelector('.explorer').explorer.change({{ quantity: {number}, over: '{over}' }})"
            )
            seen.add(shown.explorer()["map"])
            titles.add(shown.explorer()["title"])
    assert len(seen) == 2 * count
    assert len(titles) == count
    assert shown.complaints() == []


def test_directions_are_drawn_if_asked_for_and_follow_the_step(shown):
    path = "document.querySelector('.x-direction')?.getAttribute('d')"
    change = "document.querySelector('.explorer').explorer.change"
    assert not shown.evaluate(path)
    shown.evaluate(f"{change}({{ directions: true }})")
    last = shown.evaluate(path)
    shown.evaluate(f"{change}({{ step: 0 }})")
    first = shown.evaluate(path)
    shown.evaluate(f"{change}({{ over: 'first' }})")
    assert len({last, first, shown.evaluate(path)} - {None, ""}) == 3


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1200, 390])
def test_nothing_overlaps_or_sticks_out(shown, width, dark):
    shown.window(width, 900, dark)
    shown.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true })")
    PICTURES.mkdir(parents=True, exist_ok=True)
    (PICTURES / f"report_{width}_{'dark' if dark else 'light'}.png").write_bytes(shown.picture())
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    assert shown.overlaps() == []
    assert shown.cut() == []
    brightness = "getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).slice(0, 3).map(Number)"
    assert (max(shown.evaluate(brightness)) < 100) == dark


def test_paper_has_the_field_with_its_numbers(shown):
    shown.window(1200, 900)
    printed = shown.printed()
    assert printed.count(b"/Type /Page\n") >= 2
    PICTURES.mkdir(parents=True, exist_ok=True)
    (PICTURES / "report.pdf").write_bytes(printed)
