"""The walls between the layers, and between the chapters of core, read from the source."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Set
from functools import cache

from tests.measure import (
    Module,
    arrows,
    chapter_of,
    circle,
    common_ground,
    import_nodes,
    imported_modules,
    imported_names,
    layer_of,
    read_package,
)

LAYERS = (
    "core",
    "engine",
    "kinds",
    "io",
    "stages",
    "pipeline",
    "comparison",
    "start",
    "tuning",
    "synth",
    "views",
    "explorer",
    "report",
    "app",
    "cli",
)
"""Lowest first; a layer imports only itself and those before it, and the engine nothing of core."""

COMMON = {"discovery", "errors", "_version"}
ENTRANCES = {"", "__main__"}
"""The package itself and its program, which import what they show."""

NUMERICS = {"numpy", "scipy", "numba", "cv2"}
CORE_LIBRARIES = NUMERICS | {
    "__future__",
    "collections",
    "concurrent",
    "dataclasses",
    "dicflow",
    "enum",
    "functools",
    "itertools",
    "math",
    "typing",
}
ONLY_IN: Mapping[str, Set[str]] = {
    "dask": {"engine"},
    "distributed": {"engine"},
    "dask_jobqueue": {"engine"},
    "numcodecs": {"engine"},
    "zarr": {"engine", "pipeline"},
    "pandas": {"pipeline"},
    "matplotlib": {"views"},
    "bokeh": {"views"},
    "pyvista": {"views"},
    "h5py": {"io"},
    "meshio": {"io"},
    "obstore": {"io"},
    "openpyxl": {"io"},
    "jinja2": {"report"},
    "markupsafe": {"report"},
    "pydantic": {"engine", "stages", "pipeline"},
    "typer": {"cli"},
    "rich": {"cli", "views"},
    "ruamel": {"io"},
    "tornado": {"app"},
    "watchfiles": {"io"},
}
"""The layers that import a library."""

CHAPTERS: Mapping[str, Set[str]] = {
    "channels": set(),
    "photographs": set(),
    "motion": set(),
    "cameras": set(),
    "matching": {"photographs"},
    "calibration": {"cameras", "matching", "photographs"},
    "correlation": {"cameras", "matching", "photographs"},
    "uncertainty": {"cameras"},
    "surfaces": {"matching", "photographs", "uncertainty"},
    "strain": {"cameras", "surfaces", "uncertainty"},
    "probes": {"strain", "surfaces", "uncertainty"},
    "synthetic": {"calibration", "cameras"},
    "material": set(),
}
"""The chapters of core, each with those that it imports. All may import core's single modules, which import none."""

ASSIGNED: Set[str] = set()
"""Modules that set an attribute of what they import from another layer."""


@cache
def modules() -> Mapping[str, Module]:
    return read_package()


def test_a_layer_imports_only_those_below_it():
    allowed = {layer: {*COMMON, *LAYERS[: k + 1]} for k, layer in enumerate(LAYERS)}
    allowed["engine"].remove("core")
    allowed |= {name: COMMON for name in COMMON} | {name: {*COMMON, *LAYERS} for name in ENTRANCES}
    assert allowed.keys() == {layer_of(name) for name in modules()}
    pairs = [(name, target) for name, module in modules().items() for target in _imports(module)]
    assert not [f"{name} imports {target}" for name, target in pairs if layer_of(target) not in allowed[layer_of(name)]]


def test_libraries_stay_in_their_layer():
    used = {(name, library) for name, module in modules().items() for library in _libraries(import_nodes(module.tree))}
    misplaced = sorted((name, library) for name, library in used if not _may_import(layer_of(name), library))
    assert not [f"{name} imports {library}" for name, library in misplaced]


def test_chapters_of_core_import_those_of_the_table():
    found, common = arrows(modules(), chapter_of), common_ground(modules())
    between = {pair: sorted(imports) for pair, imports in found.items() if pair[1] not in common}
    table = {(chapter, other) for chapter, others in CHAPTERS.items() for other in others}
    assert CHAPTERS.keys() == {chapter_of(name) for name in modules()} - {None, *common}
    assert not [imports for pair, imports in between.items() if pair not in table]
    assert not table - between.keys(), "arrows in the table that no import draws"
    assert not circle(found)


def test_folders_of_core_hold_only_a_docstring_in_their_init():
    inits = [
        module for name, module in modules().items() if layer_of(name) == "core" and module.path.stem == "__init__"
    ]
    assert len(inits) == 1 + len(CHAPTERS)
    assert not [module.name for module in inits if len(module.tree.body) != 1 or not ast.get_docstring(module.tree)]


def test_stages_and_kinds_load_no_numerics_before_they_work():
    heavy = {name for name, module in modules().items() if NUMERICS & _libraries(_top_imports(module))}
    light = {name: _loaded_with(name) for name in modules() if layer_of(name) in ("stages", "kinds")}
    assert not [f"{name} loads {sorted(heavy & loaded)}" for name, loaded in light.items() if heavy & loaded]


def test_no_module_sets_attributes_in_another_layer():
    assert {f"{name} sets {target}" for name, module in modules().items() for target in _assigned(module)} == ASSIGNED


def _imports(module: Module) -> list[str]:
    return imported_modules(import_nodes(module.tree), modules())


def _libraries(nodes: list[ast.Import | ast.ImportFrom]) -> set[str]:
    return {name.partition(".")[0] for node in nodes for name in imported_names(node)}


def _may_import(layer: str, library: str) -> bool:
    return layer in ONLY_IN.get(library, {layer}) and (layer != "core" or library in CORE_LIBRARIES)


def _top_imports(module: Module) -> list[ast.Import | ast.ImportFrom]:
    return [node for node in module.tree.body if isinstance(node, ast.Import | ast.ImportFrom)]


def _loaded_with(name: str) -> set[str]:
    """The modules that importing a module loads, itself included."""
    loaded: set[str] = set()
    waiting = [name]
    while waiting:
        name = waiting.pop()
        if name not in loaded:
            loaded.add(name)
            waiting += imported_modules(_top_imports(modules()[name]), modules())
    return loaded


def _assigned(module: Module) -> list[str]:
    """Attributes, as ``Name.attribute``, that a module sets on names imported from other layers of the package."""
    nodes = [node for node in import_nodes(module.tree) if _is_foreign(node, module)]
    names = {alias.asname or alias.name.partition(".")[0] for node in nodes for alias in node.names}
    attributes = [node for node in ast.walk(module.tree) if isinstance(node, ast.Attribute)]
    written = [ast.unparse(node) for node in attributes if isinstance(node.ctx, ast.Store)]
    return [target for target in written if target.partition(".")[0] in names]


def _is_foreign(node: ast.Import | ast.ImportFrom, module: Module) -> bool:
    return any(layer_of(name) != layer_of(module.name) for name in imported_modules([node], modules()))
