"""Tiles and thumbnails show the photographs that are measured, and are made once."""

from __future__ import annotations

import io
import socket
import threading

import numpy as np
import pytest
from app_serving import FILE, served, small_test
from PIL import Image

from dicflow.app import pictures, server
from dicflow.app.project import open_project
from dicflow.errors import ConfigurationError, InputError


def tile(app, found, level, column, row):
    answer = app.own("GET", f"/picture/{found['key']}/{level}/{column}_{row}.jpg")
    assert answer.status == 200
    assert "immutable" in answer.headers["cache-control"]
    return np.asarray(Image.open(io.BytesIO(answer.body))).astype(float)


def test_tiles_of_all_levels_are_the_photograph(tmp_path):
    path = small_test(tmp_path / "test", size=(1300, 700))
    grey = np.asarray(Image.open(path.parent / "left" / "step_0000.png")).astype(float)
    with served(path) as app:
        found = app.found("photograph", file=FILE)
        assert (found["width"], found["height"], found["levels"], found["step"]) == (1300, 700, 3, "step_0000")
        rows = [np.hstack([tile(app, found, 0, column, row) for column in range(3)]) for row in range(2)]
        whole = np.vstack(rows)
        assert whole.shape == (700, 1300)
        assert np.abs(whole - grey).mean() < 3.0  # JPEG smooths the noise of 3 grey levels
        assert np.abs(whole[:, 1:] - grey[:, :-1]).mean() > 6.0
        half = np.hstack([tile(app, found, 1, column, 0) for column in range(2)])
        means = grey.reshape(350, 2, 650, 2).mean(axis=(1, 3))
        assert np.abs(half - means).mean() < 3.0
        assert tile(app, found, 2, 0, 0).shape == (175, 325)
        assert app.own("GET", f"/picture/{found['key']}/0/9_9.jpg").status == 404


def test_a_photograph_is_decoded_once_and_again_when_it_changes(tmp_path, monkeypatch):
    path = small_test(tmp_path / "test")
    project = open_project(path)
    first = pictures.shown(project, project.pipeline(FILE), "photos", None, "left")
    monkeypatch.setattr(pictures, "_sizes", {})
    with monkeypatch.context() as forbidden:
        forbidden.setattr(pictures, "_write_tiles", None)
        assert pictures.shown(project, project.pipeline(FILE), "photos", None, "left") == first
    Image.new("L", (200, 150), 9).save(path.parent / "left" / "step_0000.png")
    assert pictures.shown(project, project.pipeline(FILE), "photos", None, "left")["key"] != first["key"]
    with pytest.raises(ConfigurationError, match="no right photograph"):
        pictures.shown(project, project.pipeline(FILE), "photos", None, "right")


def test_no_answer_waits_for_thumbnails_and_those_of_a_screen_that_is_left_are_not_made(tmp_path, monkeypatch):
    path, begun, free = small_test(tmp_path / "test"), [], threading.Event()

    def slow(project, name):
        begun.append(name)
        assert free.wait(60)
        raise InputError(name, "is slow", "wait")

    monkeypatch.setattr(server, "thumbnail", slow)
    with served(path.parent) as app:
        asked = [socket.create_connection(("127.0.0.1", app.gate.port)) for _ in range(20)]
        for number, one in enumerate(asked):
            one.sendall(
                f"GET /picture/thumbnail?path={number} HTTP/1.1\r\nHost: 127.0.0.1:{app.gate.port}\r\n"
                f"Cookie: {app.gate.cookie}={app.gate.token}\r\n\r\n".encode()
            )
        assert app.found("project")["files"] == [FILE]
        for one in asked:
            one.close()
        assert app.found("steps", file=FILE, stage="photos") == ["step_0000", "step_0001"]
        free.set()
        assert app.own("GET", "/picture/thumbnail?path=last").status == 422
    assert len(begun) <= 3
    assert begun[-1] == "last"


def test_photographs_are_turned_as_they_are_measured(tmp_path):
    path = small_test(tmp_path / "test", steps=1)
    turned = Image.Exif()
    turned[0x0112] = 6
    for file in (path.parent / "left").iterdir():
        with Image.open(file) as image:
            image.save(file.with_suffix(".jpg"), exif=turned)
        file.unlink()
    path.write_text(path.read_text().replace("*.png", "*.jpg"))
    project = open_project(path)
    lying = pictures.shown(project, project.pipeline(FILE), "photos", None, "left")
    assert (lying["width"], lying["height"]) == (200, 150)
    path.write_text(path.read_text().replace('"left/*.jpg"', '"left/*.jpg", orientation: upright'))
    upright = pictures.shown(project, project.pipeline(FILE), "photos", None, "left")
    assert (upright["width"], upright["height"]) == (150, 200)
    with Image.open(pictures.thumbnail(project, "left/step_0000.jpg")) as small:
        assert small.size == (150, 200)


def test_pictures_that_were_not_looked_at_for_longest_are_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "_MOST_PHOTOGRAPHS", 3)
    monkeypatch.setattr(pictures, "_MOST_THUMBNAILS", 2)
    project = open_project(small_test(tmp_path / "test", steps=6))
    pipeline, folder = project.pipeline(FILE), project.own_folder / "pictures"

    def look(step):
        return pictures.shown(project, pipeline, "photos", f"step_{step:04}", "left")["key"]

    keys = [look(step) for step in (0, 1, 2)]
    assert look(0) == keys[0]
    keys += [look(3), look(4)]
    assert {one.name for one in folder.iterdir()} == {keys[k] for k in (0, 3, 4)}
    assert look(1) == keys[1]
    assert (folder / keys[1] / "info.json").is_file()
    for step in range(6):
        pictures.thumbnail(project, f"left/step_{step:04}.png")
    assert len(list((folder / "thumbnails").iterdir())) == 2
    assert (folder / keys[1]).is_dir()


def test_a_photograph_that_cannot_be_read_says_so(tmp_path):
    path = small_test(tmp_path / "test")
    (path.parent / "left" / "step_0000.png").write_bytes(b"\x89PNG\r\n\x1a\nbroken")
    project = open_project(path)
    with pytest.raises(InputError, match="step_0000"):
        pictures.shown(project, project.pipeline(FILE), "photos", None, "left")
    with pytest.raises(InputError, match="step_0000"):
        pictures.thumbnail(project, "left/step_0000.png")
