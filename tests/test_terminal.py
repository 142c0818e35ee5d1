"""The command line on every kind of terminal, its last lines, and its end by a signal."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
from PIL import Image
from small import dicflow
from waiting import PATIENCE_S, started

pytestmark = pytest.mark.slow

PIPELINE = """\
title: "\\u202etest"
stages:
  photos: {stage: images, left: "s_*.png"}
  region: {stage: region, images: photos, rectangle: [20, 20, 100, 80]}
  correlation: {stage: correlate, images: photos, subset_size: 21, step_size: 10}
  total: {stage: deformation}
"""


def speckle(seed):
    levels = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(120, 160)), (0, 0), 1.5)
    return 20 + 200 * (levels - levels.min()) / np.ptp(levels)


@pytest.fixture(scope="module")
def test_folder(tmp_path_factory):
    """One camera, four steps: a pattern, moved by 2 px, another pattern, moved by 3 px."""
    folder = tmp_path_factory.mktemp("terminal")
    first = speckle(1)
    for number, levels in enumerate((first, np.roll(first, 2, 1), speckle(7), np.roll(first, 3, 1))):
        Image.fromarray(levels.astype("u1")).save(folder / f"s_{number}.png")
        os.utime(folder / f"s_{number}.png", (1e9, 1e9))
    (folder / "p.yaml").write_text(PIPELINE)
    return folder


def run(folder, *more):
    return dicflow("run", folder / "p.yaml", "--scheduler", "sync", "--json", *more)


def test_the_last_lines_and_the_json_carry_each_warning_once_also_of_hits(test_folder):
    first, again = run(test_folder), run(test_folder)
    warnings = first.line["warnings"]
    assert warnings[0].startswith("correlation/s_2: no point")
    assert again.line["warnings"] == warnings
    assert again.line["counts"]["hit"] == 12
    for answer in (first, again):
        assert answer.code == 0
        *lines, help_, _, report = answer.err.splitlines()
        assert report.startswith("report: ")
        assert help_ == "help: dicflow help lost-points"
        assert lines[-len(warnings) :] == [f"warning: {warning}" for warning in warnings]
        assert answer.err.count(warnings[0]) == 1
    single = run(test_folder, "--set", "photos.left=s_0.png")
    assert single.code == 0
    (warning,) = single.line["warnings"]
    assert warning.startswith("photos has one step only, with which correlation, total cannot compare")
    assert f"warning: {warning}" in single.err.splitlines()


def command(folder, *words, **options):
    """A command in a process of its own."""
    line = [sys.executable, "-m", "dicflow", words[0], folder / "p.yaml", *words[1:]]
    environment = {**os.environ, **options.pop("env", {})}
    return subprocess.run(line, capture_output=True, env=environment, timeout=PATIENCE_S, check=False, **options)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1"])
def test_every_encoding_shows_a_plan(test_folder, encoding):
    run(test_folder)
    setting = ("--set", "correlation.subset_size=23")
    done = command(test_folder, "plan", *setting, env={"PYTHONIOENCODING": encoding, "TERM": "dumb"})
    assert done.returncode == 0
    assert done.stderr == b""
    assert b"subset_size: 21 -> 23" in done.stdout
    done = command(test_folder, "why", "total", *setting, env={"PYTHONIOENCODING": encoding})
    assert b"subset_size: 21 -> 23" in done.stdout


def test_a_reader_that_goes_away_ends_the_command_without_a_word(test_folder):
    line = [sys.executable, "-m", "dicflow", "schema"]
    reading, writing = os.pipe()
    with started(line, stdout=writing, stderr=subprocess.PIPE) as process:
        os.close(writing)
        os.close(reading)
        _, errors = process.communicate(timeout=PATIENCE_S)
    assert errors == b""


@pytest.mark.parametrize("closed", [1, 2])
def test_a_closed_stream_is_no_error(test_folder, closed):
    run(test_folder)
    shell = 'exec "$0" -m dicflow ls "$1" ' + (">&-" if closed == 1 else "2>&-")
    done = subprocess.run(
        ["sh", "-c", shell, sys.executable, test_folder / "p.yaml"], capture_output=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0
    assert done.stderr == b""


@pytest.mark.parametrize("name", ["\x1b]0;OWNED\a", "\u202egnp.txt", "[red]x[/red]"])
def test_names_from_a_file_never_command_the_terminal(test_folder, tmp_path, name):
    """As a stage, as a parameter, as photographs, and as a message."""
    path = tmp_path / "p.yaml"
    texts = [
        {"stages": {name: {"stage": "images", "left": "*.png"}}},
        {"stages": {"photos": {"stage": "images", name: "*.png"}}},
        {"stages": {"photos": {"stage": "images", "left": f"{name}*.png"}}},
        {"stages": {"photos": {"stage": name}}},
        {name: 1, "stages": {}},
    ]
    for text in texts:
        path.write_text(json.dumps(text))
        for words in (("run",), ("plan",), ("graph",), ("why", name)):
            answer = dicflow(words[0], path, *words[1:])
            shown = answer.out + answer.err
            assert not {"\x1b", "\a", "\u202e"} & set(shown)
            assert ("[red]" in name) == ("[red]" in shown), words
            assert answer.code != 0 or words == ("graph",)
