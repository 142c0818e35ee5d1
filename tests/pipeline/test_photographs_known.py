"""Photographs that a plan has seen once are not decoded again while they are unchanged."""

import os
import shutil

import pytest
from small import BOARDS, STEPS

from dicflow.io.images import reading
from dicflow.pipeline import Pipeline
from tests.replaced import replace_below

PHOTOGRAPHS = 2 * (BOARDS + STEPS)


@pytest.fixture
def decoded(monkeypatch):
    """Names of the photographs that were decoded."""
    names, read = [], reading.read_photograph
    monkeypatch.setattr(reading, "read_photograph", lambda path: names.append(path.name) or read(path))
    return names


@pytest.fixture
def known(copied, decoded):
    """The pipeline file, after a plan that has seen all its photographs."""
    Pipeline.load(copied).plan()
    assert len(decoded) == PHOTOGRAPHS
    decoded.clear()
    return copied


def test_planning_again_decodes_none(known, decoded):
    Pipeline.load(known).plan()
    Pipeline.load(known).result()
    assert Pipeline.load(known).run(scheduler="sync").outcome.counts["computed"] == 0
    assert decoded == []


def test_another_pipeline_on_the_same_photographs_decodes_none(known, decoded):
    second = shutil.copy(known, known.with_name("second.yaml"))
    Pipeline.load(second, store=known.parent / ".dicflow", settings=["smooth.window=[40,20]"]).plan()
    assert decoded == []


def test_a_store_that_cannot_be_written_decodes_none(known, decoded, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(30, "Read-only file system")

    replace_below(monkeypatch, known.parent, os, "replace", refuse)
    assert Pipeline.load(known).plan().counts["run"] == 0
    assert decoded == []


def test_only_the_changed_photograph_is_decoded(known, decoded):
    changed = sorted(known.parent.rglob("*.png"))[0]
    stamp = changed.stat()
    changed.write_bytes(changed.read_bytes())
    os.utime(changed, (stamp.st_atime, stamp.st_mtime - 60))
    Pipeline.load(known).plan()
    assert decoded == [changed.name]
