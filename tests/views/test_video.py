"""Films are read back as they were written."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from dicflow.errors import ConfigurationError
from dicflow.views.video import movie
from tests.browser import chromium, opened

pytestmark = pytest.mark.slow

WIDTH, HEIGHT = 181, 120


def frames(count=5):
    x, y = np.meshgrid(np.linspace(0, 1, WIDTH), np.linspace(0, 1, HEIGHT))
    for number in range(count):
        red = 120 + 100 * np.sin(6 * x + number)
        yield np.stack([red, 200 * y, np.full_like(x, 30 * number)], axis=-1).astype(np.uint8)


def decoded(path):
    film, found = cv2.VideoCapture(str(path)), []
    while (read := film.read())[0]:
        found.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
    return found, film.get(cv2.CAP_PROP_FPS)


@pytest.mark.parametrize(("suffix", "code"), [(".mp4", b"vp09"), (".webm", b"V_VP9")])
def test_a_film_has_its_frames_in_even_size(tmp_path, capfd, suffix, code):
    path = tmp_path / f"strain{suffix}"
    movie(frames(), path, seconds=0.25)
    assert capfd.readouterr() == ("", "")
    assert code in path.read_bytes()
    found, rate = decoded(path)
    assert [frame.shape for frame in found] == [(HEIGHT, WIDTH + 1, 3)] * 5
    assert rate == pytest.approx(4.0)
    for shown, meant in zip(found, frames(), strict=True):
        error = (shown[:, :WIDTH].astype(float) - meant).ravel()
        assert 10 * np.log10(255**2 / np.mean(error**2)) > 30


PLAYED = """
new Promise((done) => {
  const film = document.querySelector("video");
  film.onended = () => done([film.videoWidth, film.videoHeight, film.duration, film.currentTime, null]);
  film.onerror = () => done([0, 0, 0, 0, film.error.message]);
  film.play();
})
"""


@pytest.mark.skipif(chromium() is None, reason="needs chromium on the PATH")
@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_film_plays_in_a_browser(tmp_path, suffix):
    movie(frames(), tmp_path / f"strain{suffix}", seconds=0.2)
    (tmp_path / "page.html").write_text(f'<!doctype html><video src="strain{suffix}" muted></video>')
    (tmp_path / "browser").mkdir()
    with opened(tmp_path / "browser") as page:
        page.open(tmp_path / "page.html")
        width, height, duration, end, error = page.evaluate(PLAYED)
    assert error is None
    assert (width, height) == (WIDTH + 1, HEIGHT)
    assert duration == end == pytest.approx(5 * 0.2, abs=0.05)


def test_frames_are_taken_one_at_a_time(tmp_path):
    taken = []

    def counted():
        for number, frame in enumerate(frames(4)):
            taken.append(number)
            yield frame

    movie(counted(), tmp_path / "a.mp4")
    assert taken == [0, 1, 2, 3]


def test_a_format_that_is_no_movie_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match=r"a film is \.mp4 or \.webm, not '\.avi'"):
        movie(frames(), tmp_path / "strain.avi")
    with pytest.raises(ValueError, match="at least one frame"):
        movie([], tmp_path / "none.mp4")
    with pytest.raises(ValueError, match="one size"):
        movie([np.zeros((4, 4, 3), np.uint8), np.zeros((4, 6, 3), np.uint8)], tmp_path / "sizes.mp4")
