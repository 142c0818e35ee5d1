"""The pictures of docs/first_test.md: a student's way through the app, by mouse and keyboard.

``python -m tests.app.first_test [FOLDER]`` takes photographs as ``dicflow synth sample FOLDER`` makes them (default:
data_samples), names them as two phones do, and prints how long each step took and what was compared.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app_browser import Person, close_browser, opened_page
from app_serving import FILE, served

from tests.phones import SAMPLES, taken_by_phones
from tests.small_pictures import keep

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "pictures"
SQUARE = "14.5 mm"
MARKS = [(362, 134), (362, 455)]
"""Where the caliper touched the strip, in the first left photograph [px]."""
_PATIENCE_MS = 600_000


def way(folder: Path, pictures: Path) -> None:
    """Go from the photographs in a folder to the comparison with the caliper, and keep a picture of each screen."""
    with served(folder) as app, opened_page(app, 1280, 800) as someone:
        page = someone.page
        page.set_default_timeout(_PATIENCE_MS)
        with _timed("folder and pairs"):
            page.wait_for_selector(".way img")
            someone.until("[...document.querySelectorAll('.series img')].every((one) => one.naturalWidth)")
            _keep(someone, pictures / "first_test_1_folder.png")
            page.locator(".pairings").scroll_into_view_if_needed()
            someone.until("[...document.querySelectorAll('.way img')].every((one) => one.naturalWidth)")
            _keep(someone, pictures / "first_test_2_pairs.png")
            page.fill("#square", SQUARE)
            page.get_by_role("button", name="Make the pipeline file").click()
            page.wait_for_selector("section.region .viewer")
        with _timed("region and extensometer"):
            page.click("text=Propose the region")
            someone.said("saved: the proposed region")
            _drawn(someone, "e", MARKS)
            someone.said("saved: extensometer_1")
            _alone(someone)
            _keep(someone, pictures / "first_test_3_region.png")
        with _timed("run"):
            someone.go("run")
            page.get_by_role("button", name="Start", exact=True).click()
            page.wait_for_selector("h1.state.running")
            page.wait_for_timeout(4000)
            _keep(someone, pictures / "first_test_4_run.png")
            page.wait_for_selector("h1.state.done")
        with _timed("calibration, field, caliper"):
            _results(someone, pictures)
        rows = app.found("caliper", file=FILE)["rows"]
    for row in rows:
        print(f"{row['load_g']:8.2f} g  caliper {row['caliper_strain']:.5f}  dicflow {row['dic_strain']:.5f}", end="  ")
        print(f"difference {row['strain_error']:+.5f} ± {row['u_difference']:.5f}")


def _results(someone: Person, pictures: Path) -> None:
    page = someone.page
    someone.go("calibration")
    page.wait_for_selector(".answer")
    page.wait_for_timeout(1500)
    _keep(someone, pictures / "first_test_5_calibration.png")
    someone.go("explore")
    someone.until("document.querySelector('.fields')?.explorer.firstDrawn > 0")
    someone.until("document.querySelector('.fields').explorer.stage.photo.naturalWidth > 100")
    page.wait_for_timeout(1500)
    box = page.locator(".x-stage").bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.45 * box["height"], steps=5)
    page.wait_for_timeout(300)
    _keep(someone, pictures / "first_test_6_explore.png")
    someone.go("caliper")
    page.get_by_label("extensometer").select_option("extensometer_1")
    someone.said("saved: extensometer of the comparison")
    page.get_by_role("button", name="Compute the comparison").click()
    page.wait_for_selector(".x-chart polyline")
    _alone(someone)
    _keep(someone, pictures / "first_test_7_caliper.png")


def _alone(someone: Person) -> None:
    """Wait until no message covers the screen."""
    someone.until("!document.querySelector('#messages .message')")


def _drawn(someone: Person, key: str, places: Sequence[tuple[int, int]]) -> None:
    someone.page.focus(".viewer")
    someone.page.keyboard.press(key)
    for place in places:
        someone.click(place)


def _keep(someone: Person, path: Path) -> None:
    """A picture of the window."""
    keep(someone.page.screenshot(), path)


@contextmanager
def _timed(words: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    print(f"{words}: {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    samples = Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLES
    with tempfile.TemporaryDirectory() as place:
        way(taken_by_phones(Path(place) / "strip", samples=samples), PICTURES)
    close_browser()
