"""The walls between the layers, read from the source."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "dicflow"

LAYERS = ("core", "engine", "io", "stages", "pipeline", "synth", "views", "report", "cli")
"""Lowest first; a layer imports only what stands below it, and itself."""

COMMON = {"errors", "_version"}
ONLY_IN = {
    "dask": {"engine"},
    "distributed": {"engine"},
    "zarr": {"engine"},
    "numcodecs": {"engine"},
    "matplotlib": {"views"},
    "bokeh": {"views"},
    "pyvista": {"views"},
    "h5py": {"io"},
    "meshio": {"io"},
    "jinja2": {"report"},
    "markupsafe": {"report"},
    "pydantic": {"engine", "stages", "pipeline"},
    "typer": {"cli"},
    "rich": {"cli", "views"},
}
CORE_MAY_USE = {"numpy", "scipy", "numba", "cv2"}
STANDARD_IN_CORE = {
    "__future__",
    "collections",
    "concurrent",
    "dataclasses",
    "enum",
    "functools",
    "itertools",
    "math",
    "typing",
}

SOURCES = sorted(PACKAGE.rglob("*.py"))


def _layer(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imports(path: Path) -> set[str]:
    """Full names of everything imported, at the top, inside functions and for type checkers alike."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_only_what_stands_below(path):
    layer = _layer(path)
    if layer not in LAYERS:
        return
    allowed = COMMON | set(LAYERS[: LAYERS.index(layer) + 1])
    if layer == "engine":
        allowed -= {"core"}
    inner = {name.split(".")[1] for name in _imports(path) if name.startswith("dicflow.")}
    assert inner <= allowed, f"{layer} may not import {inner - allowed}"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_libraries_stay_in_their_layer(path):
    roots = {name.split(".")[0] for name in _imports(path)}
    misplaced = {root for root in roots & ONLY_IN.keys() if _layer(path) not in ONLY_IN[root]}
    assert not misplaced
    if _layer(path) == "core":
        assert roots <= CORE_MAY_USE | STANDARD_IN_CORE | {"dicflow"}


@pytest.mark.parametrize("path", sorted((PACKAGE / "stages").glob("[a-z]*.py")), ids=lambda path: path.stem)
def test_a_stage_loads_no_numerics_before_it_runs(path):
    top = {
        name.split(".")[0]
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""])
    }
    assert not top & {"numpy", "scipy", "cv2", "numba"}


def test_every_layer_is_known():
    assert {_layer(path) for path in SOURCES} <= {*LAYERS, *COMMON, "__init__", "__main__"}
