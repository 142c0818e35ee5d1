"""Pages of a file in the plan: each has a key of its own, by its contents."""

import os
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from dicflow.errors import InputError
from dicflow.io.images import reading
from dicflow.pipeline import Pipeline

PAGES = np.random.default_rng(5).integers(0, 255, (4, 24, 32), dtype=np.uint8)
PIPELINE = 'dicflow: 1\nstages:\n  photos: {stage: images, left: "*.tif", keep: always}\n'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "p.yaml").write_text(PIPELINE)
    save(tmp_path, PAGES[:3])
    return tmp_path


def save(folder, pages):
    first, *others = (Image.fromarray(page) for page in pages)
    first.save(folder / "s.tif", save_all=True, append_images=others)
    stamp = (folder / "s.tif").stat()
    os.utime(folder / "s.tif", (stamp.st_atime, stamp.st_mtime - 60))


def states(folder):
    return {name: entry.state for name, entry in Pipeline.load(folder / "p.yaml").plan().entries.items()}


def test_pages_are_stored_one_by_one(folder):
    result = Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    for page, step in zip(PAGES, ("s_001", "s_002", "s_003"), strict=False):
        np.testing.assert_array_equal(result.product("photos", step)["left"], page)
    assert set(states(folder).values()) == {"hit"}


def test_a_page_more_leaves_the_others_as_they_are(folder):
    Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    save(folder, PAGES)
    assert states(folder) == {
        "photos/s_001": "hit",
        "photos/s_002": "hit",
        "photos/s_003": "hit",
        "photos/s_004": "run",
    }


def test_a_changed_page_alone_is_read_again(folder):
    Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    save(folder, PAGES[[0, 3, 2]])
    assert states(folder) == {"photos/s_001": "hit", "photos/s_002": "run", "photos/s_003": "hit"}


def test_known_pages_are_not_decoded_again(folder, monkeypatch):
    Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    monkeypatch.setattr(reading, "read_photograph", None)
    assert set(states(folder).values()) == {"hit"}


def test_a_search_outside_of_the_allowed_folders_is_not_begun(folder, monkeypatch):
    monkeypatch.setattr("dicflow.io.images.series.find_files", None)
    (folder / "p.yaml").write_text(PIPELINE.replace("*.tif", "/**/*.tif"))
    with pytest.raises(InputError, match=r"photos: / lies outside the folder of p\.yaml"):
        _ = Pipeline.load(folder / "p.yaml").graph


def test_a_few_steps_of_a_test_are_its_own_products(folder):
    whole = Pipeline.load(folder / "p.yaml")
    whole.run(scheduler="sync")
    few = replace(whole, only={"photos": ("s_001", "s_003")})
    assert few.graph.steps == {"photos": ("s_001", "s_003")}
    plan = few.plan()
    assert {name: entry.state for name, entry in plan.entries.items()} == {"photos/s_001": "hit", "photos/s_003": "hit"}


def test_photographs_of_other_steps_are_not_said_to_lack_a_partner(tmp_path):
    for side, count in (("l", 3), ("r", 2)):
        for number in range(count):
            Image.fromarray(PAGES[number]).save(tmp_path / f"{side}_{number}.png")
    text = 'stages:\n  photos: {stage: images, left: "l_*.png", right: "r_*.png", unpaired: skip}\n'
    (tmp_path / "p.yaml").write_text(text)
    pipeline = Pipeline.load(tmp_path / "p.yaml")
    assert any("no partner" in warning for warning in pipeline.plan().warnings)
    few = replace(pipeline, only={"photos": ("l_0", "l_1")}).plan()
    assert len(few.entries) == 2
    assert not any("no partner" in warning for warning in few.warnings)
