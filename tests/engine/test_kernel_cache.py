"""The folder of compiled kernels: its name, and who may write it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

import pytest

from dicflow.engine import kernel_cache
from dicflow.engine.kernel_cache import VARIABLE, keep_kernels, kernel_folder


@pytest.fixture
def home(tmp_path, monkeypatch):
    """An account whose cache and temporary files lie in a folder of the test."""
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", VARIABLE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path / "home"


def package(folder, **modules):
    """A package with chapters ``core/…``. modules : name → text"""
    for name, text in modules.items():
        path = folder / "core" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def test_the_name_changes_with_a_kernel_and_with_what_its_module_imports(tmp_path):
    kernel = "from numba import njit\nfrom dicflow.core.records import Point\n"
    texts = {"kernel": kernel, "records": "from dicflow.core.status import Status\n", "status": "A = 1\n"}
    digest = kernel_cache._digest(package(tmp_path / "a", **texts, other="x = 1\n"))
    assert digest == kernel_cache._digest(package(tmp_path / "b", **texts, other="x = 2\n"))
    for name in texts:
        changed = {**texts, name: texts[name] + "B = 2\n"}
        assert kernel_cache._digest(package(tmp_path / name, **changed)) != digest


def test_the_folder_is_in_the_cache_of_the_account(home):
    folder = kernel_folder()
    assert folder.parent == home / ".cache" / "dicflow"
    assert folder.parent.stat().st_mode & 0o777 == 0o700


def test_without_a_home_it_is_among_temporary_files(home, tmp_path):
    home.write_text("not a folder")
    assert kernel_folder().parent == tmp_path / "temporary" / f"dicflow-{os.geteuid()}"


@pytest.mark.parametrize("spoil", ["writable by others", "link", "of another account"])
def test_a_folder_that_others_may_have_filled_is_not_used(home, tmp_path, spoil):
    """What is in it runs as code."""
    home.write_text("not a folder")
    place = tmp_path / "temporary" / f"dicflow-{os.geteuid()}"
    (tmp_path / "elsewhere").mkdir()
    if spoil == "link":
        place.symlink_to(tmp_path / "elsewhere")
    else:
        place.mkdir(mode=0o700)
    if spoil == "writable by others":
        place.chmod(0o777)
    if spoil == "of another account":
        if os.geteuid() != 0:
            pytest.skip("only root can give a folder away")
        os.chown(place, 65534, 65534)
    assert kernel_folder() is None


def folder_of_kernels(folder, days):
    """One with a kernel that was used last so many days ago."""
    (folder / "core").mkdir(parents=True)
    (folder / "core" / "kernel.nbi").touch()
    os.utime(folder, (time.time() - 86400 * days,) * 2)
    return folder


def test_kernels_of_other_sources_that_nobody_uses_are_deleted(home, monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    place = kernel_folder().parent
    old, recent = (folder_of_kernels(place / f"kernels-{digit * 16}", days) for digit, days in (("1", 31), ("2", 29)))
    others = [folder_of_kernels(place / name, 1000) for name in ("kernels-3", "thesis", "kernels-" + "g" * 16)]
    target = folder_of_kernels(tmp_path / "elsewhere", 1000)
    (place / ("kernels-" + "4" * 16)).symlink_to(target)
    own = folder_of_kernels(kernel_folder(), 1000)
    keep_kernels()
    assert not old.exists()
    assert all((one / "core" / "kernel.nbi").exists() for one in (recent, target, own, *others))
    assert time.time() - own.stat().st_mtime < 86400, "its use is noted"


def test_a_choice_of_the_environment_is_kept(home, monkeypatch):
    monkeypatch.setenv(VARIABLE, "/mine")
    keep_kernels()
    assert os.environ[VARIABLE] == "/mine"


KERNELS = """
import os
from dicflow.engine.kernel_cache import keep_kernels
keep_kernels()
from dicflow.core.surfaces import filters
from numba.core.dispatcher import Dispatcher
kernels = [one for one in vars(filters).values() if isinstance(one, Dispatcher)]
kernels = [one for one in kernels if not one.targetoptions.get("no_cpython_wrapper")]
print({os.path.dirname(kernel.stats.cache_path) for kernel in kernels})
"""


def test_kernels_are_kept_there_without_a_home(home, tmp_path):
    home.write_text("not a folder")
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    done = subprocess.run([sys.executable, "-c", KERNELS], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str({str(kernel_folder())})


def test_kernels_load_without_scipys_linear_algebra():
    """Which numba loads to see whether it is there; afterwards numba looks for it as before."""
    code = """
import sys
from numba import njit
from numba.np import linalg
from dicflow.core import kernels
assert njit(lambda x: x + 1)(1) == 2
assert not any(name.startswith("scipy.linalg") for name in sys.modules)
linalg.ensure_blas()
assert "scipy.linalg" in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)
