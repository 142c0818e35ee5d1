"""The report on paper: a page as a PDF, printed by a browser of this machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from dicflow.engine.whole_file import read_file
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.files import write_whole

__all__ = ["find_browser", "write_pdf"]

_NAMES = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge",
    "microsoft-edge-stable", "msedge",
)  # fmt: skip
_MAC_PROGRAMS = ("Google Chrome", "Chromium", "Microsoft Edge")
_WINDOWS_PROGRAMS = ("Google/Chrome/Application/chrome.exe", "Microsoft/Edge/Application/msedge.exe")
_PATIENCE_S = 120
_WAIT_MS = 20_000
"""Time of the page's clock in which it may draw; the browser does not wait that long in truth."""
_REMEDY = "install Chromium, Google Chrome or Microsoft Edge, or print report.html from any browser"


def write_pdf(page: Path, appendix: bool = False) -> Path:
    """Print a page on A4, and return the path of the PDF beside it.

    appendix : whether all of it is printed, or what a reader needs first
    Raises ConfigurationError without a browser, InputError that names the PDF if it cannot be made.
    """
    browser = find_browser()
    if browser is None:
        raise ConfigurationError(f"a PDF needs a browser, and none was found; {_REMEDY}")
    target = page.with_suffix(".pdf")
    with TemporaryDirectory(prefix="print-", dir=page.parent) as folder:
        made = Path(folder) / "page.pdf"
        _print(browser, page.resolve().as_uri() + ("?appendix" if appendix else ""), made)
        try:
            content = read_file(made)
        except OSError as error:
            raise InputError(str(target), f"{browser} made no PDF", _REMEDY) from error
    write_whole(target, content)
    return target


def find_browser() -> str | None:
    """Path of Chromium, Chrome or Edge; None if none is found."""
    on_path = (found for name in _NAMES if (found := shutil.which(name)))
    return next(on_path, None) or next((str(place) for place in _usual_places() if place.is_file()), None)


def _usual_places() -> Iterator[Path]:
    """Where these browsers are installed without being on the path."""
    system: str = sys.platform
    if system == "darwin":
        for folder in (Path("/Applications"), Path.home() / "Applications"):
            yield from (folder / f"{name}.app/Contents/MacOS/{name}" for name in _MAC_PROGRAMS)
    elif system == "win32":
        for variable in ("PROGRAMFILES", "PROGRAMFILES(X86)", "LOCALAPPDATA"):
            if root := os.environ.get(variable):
                yield from (Path(root) / name for name in _WINDOWS_PROGRAMS)


def _print(browser: str, address: str, target: Path) -> None:
    """Let the browser write the PDF, with a profile of its own, and without the network."""
    as_root = hasattr(os, "geteuid") and os.geteuid() == 0
    command = [
        browser, "--headless=new", "--disable-gpu", "--no-first-run", "--disable-extensions",
        "--window-size=1280,1000", "--force-device-scale-factor=2",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={target.parent / 'profile'}",
        f"--virtual-time-budget={_WAIT_MS}", "--no-pdf-header-footer", f"--print-to-pdf={target}",
        *(["--no-sandbox"] if as_root else []),  # the browser refuses to start as root with it
        address,
    ]  # fmt: skip
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=_PATIENCE_S)
    except subprocess.TimeoutExpired as error:
        raise InputError(address, f"{browser} has not printed it after {_PATIENCE_S} s", _REMEDY) from error
    except (OSError, subprocess.CalledProcessError) as error:
        raise InputError(address, f"{browser} cannot print it ({type(error).__name__})", _REMEDY) from error
