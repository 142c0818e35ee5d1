"""The explorer of formulas in a browser: what the pointer, the keyboard and the picture say is what was measured."""

from __future__ import annotations

import http.server
import json
import re
import threading
from functools import partial
from importlib import resources

import numpy as np
import pytest

from dicflow.core.status import Status
from dicflow.explorer.pack import pack
from dicflow.explorer.page import NOTEBOOK_PAGE, fragment
from dicflow.views.colours import palette
from tests.explorer.chromium import Tabs
from tests.explorer.waves import Waves, reading_of

pytestmark = pytest.mark.slow  # starts browsers

LAST = 3
"""The step that is shown first."""


def made(sources, make):
    return make()


@pytest.fixture(scope="module")
def waves():
    return Waves()


@pytest.fixture(scope="module")
def packed(waves):
    return pack(reading_of(waves), "waves", made, 7e6)


@pytest.fixture(scope="module")
def address(packed, tmp_path_factory):
    path = tmp_path_factory.mktemp("explorer") / "page.html"
    path.write_text(NOTEBOOK_PAGE.replace("{body}", fragment(packed)), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def tabs():
    with Tabs() as tabs:
        yield tabs


@pytest.fixture(scope="module")
def tab(tabs):
    with tabs.open() as seen:
        yield seen


@pytest.fixture
def seen(tab, address):
    tab.show(address)
    yield tab
    assert tab.complaints == []
    assert tab.requests == [address]


def quantum(packed, name):
    return next(one["scale"][1] for one in packed.manifest["quantities"] if one["name"] == name)


def number(text):
    return float(text.replace("−", "-"))


def test_every_number_in_the_page_is_within_half_a_quantum(seen, packed, waves):
    for step, name in enumerate(waves.steps):
        truth = waves.read(name)
        seen.js(f"explorer.change({{ step: {step} }})")
        points = seen.js(
            "[...explorer.frame.codes].map((_, k) => explorer.frame.point(k))"
            ".map((one) => [one.value, one.status, one.error, one.u, one.sigma, one.bias, one.share])"
        )
        numbers = np.array([[np.nan if part is None else part for part in one] for one in points]).T
        value, status, error, *parts = numbers
        assert (np.isnan(value) == np.isnan(truth.values["exx"].ravel())).all()
        assert np.nanmax(np.abs(value - truth.values["exx"].ravel())) <= quantum(packed, "exx") / 2 * (1 + 1e-6)
        for part, found in zip(("u", "sigma", "bias", "share"), parts, strict=True):
            assert np.nanmax(np.abs(found / truth.errors[part]["exx"].ravel() - 1)) < 0.01
        np.testing.assert_array_equal(error, parts[0])
        assert (status == truth.status.ravel()).all()


@pytest.mark.parametrize(("row", "col"), [(0, 0), (15, 20), (29, 39), (3, 7)])
def test_the_pointer_reads_the_point_under_it(seen, waves, row, col):
    truth = waves.read(waves.steps[LAST])
    text = seen.hover(*(truth.places["left"][row, col] + [2.0, -3.0]))
    value, error = re.search(r"εxx (−?[\d.]+) ± ([\d.]+)", text).groups()
    assert number(value) == pytest.approx(
        truth.values["exx"][row, col], abs=0.6 * 10.0 ** -len(value.partition(".")[2])
    )
    assert number(error) == pytest.approx(truth.errors["u"]["exx"][row, col], rel=0.06)
    for name, part in (("noise σ", "sigma"), ("bias", "bias"), ("calibration", "share")):
        size = re.search(rf"{name} ± ([\d.e−]+)", text).group(1)
        assert number(size) == pytest.approx(truth.errors[part]["exx"][row, col], rel=0.06)
    assert f"point {row}, {col}" in text


def test_a_gap_says_its_reason_where_its_neighbours_have_moved_to(seen, waves):
    moved = waves.at_first()[1, 14] + [0.0, 2.0 * (LAST + 1)]
    text = seen.hover(*moved)
    assert "no value: hidden" in text
    assert "Not visible in the other camera." in text
    assert f"point 1, 14 · x {moved[0]:.1f}, y {moved[1]:.1f} px" in text


def test_a_click_gives_the_curve_of_the_point(seen, packed, waves):
    seen.page.mouse.click(*seen.at(*waves.read(waves.steps[LAST]).places["left"][12, 30]))
    seen.page.wait_for_selector(".x-chip")
    seen.js("explorer.side.showCurve()")
    series = seen.js("explorer.side.curve.content.series.map((one) => [one.x, one.y, one.error])")
    truth = [waves.read(step) for step in waves.steps]
    assert len(series) == 1
    x, y, error = series[0]
    assert (x, y[0], error[0]) == ([0, 1, 2, 3, 4], 0, 0)
    np.testing.assert_allclose(y[1:], [one.values["exx"][12, 30] for one in truth], atol=quantum(packed, "exx"))
    np.testing.assert_allclose(error[1:], [one.errors["u"]["exx"][12, 30] for one in truth], rtol=0.01)
    assert seen.page.locator(".x-chip").inner_text().startswith("point 12, 30")
    seen.page.locator(".x-chip button").click()
    assert seen.page.locator(".x-chip").count() == 0


def test_the_curves_of_several_probes_are_named(seen):
    seen.js("""(() => {
      const facts = { quantity: "strain", unit: "1", numbers: [0, 1], errors: [0, 0] };
      const probe = (title, values) => ({ title, values, ...facts });
      explorer.manifest.curves = [probe("strain of upper", [0, 0.1]), probe("strain of lower", [0, 0.2])];
      return explorer.side.showCurve();
    })()""")
    assert seen.page.locator(".x-chip").all_text_contents() == ["strain of upper", "strain of lower"]
    assert seen.js("(({ series, text }) => text(series[1], 1))(explorer.side.curve.content)").endswith(
        "strain of lower"
    )


def test_the_table_of_a_curve_has_units_and_the_same_numbers(seen, waves):
    seen.js("explorer.pick(12 * 40 + 30)")
    with seen.page.expect_download() as saved:
        seen.page.locator(".x-side .x-quiet", has_text="CSV").first.click()
    lines = saved.value.path().read_text(encoding="utf-8-sig").splitlines()
    assert lines[0] == '"step","point 12, 30 εxx [–]","± point 12, 30"'.replace('"step"', "step")
    assert lines[1] == "first step,0,0"
    values = [float(line.split(",")[1]) for line in lines[2:]]
    np.testing.assert_allclose(values, [waves.read(step).values["exx"][12, 30] for step in waves.steps], rtol=1e-3)


def test_a_line_gives_the_profile_by_the_triangles_of_the_field(seen, packed, waves):
    from matplotlib.tri import LinearTriInterpolator, Triangulation

    truth = waves.read(waves.steps[LAST])
    places, values = truth.places["left"], truth.values["exx"]
    start, end = places[5, 4], places[25, 33]
    seen.toggle("Line")
    seen.page.mouse.move(*seen.at(*start))
    seen.page.mouse.down()
    seen.page.mouse.move(*seen.at(*((start + end) / 2)), steps=4)
    seen.page.mouse.move(*seen.at(*end), steps=4)
    seen.page.mouse.up()
    drawn = np.array(seen.js("explorer.scene.line"))
    np.testing.assert_allclose(drawn, [start, end], atol=1.0)
    at, found = (np.array(seen.js(f"explorer.side.profile.content.series[0].{axis}"), dtype=float) for axis in "xy")
    number_of = np.arange(30 * 40).reshape(30, 40)
    a, b, c, d = number_of[:-1, :-1], number_of[:-1, 1:], number_of[1:, :-1], number_of[1:, 1:]
    triangles = np.concatenate([np.stack(one, axis=-1).reshape(-1, 3) for one in ((a, b, c), (b, d, c))])
    full = places.copy()
    full[np.isnan(full)] = 0
    known = np.isfinite(values).ravel()
    mesh = Triangulation(*full.reshape(-1, 2).T, triangles, mask=~known[triangles].all(axis=1))
    x, y = drawn[0][:, None] + (drawn[1] - drawn[0])[:, None] * at / np.hypot(*(drawn[1] - drawn[0]))
    expected = LinearTriInterpolator(mesh, np.nan_to_num(values).ravel())(x, y).filled(np.nan)
    assert np.isfinite(expected).sum() > 150
    np.testing.assert_allclose(found, expected, atol=1e-5)
    seen.page.get_by_label("x of the end").fill("300")
    seen.page.get_by_label("x of the end").press("Enter")
    assert seen.js("explorer.scene.line[1][0]") == 300


def test_a_line_needs_no_pointer(seen, waves):
    seen.page.get_by_role("button", name="Line").focus()
    seen.page.keyboard.press("Enter")
    seen.settled()
    places = waves.read(waves.steps[LAST]).places["left"]
    (x0, y0), (x1, y1) = seen.js("explorer.scene.line")
    assert y0 == y1 == pytest.approx((np.nanmin(places[..., 1]) + np.nanmax(places[..., 1])) / 2, abs=0.01)
    assert np.nanmin(places[..., 0]) < x0 < x1 < np.nanmax(places[..., 0])
    assert seen.page.get_by_label("y of the start").input_value() == f"{y0:.1f}"


def test_a_line_across_a_gap_has_no_value_there(seen, waves):
    y = float(waves.at_first()[1, 0, 1]) + 2 * (LAST + 1)
    seen.js(f"explorer.line([[200, {y}], [340, {y}]])")
    at, found = (
        seen.js(f"explorer.side.profile.content.series[0].{axis}.map((one) => Number.isFinite(one) ? one : null)")
        for axis in "xy"
    )
    near = [value is None for x, value in zip(at, found, strict=True) if abs(200 + x - 240) < 9]
    far = [value is None for x, value in zip(at, found, strict=True) if abs(200 + x - 275) < 9]
    assert all(near)
    assert not any(far)


def test_keys_move_the_step_play_and_stop(seen):
    step = "explorer.scene.step"
    seen.press("ArrowLeft")
    assert seen.js(step) == 2
    seen.press("Home")
    assert seen.js(step) == 0
    seen.press("ArrowLeft")
    assert seen.js(step) == 0
    seen.press("End")
    assert seen.js(step) == LAST
    seen.press("Space")
    seen.until(f"{step} === 1")
    assert seen.page.locator(".x-play").get_attribute("aria-label") == "Pause"
    seen.press("Space")
    stopped = seen.js(step)
    seen.page.wait_for_timeout(400)
    assert seen.js(step) == stopped
    assert seen.page.locator(".x-play").get_attribute("aria-label") == "Play"


def test_keys_zoom_reset_read_pick_and_cancel(seen, waves):
    scale = seen.js("explorer.stage.window.scale")
    seen.press("+")
    assert seen.js("explorer.stage.window.scale") == pytest.approx(1.25 * scale)
    seen.press("-", "-")
    assert seen.js("explorer.stage.window.scale") == pytest.approx(0.8 * scale)
    seen.press("0")
    assert seen.js("explorer.stage.window.scale") == pytest.approx(scale)
    seen.press("Shift+ArrowDown", "Shift+ArrowRight", "Shift+ArrowRight")
    assert "point 16, 22" in seen.page.locator(".x-stage > .x-tip").inner_text()
    seen.press("Enter")
    assert seen.js("explorer.points.map((one) => one.index)") == [16 * 40 + 22]
    seen.press("Escape")
    assert seen.js("explorer.points.length") == 0


def test_the_wheel_zooms_about_the_pointer_and_dragging_moves_the_field(seen):
    x, y = seen.at(250, 150)
    seen.page.locator(".x-stage").focus()
    seen.page.mouse.move(x, y)
    before = seen.js("explorer.stage.window.scale")
    seen.page.mouse.wheel(0, -400)
    seen.until(f"explorer.stage.window.scale > {1.9 * before}")
    assert seen.at(250, 150) == pytest.approx((x, y), abs=1.5)
    seen.page.mouse.down()
    seen.page.mouse.move(x + 60, y + 25, steps=5)
    seen.page.mouse.up()
    assert seen.at(250, 150) == pytest.approx((x + 60, y + 25), abs=1.5)
    assert seen.js("explorer.points.length") == 0


def expected_colour(value, low, high, table="viridis"):
    return palette(table, 256)[int(np.clip(np.rint((value - low) / (high - low) * 255), 0, 255))].astype(int)


@pytest.mark.parametrize("webgl", [True, False], ids=["webgl", "canvas"])
def test_the_picture_has_the_colours_of_the_values(tabs, address, waves, webgl):
    truth = waves.read(waves.steps[LAST])
    with tabs.open(webgl=webgl) as seen:
        seen.show(address)
        assert seen.js("explorer.stage.painter.constructor.name") == ("MeshPainter" if webgl else "PlainPainter")
        seen.js("explorer.change({ opacity: 1, colours: 'viridis' })")
        low, high = seen.js("explorer.range")
        for row, col in ((4, 3), (15, 20), (27, 35), (10, 30)):
            *colour, opacity = seen.pixel(*truth.places["left"][row, col])
            assert opacity == 255
            assert np.abs(np.array(colour) - expected_colour(truth.values["exx"][row, col], low, high)).max() <= 6
        gap = truth.places["left"][2, 14] - [0.0, 10.0]
        assert seen.pixel(*gap)[3] == 0
        assert seen.pixel(20, 20)[3] == 0
        low, high = 0.0, 0.06
        for label, value in (("lower end of the colours", low), ("upper end of the colours", high)):
            seen.page.get_by_label(label).fill(str(value).replace(".", ","))
            seen.page.get_by_label(label).press("Enter")
        seen.page.get_by_label("colour map").select_option("magma")
        seen.settled()
        for row, col in ((4, 3), (15, 20), (27, 35)):
            colour = np.array(seen.pixel(*truth.places["left"][row, col])[:3])
            assert np.abs(colour - expected_colour(truth.values["exx"][row, col], low, high, "magma")).max() <= 8
        assert seen.complaints == []


def test_a_range_that_is_no_range_is_marked_and_not_used(seen):
    before = seen.js("explorer.range")
    seen.page.get_by_label("lower end of the colours").fill("1e9")
    seen.page.get_by_label("lower end of the colours").press("Enter")
    assert seen.js("explorer.range") == before
    seen.toggle("This step")
    assert seen.js("explorer.range")[1] < before[1] + 1e-3
    seen.toggle("All steps")
    assert seen.js("explorer.range") == before
    end = seen.page.get_by_label("lower end of the colours")
    for typed, value, text in (("−2.603e−4", -2.603e-4, "−0.00026"), ("−2.603e−5", -2.603e-5, "−2.6e−5")):
        end.fill(typed)
        end.press("Enter")
        assert (seen.js("explorer.range")[0], end.input_value()) == (value, text)


def test_undeformed_is_where_the_points_lay(seen, waves):
    seen.toggle("Undeformed")
    text = seen.hover(*waves.at_first()[20, 10])
    assert f"point 20, 10 · x {waves.at_first()[20, 10, 0]:.1f}, y {waves.at_first()[20, 10, 1]:.1f} px" in text


def test_another_quantity_has_its_unit_and_its_own_numbers(seen, waves):
    seen.page.get_by_label("quantity").select_option(label="W · displacement")
    seen.settled()
    truth = waves.read(waves.steps[LAST])
    text = seen.hover(*truth.places["left"][9, 9])
    found = re.search(r"W (−?[\d.]+) mm", text).group(1)
    assert number(found) == pytest.approx(truth.values["W"][9, 9], abs=1e-4)
    assert seen.page.locator(".x-legend-title").inner_text() == "displacement W [mm]"


def test_the_surface_turns_and_is_read_where_it_is_seen(seen, waves):
    truth = waves.read(waves.steps[LAST])
    seen.toggle("Surface")
    before = seen.js("[explorer.stage.turntable.yaw, explorer.stage.turntable.pitch]")
    seen.page.locator(".x-stage").scroll_into_view_if_needed()
    box = seen.page.locator(".x-stage").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    seen.page.mouse.move(x, y)
    seen.page.mouse.down()
    seen.page.mouse.move(x + 50, y + 25, steps=5)
    seen.page.mouse.up()
    after = seen.js("[explorer.stage.turntable.yaw, explorer.stage.turntable.pitch]")
    assert np.subtract(after, before) == pytest.approx([0.4, -0.2], abs=1e-6)
    left, top = seen.js("explorer.stage.shownAt(15 * 40 + 20)")
    seen.page.mouse.move(box["x"] + 1 + left, box["y"] + 1 + top, steps=3)
    text = seen.page.locator(".x-stage > .x-tip").inner_text()
    place = truth.places["space"][15, 20]
    assert "point 15, 20" in text
    assert "X {:.2f}, Y {:.2f}, Z {:.2f} mm".format(*place) in text


def test_gaps_are_drawn_in_the_colour_of_their_reason(seen, waves):
    seen.toggle("Undeformed")
    seen.toggle("Gaps")
    x, y = waves.at_first()[1, 14]
    colour = seen.pixel(x + 4, y + 4)
    reason = seen.js(f"explorer.manifest.reasons.find((one) => one.code === {int(Status.HIDDEN)}).colour")
    assert np.abs(np.array(colour[:3]) - list(bytes.fromhex(reason[1:]))).max() <= 4


def test_gaps_do_not_fade_what_cannot_show_them(seen):
    drawn = "(explorer.redraw(), explorer.stage.canvas.toDataURL())"
    for camera in ("space", "right"):
        seen.js(f"explorer.change({{ camera: '{camera}', reasons: false }})")
        before = seen.js(drawn)
        seen.js("explorer.change({ reasons: true })")
        assert seen.js(drawn) == before


def test_a_picture_has_the_pixels_of_its_place_whenever_it_is_drawn(seen):
    """Also before the browser has sent its size, which it does with the next frame."""
    seen.js("explorer.stage.canvas.width = explorer.stage.canvas.height = 7")
    seen.js("explorer.redraw()")
    sizes = seen.js("[explorer.stage.canvas, explorer.stage.element].map((one) => [one.clientWidth, one.clientHeight])")
    assert seen.js("[explorer.stage.canvas.width, explorer.stage.canvas.height]") == sizes[0] == sizes[1]


def test_names_of_others_are_text(seen):
    seen.page.get_by_label("quantity").select_option(index=2)
    seen.settled()
    assert "</script><b>a name of a plug-in" in seen.page.locator(".x-legend-title").inner_text()
    assert seen.page.locator(".explorer b").count() == 0


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1920, 1080), (390, 844)])
def test_no_texts_overlap_and_nothing_sticks_out(tabs, address, width, height, dark):
    with tabs.open(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light") as seen:
        seen.show(address)
        for state in ("{}", "{ camera: 'space' }", "{ camera: 'left', line: [[120, 100], [400, 250]] }"):
            seen.js(f"explorer.change({state})")
            seen.js("explorer.pick(12 * 40 + 5)")
            assert seen.overlaps() == []
            assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
        seen.picture(f"waves_{width}_{'dark' if dark else 'light'}", whole=True)
        assert seen.complaints == []


def test_the_same_modules_fetch_their_blobs_from_a_server(tabs, packed, waves, tmp_path):
    static = resources.files("dicflow.explorer") / "static"
    for file in static.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    for name, blob in packed.blobs.items():
        (tmp_path / name).write_bytes(blob)
    (tmp_path / "manifest.json").write_text(json.dumps(packed.manifest))
    (tmp_path / "index.html").write_text(
        '<!DOCTYPE html><meta charset="utf-8"><link rel="icon" href="data:,">'
        '<link rel="stylesheet" href="explorer.css">'
        '<div class="explorer"></div><script type="module">'
        'import { mountExplorer } from "./view.js"; import { fetchedSource } from "./source.js";'
        'const manifest = await (await fetch("manifest.json")).json();'
        'mountExplorer(document.querySelector(".explorer"), fetchedSource(manifest, (name) => name));</script>'
    )
    handler = partial(Quiet, directory=str(tmp_path))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with tabs.open() as seen:
            seen.page.goto(f"http://127.0.0.1:{server.server_port}/index.html")
            seen.page.wait_for_function("document.querySelector('.explorer').explorer?.frame")
            text = seen.hover(*waves.read(waves.steps[LAST]).places["left"][15, 20])
            assert "point 15, 20" in text
            blobs = [url for url in seen.requests if re.search(r"/[0-9a-f]{16}$", url)]
            assert len(blobs) == len(set(blobs)) < len(packed.blobs)
            assert seen.complaints == []
    finally:
        server.shutdown()
        server.server_close()


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A server that prints nothing."""

    def log_message(self, *given):
        pass
