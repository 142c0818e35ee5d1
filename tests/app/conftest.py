"""One browser for all tests of the app's page, and tests that are measured once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from app_browser import close_browser
from app_serving import FILE, measure, small_test
from small import dicflow

from tests.made_once import copy_of_store

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
    path = small_test(tmp_path_factory.mktemp("small_result") / "test", steps=3)
    assert dicflow("run", path, "--scheduler", "sync").code == 0
    return path


@pytest.fixture(scope="session")
def sample_result(quickstart_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pipeline file of the sample that the command line has measured with two cameras; to be copied for changes."""
    path = tmp_path_factory.mktemp("sample_result") / "test" / FILE
    shutil.copytree(ROOT / "data_samples", path.parent)
    shutil.copy(ROOT / "pipelines" / "quickstart.yaml", path)
    copy_of_store(quickstart_store, path.parent / ".dicflow")
    measure(path)
    return path
