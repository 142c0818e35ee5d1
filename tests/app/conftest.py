"""One browser for all tests of the app's page, and tests that are measured once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from app_browser import close_browser
from app_serving import FILE, measure, small_test
from small import dicflow

from tests.made_once import copy_of_store, made_once

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Close the browser behind the last of these tests."""
    if nextitem is None or HERE not in nextitem.path.parents:
        close_browser()


@pytest.fixture(scope="session")
def small_result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pipeline file of a small test of three steps that the command line has measured; to be copied for changes."""

    def make(folder: Path) -> None:
        assert dicflow("run", small_test(folder, steps=3), "--scheduler", "sync").code == 0

    return _copy_of(made_once(tmp_path_factory, "small_result", make), tmp_path_factory)


@pytest.fixture(scope="session")
def sample_result(quickstart_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pipeline file of the sample that the command line has measured with two cameras; to be copied for changes."""

    def make(folder: Path) -> None:
        shutil.copytree(ROOT / "data_samples", folder, dirs_exist_ok=True)
        shutil.copy(ROOT / "pipelines" / "quickstart.yaml", folder / FILE)
        copy_of_store(quickstart_store, folder / ".dicflow")
        measure(folder / FILE)

    return _copy_of(made_once(tmp_path_factory, "sample_result", make), tmp_path_factory)


def _copy_of(folder: Path, factory: pytest.TempPathFactory) -> Path:
    """The pipeline file of a copy for this process, in which its server may write."""
    return shutil.copytree(folder, factory.mktemp(folder.name) / "test") / FILE
