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


def test_the_slider_moves_the_map_and_keeps_its_colours(shown):
    first = shown.viewer()
    assert first["photo"].startswith("data:image/jpeg")
    shown.evaluate("document.querySelector('.viewer .step').focus()")
    shown.press("ArrowLeft")
    second = shown.viewer()
    assert first["step"] != second["step"]
    assert first["map"] != second["map"]
    assert first["photo"] != second["photo"]
    assert (first["title"], first["bar"]) == (second["title"], second["bar"])
    assert shown.complaints() == []


def test_every_quantity_and_place_has_its_map(shown):
    count = shown.evaluate("document.querySelector('.viewer .quantity').length")
    seen = set()
    for place in ("deformed", "reference"):
        shown.evaluate(f"document.querySelector('.viewer [value={place}]').click()")
        for number in range(count):
            change = f"(q => {{ q.value = {number}; q.dispatchEvent(new Event('input', {{bubbles: true}})) }})"
            shown.evaluate(f"{change}(document.querySelector('.viewer .quantity'))")
            seen.add(shown.viewer()["map"])
    assert len(seen) == 2 * count
    shown.evaluate("document.querySelector('.viewer [value=reasons]').click()")
    reasons = shown.viewer()
    assert reasons["title"] == "Reasons for missing points"
    assert reasons["map"] not in seen


def test_directions_follow_the_slider(shown):
    drawn = "!document.querySelector('.viewer .directions').hasAttribute('hidden')"
    path = "document.querySelector('.directions path').getAttribute('d')"
    assert not shown.evaluate(drawn)
    shown.evaluate("document.querySelector('.viewer .lines').click()")
    assert shown.evaluate(drawn)
    last = shown.evaluate(path)
    shown.evaluate("document.querySelector('.viewer .step').focus()")
    shown.press("ArrowLeft")
    first = shown.evaluate(path)
    shown.evaluate("document.querySelector('.viewer [value=reference]').click()")
    assert len({last, first, shown.evaluate(path)}) == 3
    shown.evaluate("document.querySelector('.viewer [value=reasons]').click()")
    assert not shown.evaluate(drawn)


def test_every_quantity_leads_to_a_full_map(shown):
    count = shown.evaluate("document.querySelector('.viewer .quantity').length")
    link = "!document.querySelector('.viewer .full').hidden && document.querySelector('.viewer .full a').href"
    picture = "!document.querySelector('.viewer .full-map').hidden && document.querySelector('.full-map img').src"
    ways = []
    for number in range(count):
        change = f"(q => {{ q.value = {number}; q.dispatchEvent(new Event('input', {{bubbles: true}})) }})"
        shown.evaluate(f"{change}(document.querySelector('.viewer .quantity'))")
        ways.append((shown.evaluate(link), shown.evaluate(picture)))
    assert [bool(beside) + bool(inside) for beside, inside in ways] == [1] * count
    assert len({beside or inside for beside, inside in ways}) == count
    assert shown.complaints() == []


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


def test_paper_has_the_first_the_shown_and_the_last_step(shown):
    shown.window(1200, 900)
    printed = shown.printed()
    assert printed.count(b"/Type /Page\n") >= 2
    PICTURES.mkdir(parents=True, exist_ok=True)
    (PICTURES / "report.pdf").write_bytes(printed)
    assert shown.evaluate("document.querySelectorAll('.sheet img').length") >= 4
