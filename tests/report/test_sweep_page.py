"""The section of a sweep of 60 variants: noise against resolution, a table to be sorted, a page of few screens."""

import re
from pathlib import Path

import pytest
from markupsafe import Markup

from dicflow.report.context import Section
from dicflow.report.rendering import assets, render
from dicflow.report.resolution import resolution_chart, resolutions
from dicflow.report.sweep import sweep
from tests.browser import chromium, opened
from tests.report.swept import SIDES, Swept, context_of_sweep, sigma

PICTURES = Path(__file__).resolve().parents[2] / "build" / "report"
"""For a person's eyes."""
ORDER = "[...document.querySelectorAll('.sortable tbody tr')].map((row) => row.cells[{}].textContent)"


def column(page, number):
    return page.evaluate(ORDER.format(number))


@pytest.fixture(scope="module")
def section(tmp_path_factory):
    return sweep(context_of_sweep(Swept(), tmp_path_factory.mktemp("swept")))


@pytest.fixture(scope="module")
def page(section, tmp_path_factory):
    """The section alone, and another one that is folded away."""
    if chromium() is None:
        pytest.skip("needs chromium on the PATH")
    values = {
        "title": "Sweep",
        "subtitle": "60 variants",
        "logo": "",
        "version": "0",
        "appendix": (),
        "paper_title": "",
    }
    values |= {"folded": {"other"}, "sections": [section, Section("other", "Other", Markup("<p>inside</p>"))]}
    path = tmp_path_factory.mktemp("page") / "sweep.html"
    path.write_text(render("page.html", style=assets(".css"), script=assets(".js"), **values))
    with opened(tmp_path_factory.mktemp("browser")) as page:
        page.window(1280, 900)
        page.open(path)
        yield page


def test_resolution_and_noise_are_those_of_the_products():
    found = resolutions(Swept())
    for one, (subset, window) in zip(found, SIDES, strict=True):
        assert (one.side, one.unit, one.measured) == ((subset + window) / 20.0, "mm", False)
        assert one.sigma == {"exx": sigma(subset, window), "eyy": 1.2 * sigma(subset, window)}


def test_the_chart_has_a_named_mark_per_variant_and_strain():
    chart = resolution_chart(resolutions(Swept()), [f"#{k + 1}" for k in range(len(SIDES))])
    titles = re.findall(r"<title>(#\d+)</title>", chart)
    assert titles == 2 * [f"#{k + 1}" for k in range(len(SIDES))]
    assert "virtual strain gauge [mm]" in chart
    assert "σ of the strain [–]" in chart
    places = [float(x) for x in re.findall(r'cx="([\d.]+)"', chart)[: len(SIDES)]]
    order = sorted(range(len(SIDES)), key=lambda k: sum(SIDES[k]))
    assert [places[k] for k in order] == sorted(places)


@pytest.mark.parametrize("result", [Swept(form="thesis"), Swept(sides=((15, 20), (20, 15)))])
def test_without_gauges_that_differ_there_is_no_chart(result):
    assert resolution_chart(resolutions(result), ["#1"] * len(result.sides)) is None


def test_the_table_has_gauge_and_scalars_of_each_variant(section):
    assert section.body.count("<tr>") >= len(SIDES)
    assert "virtual strain gauge [mm]" in section.body
    assert "total.points" in section.body.partition("not differ")[2]


@pytest.mark.parametrize("width", [1280, 390])
def test_a_page_of_sixty_variants_is_a_few_screens_high(page, width):
    page.window(width, 900)
    PICTURES.mkdir(parents=True, exist_ok=True)
    (PICTURES / f"sweep-{width}.png").write_bytes(page.picture())
    assert page.evaluate("document.documentElement.scrollHeight") < 4000
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.overlaps() == []
    assert page.cut() == []
    page.window(1280, 900)


def test_a_press_sorts_by_numbers_and_again_the_other_way(page):
    names = page.evaluate("[...document.querySelectorAll('.sortable th')].map((title) => title.textContent)")
    place = names.index("total.sigma_eyy")
    press = f"document.querySelectorAll('.sortable th button')[{place}].click()"
    page.evaluate(press)
    expected = sorted(range(len(SIDES)), key=lambda k: sigma(*SIDES[k]))
    assert column(page, 0) == [f"#{k + 1}" for k in expected]
    page.evaluate(press)
    assert column(page, 0)[0] == f"#{expected[-1] + 1}"
    assert page.evaluate("document.querySelectorAll('.sortable th[aria-sort]').length") == 1


def test_the_keyboard_sorts_too(page):
    page.evaluate("document.querySelector('.sortable th button').focus()")
    for kind in ("rawKeyDown", "char", "keyUp"):
        page.send("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r")
    assert column(page, 0) == [f"#{k + 1}" for k in range(len(SIDES))]
    assert page.complaints() == []


def test_a_link_unfolds_what_it_leads_to(page):
    is_open = "document.querySelector('#other > details').open"
    assert not page.evaluate(is_open)
    page.evaluate(
        "document.querySelector('nav a[href=\"#other\"]').click(), new Promise((done) => setTimeout(done, 200))"
    )
    assert page.evaluate(is_open)
