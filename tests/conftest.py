"""Fixtures that all tests share."""

from __future__ import annotations

import gc
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from dicflow.engine.kernel_cache import keep_kernels
from tests.data_folder import SHARED
from tests.made_once import made_once
from tests.threads import wait_for_threads

ROOT = Path(__file__).resolve().parents[1]
_PATIENCE_S = 60.0
_ALL_SLOW = re.compile(r"^pytestmark = \[?\s*pytest\.mark\.slow\b", re.MULTILINE)

settings.register_profile("dependable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("dependable")  # the same examples each time, however long they take on a busy machine

keep_kernels()  # for this process and those that tests start, so that each kernel is compiled once


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real photographs with truth or references; the test is skipped without it."""
    if not SHARED.is_dir():
        pytest.skip(f"needs the real photographs in {SHARED}; DICFLOW_DATA names another folder")
    return SHARED


@pytest.fixture(scope="session")
def pipeline(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pipeline file beside the photographs of a small experiment; its folder is to be copied before it is changed."""
    from small import photograph_experiment

    photographed = made_once(tmp_path_factory, "experiment", photograph_experiment)
    return shutil.copytree(photographed, tmp_path_factory.mktemp("experiment") / "small") / "quickstart.yaml"


@pytest.fixture(scope="session")
def measured(pipeline: Path) -> Path:
    """The store of that pipeline with all its products, and its pictures in ``results/quickstart`` beside it.

    Whoever adds runs to it takes a copy.
    """
    command = [sys.executable, "-m", "dicflow", "run", pipeline, "--scheduler", "sync", "--workers", "1"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return pipeline.parent / ".dicflow"


@pytest.fixture(scope="session")
def quickstart_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of the quick start on the sample with all its products; whoever adds to it takes a copy."""
    from dicflow.pipeline import Pipeline

    def measure(store: Path) -> None:
        loaded = Pipeline.load(ROOT / "pipelines" / "quickstart.yaml", data=ROOT / "data_samples", store=store)
        result = loaded.run(scheduler="threads", workers=2)
        assert result.outcome.ok, result.outcome.errors

    return made_once(tmp_path_factory, "quickstart_store", measure)


@pytest.fixture
def copied(pipeline: Path, measured: Path, tmp_path: Path) -> Path:
    """The pipeline and its store in a folder that may be changed."""
    shutil.copytree(pipeline.parent, tmp_path / "copy", ignore=shutil.ignore_patterns("results"))
    return tmp_path / "copy" / pipeline.name


@pytest.fixture
def boards_recognised_once(monkeypatch):
    """Which board a photograph shows is found once for all tests of this process that use the same photographs."""
    from tests.boards_once import recognise_boards_once

    recognise_boards_once(monkeypatch)


@pytest.fixture(autouse=True)
def _files_of_tests_are_trusted(monkeypatch):
    """Files that a test has just written count as written long ago; the system's own time of them cannot be set."""
    monkeypatch.setattr("dicflow.engine.files._FRESH_NS", -1)


@pytest.fixture(autouse=True)
def _source_files_are_remembered_in_the_store(monkeypatch):
    """What tests find in source files stays with their stores: some change it."""
    monkeypatch.setattr("dicflow.engine.fingerprint.account_folder", lambda: None)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Generator[None]:
    """A test ends when the threads have ended that it has started."""
    yield
    wait_for_threads(_PATIENCE_S)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Without the slow tests, a file that has no others is not even imported."""
    if config.option.markexpr != "not slow" or collection_path.suffix != ".py":
        return None
    return bool(_ALL_SLOW.search(collection_path.read_text(encoding="utf-8"))) or None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is imported and collected stays to the end, so that nobody looks for garbage there."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A test of the small experiment is slow, because the first one renders its photographs and measures them.

    Files with slow tests begin first, and of these and of the others those of few tests, which take longest: at the end
    of the run all processes have something to do.
    """
    for item in items:
        if "pipeline" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)
    tests = Counter(item.path for item in items)
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path not in slow, tests[item.path]))
