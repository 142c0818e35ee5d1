"""Every block of code in the manual is run, wired or parsed."""

from __future__ import annotations

import doctest
import importlib
from functools import partialmethod

import cv2
import numpy as np
import pytest
import typer

import dicflow
from dicflow.core.synthetic.planar import planar_pair
from dicflow.pipeline import Pipeline
from tests.manual.blocks import (
    ROOT,
    Block,
    blocks,
    check_javascript,
    check_shell,
    check_yaml,
    parse_command,
    prose_commands,
)
from tests.manual.notebooks import NOTEBOOKS, notebook_page

LANGUAGES = ("", "js", "python", "sh", "text", "toml", "yaml")
ELSEWHERE = ("extending.md", "README.md")
"""Pages whose Python and whose unnamed blocks have tests of their own."""
STEPS = 4
PIPELINE = """\
dicflow: 1
stages:
  photos: {stage: images, left: "photos/*.png"}
  region: {stage: region, images: photos, rectangle: [40, 40, 160, 140]}
  correlation: {stage: correlate, images: photos}
  total: {stage: deformation, points: correlation}
  probes: {stage: probes, extensometers: {length: [[60, 60], [60, 120]]}}
"""


def named(language: str, but: tuple[str, ...] = ()) -> list:
    return [pytest.param(block, id=block.name) for block in blocks(language) if block.page.name not in but]


def python_pages() -> list[str]:
    return sorted({block.page.name for block in blocks("python")} - set(ELSEWHERE))


@pytest.mark.parametrize("block", named("yaml"))
def test_yaml_is_valid(block: Block):
    check_yaml(block)


@pytest.mark.parametrize("block", named("sh"))
def test_commands_exist(block: Block):
    check_shell(block)


@pytest.mark.parametrize("block", named("js"))
def test_names_of_javascript_exist(block: Block):
    check_javascript(block)


@pytest.mark.slow
def test_commands_in_the_text_exist():
    found = list(prose_commands())
    assert len(found) > 50
    for page, text in found:
        words = text.split()[1:]
        if words and words[0].islower() and "…" not in text:
            try:
                parse_command([words[0], "--help"])
            except typer.Exit:
                continue
            pytest.fail(f"{page}: {text}")


def test_blocks_have_a_known_language():
    known = sum(len(blocks(language)) for language in LANGUAGES)
    pages = {block.page for language in LANGUAGES for block in blocks(language)}
    assert known == sum(page.read_text(encoding="utf-8").count("\n```") for page in pages) / 2
    assert {block.page.name for block in (*blocks(""), *blocks("toml"))} <= set(ELSEWHERE)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with a pipeline of one camera, whose runs stay in this process."""
    (tmp_path / "photos").mkdir()
    for step in range(STEPS):
        pair = planar_pair((200, 180), np.diag([1.0, 1.0 + 0.01 * step, 1.0]), seed=5)
        cv2.imwrite(str(tmp_path / "photos" / f"step_{step:02d}.png"), pair.deformed)
    (tmp_path / "pipeline.yaml").write_text(PIPELINE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Pipeline, "run", partialmethod(Pipeline.run, scheduler="sync"))


@pytest.mark.slow
@pytest.mark.parametrize("page", python_pages())
@pytest.mark.usefixtures("folder")
def test_python_runs(page):
    """The blocks of a page one after another."""
    names: dict = {"__name__": "__page__"}
    for block in blocks("python"):
        if block.page.name == page:
            exec(compile(block.text, block.name, "exec"), names)
    assert names["dicflow"] is dicflow


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(notebook):
    page = notebook_page(notebook)
    assert page.count("```python") >= 5
    assert "<table>" in page
    assert "data:image/png" in page
    assert '"outputs": []' in notebook.read_text(encoding="utf-8")


def modules_with_examples() -> list[str]:
    files = [path for path in (ROOT / "dicflow").rglob("*.py") if ">>> " in path.read_text(encoding="utf-8")]
    return sorted(".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in files)


@pytest.mark.parametrize("name", modules_with_examples())
def test_examples_of_docstrings_run(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    done = doctest.testmod(importlib.import_module(name))
    assert done.attempted
    assert not done.failed
