"""What is done ahead of the first run."""

import sys
from importlib.util import cache_from_source
from pathlib import Path

import pytest

from dicflow.pipeline import warm

PACKAGE = Path(warm.__file__).parents[1]


@pytest.mark.slow
def test_every_module_has_bytecode(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert warm._compiled_modules().startswith("modules: ")
    kept = {Path(cache_from_source(str(path))) for path in PACKAGE.rglob("*.py")}
    assert kept == set(tmp_path.rglob("*.pyc"))
