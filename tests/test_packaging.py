"""The files of a release agree with the project, and hold all that an installation needs."""

from __future__ import annotations

import re
import tomllib

import pytest
import yaml
from small import ROOT

from dicflow._version import __version__

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
NEEDED = PROJECT["project"]["dependencies"]
CONDA = {"dask[distributed]": "dask-core", "matplotlib": "matplotlib-base", "opencv-python-headless": "py-opencv"}
"""Packages with another name at conda-forge."""


def bound(requirement: str) -> tuple[str, str]:
    """Name and versions of a requirement, without blanks, the name as conda has it."""
    name, versions = re.fullmatch(r"([\w\[\]-]+)\s*(.*)", requirement).groups()
    return CONDA.get(name, name).lower(), versions.replace(" ", "")


def test_the_version_stands_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    recipe = yaml.safe_load((ROOT / "packaging" / "recipe.yaml").read_text(encoding="utf-8"))
    title = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert {citation["version"], recipe["context"]["version"]} == {__version__}
    assert __version__.removesuffix(".dev0") == title


def test_the_conda_recipe_needs_what_the_wheel_needs():
    recipe = yaml.safe_load((ROOT / "packaging" / "recipe.yaml").read_text(encoding="utf-8"))
    python, *others = map(bound, recipe["requirements"]["run"])
    assert python == ("python", PROJECT["project"]["requires-python"])
    assert set(others) - {("distributed", ">=2025.1")} == set(map(bound, NEEDED))


def test_the_wheel_says_that_it_is_typed():
    assert (ROOT / "dicflow" / "py.typed").is_file()
    assert "Typing :: Typed" in PROJECT["project"]["classifiers"]


@pytest.mark.parametrize("name", ["README.md", "LICENSE", "CITATION.cff", "CONTRIBUTING.md", "CODE_OF_CONDUCT.md"])
def test_the_sdist_takes_the_files_of_a_repository_along(name):
    assert (ROOT / name).is_file()
    assert name in PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]


def test_the_image_measures_as_an_account_without_rights():
    lines = (ROOT / "packaging" / "Dockerfile").read_text(encoding="utf-8").splitlines()
    words = [line.split()[0] for line in lines if line and not line.startswith(("#", " "))]
    assert words.index("USER") < words.index("ENTRYPOINT")
    assert words.count("FROM") == 2
