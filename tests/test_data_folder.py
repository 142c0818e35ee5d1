"""The folder of the real photographs."""

from pathlib import Path

import pytest

from tests import data_folder


@pytest.mark.parametrize(("given", "found"), [("/elsewhere", Path("/elsewhere")), ("", data_folder.BESIDE)])
def test_the_environment_names_it(monkeypatch, given, found):
    monkeypatch.setenv("DICFLOW_DATA", given)
    assert data_folder.shared() == found
