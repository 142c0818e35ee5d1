"""Install the wheel under every Python that is here, each in an empty environment, and measure the demonstration.

Run it with ``make versions``. Interpreters are looked for on the path and among those of pyenv.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

__all__ = ["interpreters"]

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.11", "3.12", "3.13")


def interpreters() -> dict[str, Path]:
    """Version → an interpreter that runs."""
    found: dict[str, Path] = {}
    for version in VERSIONS:
        pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
        on_path = shutil.which(f"python{version}")
        for place in [*([Path(on_path)] if on_path else []), *sorted(pyenv.glob(f"{version}.*/bin/python"))]:
            if subprocess.run([place, "-c", ""], capture_output=True).returncode == 0:
                found.setdefault(version, place)
    return found


def measures_the_demonstration(python: Path, wheel: Path, folder: Path) -> bool:
    """Whether the wheel, installed into an environment of its own, ends the demonstration with a report."""
    subprocess.run([python, "-m", "venv", folder / "environment"], check=True)
    inside = folder / "environment" / "bin"
    quiet = ["--quiet", "--disable-pip-version-check"]
    subprocess.run([inside / "python", "-m", "pip", "install", *quiet, wheel], check=True)
    done = subprocess.run([inside / "dicflow", "demo", "demo"], cwd=folder, capture_output=True, text=True)
    print(*done.stderr.splitlines()[-4:], sep="\n")
    return done.returncode == 0 and (folder / "demo" / "results" / "pipeline" / "report.html").is_file()


def main() -> int:
    """Print a line per version; returns 1 where one fails."""
    failed = False
    with TemporaryDirectory() as place:
        build = [sys.executable, "-m", "build", "--wheel", "--outdir", place, ROOT]
        subprocess.run(build, check=True, capture_output=True)
        (wheel,) = Path(place).glob("*.whl")
        for version, python in interpreters().items():
            folder = Path(place) / version
            folder.mkdir()
            passed = measures_the_demonstration(python, wheel, folder)
            failed |= not passed
            print(f"Python {version}: {'ok' if passed else 'FAILED'}", flush=True)
            shutil.rmtree(folder)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
