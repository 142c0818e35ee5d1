import sys
import types
from pathlib import Path

import pytest
import toys

from dicflow.engine.files import FileIndex
from dicflow.engine.fingerprint import fingerprint
from dicflow.errors import ConfigurationError

STAGE = '''"""A stage."""
from typing import TYPE_CHECKING
from sample_package import helper
if TYPE_CHECKING:
    from sample_package import shown
import numpy
class Stage:
    """What it does."""
    title: str = "a title"
    degree = parameter(2, "description")
    def run(self):
        from .inner import deep
        from dicflow.engine import store
        import dicflow.engine.units
        return deep.value + helper.value
'''


@pytest.fixture
def package(tmp_path):
    """A package of a stage, its helpers, and modules that it does not use."""
    root = tmp_path / "sample_package"
    (root / "inner").mkdir(parents=True)
    files = {"__init__": "", "stage": STAGE, "helper": "value = 1", "shown": "x = 1", "other": "y = 1"}
    files |= {"inner/__init__": "", "inner/deep": "import sample_package.helper\nvalue = 2"}
    for name, text in files.items():
        (root / f"{name}.py").write_text(text)
    return root


def taken(package):
    """Fingerprint of the stage, which is never run."""
    module = types.ModuleType("sample_package.stage")
    module.__file__ = str(package / "stage.py")
    sys.modules[module.__name__] = module
    try:
        return fingerprint(type("Stage", (), {"__module__": module.__name__}), FileIndex(package / "index"))
    finally:
        del sys.modules[module.__name__]


def test_it_covers_what_is_imported_anywhere_but_for_type_checkers(package):
    modules = {"stage", "helper", "inner.deep"}
    assert set(taken(package)) == {"dicflow.engine.units", *(f"sample_package.{name}" for name in modules)}


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("helper.py", "value = 1", '"""Doc."""\n# why\nvalue = (\n    1\n)'),
        ("stage.py", "What it does", "What it does, in other words"),
        ("stage.py", "a title", "another title"),
        ("stage.py", '"description"', '"a better description"'),
        ("shown.py", "x = 1", "x = 2"),
        ("other.py", "y = 1", "y = 2"),
    ],
)
def test_cosmetic_edits_do_not_count(package, file, old, new):
    before = taken(package)
    text = (package / file).read_text()
    assert old in text
    (package / file).write_text(text.replace(old, new))
    assert taken(package) == before


@pytest.mark.parametrize(
    ("file", "old", "new", "module"),
    [
        ("helper.py", "value = 1", "value = 3", "helper"),
        ("inner/deep.py", "value = 2", "value = 4", "inner.deep"),
        ("stage.py", "parameter(2,", "parameter(3,", "stage"),
    ],
)
def test_edits_of_the_code_count_where_they_are(package, file, old, new, module):
    before = taken(package)
    (package / file).write_text((package / file).read_text().replace(old, new))
    after = taken(package)
    assert [name for name in after if after[name] != before[name]] == [f"sample_package.{module}"]


def test_real_stages_have_one():
    found = fingerprint(toys.Scale, FileIndex(Path("/nowhere/index")))
    assert {"toys", "dicflow.engine.node", "dicflow.errors"} <= set(found)
    assert "dicflow.engine.store" not in found


def test_a_class_from_nowhere_is_refused():
    nowhere = type("Nowhere", (), {"__module__": "nowhere"})
    with pytest.raises(ConfigurationError, match="put the stage into a module"):
        fingerprint(nowhere, FileIndex(Path("/nowhere/index")))
