"""The generated pages: complete, and their examples valid."""

from __future__ import annotations

import doctest
import inspect
import re

import cv2
import numpy as np
import pytest
from small import ROOT, dicflow

from dicflow.pipeline import Result
from dicflow.pipeline.registry import node_class, stage_names
from dicflow.views.topics import TOPICS, sections, topic_of
from tests.accuracy import PARTS, REAL
from tests.manual import entries
from tests.manual.advice import SCENES, measured
from tests.manual.commands import command_tree, commands_page, metavar_of
from tests.manual.gallery import SCRIPTS
from tests.manual.messages import register
from tests.manual.sizes import needed
from tests.manual.stages import example_of, stage_pages


@pytest.mark.parametrize("name", stage_names())
def test_the_page_of_a_stage_has_all_of_it(name):
    page, kind = stage_pages()[f"reference/stages/{name}.md"], node_class(name)
    rows = re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)
    assert set(rows) == {*kind.takes, *kind.model_fields} - {"stage"}
    assert f"[`{name}`](stages/{name}.md)" in stage_pages()["reference/stages.md"]


@pytest.mark.parametrize("name", stage_names())
def test_the_example_of_a_stage_is_valid(name):
    (entry,) = example_of(name).values()
    kind = node_class(name)
    made = kind.model_validate({key: value for key, value in entry.items() if key not in kind.takes})
    assert made.stage == name


def test_the_arguments_of_a_docstring_are_a_list():
    done = doctest.testmod(entries)
    assert (done.attempted, done.failed) == (1, 0)
    text = entries.with_entries(inspect.getdoc(Result.product))
    assert text.splitlines()[2].startswith("- **step**: ")
    assert "\n\nRaises ConfigurationError" in text


def test_the_page_of_commands_has_every_command_and_option():
    page = commands_page()
    for name, command in command_tree().items():
        part = page.split(f"\n## {name}\n")[1].split("\n## ")[0]
        for parameter in command.params:
            is_option = parameter.param_type_name == "option"
            named = parameter.opts[0] if is_option else metavar_of(parameter)
            assert parameter.name == "help" or f"`{named}`" in part


def test_the_parts_that_the_validation_names_exist():
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    named = set(re.findall(r"\| `([\w-]+)` \|$", page, re.MULTILINE))
    assert len(named) > 8
    assert named <= {*PARTS, *REAL}


@pytest.mark.slow
def test_every_message_has_a_section_of_troubleshooting():
    """Both ways: no message without a section, and no section that nothing leads to."""
    known = sections()
    assert set(TOPICS.values()) == set(known)
    assert {message.topic for message in register()} <= set(known)
    assert len(register()) > 450
    assert sum(message.sort == "warning" for message in register()) > 40


def test_an_error_names_its_section():
    answer = dicflow("run", "missing.yaml")
    assert answer.code == 2
    assert answer.err.splitlines()[-1] == "help: dicflow help pipeline-file"


def test_a_run_names_the_sections_of_what_failed(tmp_path):
    for step in range(2):
        cv2.imwrite(str(tmp_path / f"blank_{step}.png"), np.full((120, 120), 90, np.uint8))
    stages = '{photos: {stage: images, left: "*.png"}, region: {stage: region, images: photos, auto: true}}'
    (tmp_path / "pipeline.yaml").write_text(f"dicflow: 1\nstages: {stages}\n")
    answer = dicflow("run", tmp_path / "pipeline.yaml", "--no-report", "--scheduler", "sync")
    assert answer.code == 1
    assert "help: dicflow help region\n" in answer.err


def test_help_prints_a_section_and_lists_all():
    assert dicflow("help").out.split() == list(sections())
    section = dicflow("help", "a-camera-has-moved").out
    assert section.startswith("A camera has moved\n")
    assert "stage: refine" in section
    assert "](" not in section
    dicflow("help", "photograps").refuses(2, "did you mean 'photographs'")


def test_the_nearest_package_decides():
    assert topic_of("dicflow.io.images.tiff") == TOPICS["dicflow.io.images"]
    assert topic_of("dicflow.io.text") == TOPICS["dicflow.io"]
    assert topic_of("lab_dic.poisson") == "plug-ins"


def test_scripts_of_the_gallery_are_short():
    assert len(SCRIPTS) >= 7
    for script in SCRIPTS:
        assert len(script.read_text(encoding="utf-8").splitlines()) <= 20, script.name


@pytest.mark.slow
def test_bad_photographs_measure_worse_than_good_ones():
    """As the page on photographs says of the coarse pattern; others are measured while the page is built."""
    good, coarse = measured(SCENES["pattern"][0]), measured(SCENES["pattern"][2])
    assert good.error_px < 0.01
    assert good.found > 0.98
    assert coarse.error_px > 10 * good.error_px


def test_sizes_are_of_what_a_measurement_needs():
    names = needed()
    assert {"numba", "llvmlite", "numpy", "distributed", "pandas"} <= names
    assert not {"pytest", "mkdocs", "openpyxl", "ruamel-yaml"} & names
