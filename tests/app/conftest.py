"""One browser for all tests of the app's page, and tests that are measured once."""

from __future__ import annotations

from pathlib import Path

import pytest
from app_browser import close_browser
from app_serving import small_test
from small import dicflow

HERE = Path(__file__).parent


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
