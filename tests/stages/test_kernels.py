"""Kernels compiled ahead: those that stages use, and no more than once."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from small import ROOT

from dicflow.engine import kernel_cache
from dicflow.pipeline.registry import node_classes
from dicflow.stages import _kernels
from dicflow.stages._kernels import KERNELS, compile_kernels, uncompiled
from dicflow.stages.correlate import Correlate
from dicflow.stages.deformation import Deformation
from dicflow.stages.images import Images
from dicflow.stages.match import Match


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """An empty folder for kernels."""
    monkeypatch.setenv(kernel_cache.VARIABLE, str(tmp_path / "kernels"))
    return tmp_path / "kernels"


def test_a_run_compiles_what_its_stages_lack(kept, monkeypatch):
    nodes = {
        "photos": Images(left="*.png"),
        "found": Correlate(),
        "matches": Match(guided=False, refine=False),
        "total": Deformation(),
    }
    assert list(uncompiled(nodes)) == ["found", "total"]
    monkeypatch.setattr(_kernels, "KERNELS", dict.fromkeys(KERNELS, lambda: None))
    compile_kernels(["motion", "polynomials"])
    assert {stage: list(calls) for stage, calls in uncompiled(nodes).items()} == {
        "found": ["search", "sums", "judgement", "neighbours"],
        "total": ["strain"],
    }
    for call in uncompiled(nodes)["found"].values():
        call()
    compile_kernels(["strain"])
    assert uncompiled(nodes) == {}


def test_other_versions_and_machines_compile_anew(kept, monkeypatch):
    mark = kernel_cache.kernel_mark("strain")
    for name in ("node", "machine", "python_version"):
        kernel_cache._machine.cache_clear()
        with monkeypatch.context() as other:
            other.setattr(kernel_cache.platform, name, lambda: "another")
            assert kernel_cache.kernel_mark("strain") != mark
    kernel_cache._machine.cache_clear()
    assert kernel_cache.kernel_mark("strain") == mark


def test_another_installation_compiles_anew_and_so_does_one_that_was_written_again(tmp_path):
    """Numba keeps kernels by the folder of their source and the times of its files."""
    own = Path(kernel_cache.__file__).parents[1]
    copy = tmp_path / "dicflow"
    shutil.copytree(own / "core", copy / "core", ignore=shutil.ignore_patterns("__pycache__"))
    assert kernel_cache._digest(copy) == kernel_cache._digest(own)
    before = kernel_cache._place(copy)
    assert before != kernel_cache._place(own)
    os.utime(copy / "core" / "parts.py", (1e9, 1e9))
    assert kernel_cache._place(copy) != before


@pytest.mark.parametrize("kept_in", ["a file", "no/such/folder"])
def test_a_folder_for_kernels_that_is_none_or_not_there_yet(tmp_path, monkeypatch, kept_in):
    (tmp_path / "a file").touch()
    monkeypatch.setenv(kernel_cache.VARIABLE, str(tmp_path / kept_in))
    mark = kernel_cache.kernel_mark("strain")
    assert (mark is None) == (kept_in == "a file")
    assert not (tmp_path / "no").exists()


def test_without_a_place_for_kernels_nothing_is_compiled_ahead(tmp_path, monkeypatch):
    monkeypatch.delenv(kernel_cache.VARIABLE, raising=False)
    monkeypatch.setattr(kernel_cache, "kernel_folder", lambda: None)
    assert kernel_cache.kernel_mark("strain") is None
    assert uncompiled({"found": Correlate()}) == {}


def test_the_names_are_those_of_stages_and_kernels():
    assert set(_kernels._USED) < node_classes()[0].keys()
    assert {name for names in _kernels._USED.values() for name in names} < KERNELS.keys()


@pytest.mark.slow
def test_after_warm_no_run_compiles(pipeline, tmp_path):
    """Of both ways to measure: the kernels kept by ``warm`` are all that a run needs."""
    probes = "probes.extensometers={length: [[215, 80], [215, 270]]}"
    precise = ROOT / "pipelines" / "quickstart.yaml", "--data", pipeline.parent, "--set", probes
    environment = {**os.environ, "HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop(kernel_cache.VARIABLE, None)

    def dicflow(*arguments):
        command = [sys.executable, "-m", "dicflow", *map(str, arguments)]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    def kept():
        return {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.nbc")}

    def warmed(*arguments):
        return [line.partition(":")[0] for line in dicflow("warm", *arguments).splitlines()]

    assert warmed("--workers", 2) == [*(f"kernels, {name}" for name in KERNELS), "modules", "source of the stages"]
    after = kept()
    assert len(after) >= len(KERNELS)
    for given in (precise, (pipeline,)):
        dicflow("run", *given, "--store", tmp_path / "store", "--output", tmp_path / "results")
    assert kept() == after
    assert warmed() == ["modules", "source of the stages"]
