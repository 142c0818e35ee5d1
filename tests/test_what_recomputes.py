"""Which stages an edit recomputes: those whose fingerprints cover what is edited."""

import ast
from pathlib import Path

import pytest

import dicflow
from dicflow.engine.files import FileIndex
from dicflow.engine.fingerprint import Sources
from dicflow.engine.source_code import code_of
from dicflow.pipeline.registry import node_class, stage_names

pytestmark = pytest.mark.slow

PACKAGE = Path(dicflow.__file__).parent

PRECISE = {"correlate", "stereo", "triangulate", "deformation", "probes", "frame"}
THESIS = {
    "rectify", "track", "disparity", "reconstruct", "fill", "surface", "displacement", "smooth", "strain", "accumulate",
}  # fmt: skip

RECOMPUTES = {
    "core.calibration": "calibrate corners scale",
    "core.cameras": "accumulate calibrate compare deformation disparity frame maps noise_floor probes reconstruct "
    "rectify refine region rig_file scale sheet stereo triangulate undistort",
    "core.channels": "channels compare curve probes stress",
    "core.correlation": "correlate match refine stereo track triangulate",
    "core.material": "curve hyperelastic sheet stress virtual_fields",
    "core.matching": "calibrate corners correlate disparity displacement features match refine region scale stereo "
    "track triangulate",
    "core.motion": "images",
    "core.photographs": "compare corners correlate disparity displacement features images probes reconstruct refine "
    "region sheet stereo track triangulate",
    "core.probes": "frame probes",
    "core.strain": "accumulate deformation probes sheet strain",
    "core.surfaces": "accumulate compare correlate deformation displacement fill probes reconstruct smooth "
    "strain surface",
    "core.uncertainty": "correlate deformation frame noise_floor probes sheet triangulate",
    "io.calibrations": "rig_file",
    "io.caliper": "compare stress",
    "io.images": "images region",
    "io.region": "region",
    "io.rig": "rig_file",
    "io.stress_table": "curve",
}
"""Chapter → the stages that an edit there may recompute. What is in no chapter, all may share."""


@pytest.fixture(scope="module")
def index(tmp_path_factory):
    """What is in the source files, read once."""
    return FileIndex(tmp_path_factory.mktemp("index") / "files.index")


def fingerprints(index):
    sources = Sources(index)
    classes = {name: node_class(name) for name in stage_names()}
    return {name: sources.fingerprint(cls, cls.uses(cls.model_construct())) for name, cls in classes.items()}


@pytest.fixture(scope="module")
def taken(index):
    """Fingerprint by stage."""
    return fingerprints(index)


def modules(fingerprint):
    """Modules that a fingerprint covers something of, without the name of the package."""
    return {name.partition(":")[0].removeprefix("dicflow.") for name in fingerprint.parts}


def covers(fingerprint, chapter):
    """Whether a fingerprint covers something of a chapter."""
    return any(f"{name}.".startswith(f"{chapter}.") for name in modules(fingerprint))


def test_every_chapter_of_core_has_its_line():
    chapters = {f"core.{path.parent.name}" for path in (PACKAGE / "core").glob("*/__init__.py")}
    assert chapters - {"core.synthetic"} == {name for name in RECOMPUTES if name.startswith("core.")}


@pytest.mark.parametrize("chapter", RECOMPUTES)
def test_an_edit_of_a_chapter_recomputes_only_what_uses_it(taken, chapter):
    assert {stage for stage, one in taken.items() if covers(one, chapter)} <= set(RECOMPUTES[chapter].split())


@pytest.mark.parametrize("stage", stage_names())
def test_a_stage_uses_nothing_above_it_and_of_the_engine_only_what_it_computes_with(taken, stage):
    found = modules(taken[stage])
    assert {name.partition(".")[0] for name in found} <= {
        "core",
        "discovery",
        "engine",
        "errors",
        "io",
        "kinds",
        "stages",
    }
    engine = {name for name in found if name.startswith("engine")}
    assert engine <= {"engine.node", "engine.product", "engine.units"}


@pytest.mark.parametrize("stage", stage_names())
def test_a_stage_is_nobody_elses_code(taken, stage):
    cls = node_class(stage)
    assert {other for other, one in taken.items() if f"{cls.__module__}:{cls.__name__}" in one.parts} == {stage}


@pytest.mark.parametrize("stage", stage_names())
def test_a_stage_uses_nothing_of_other_stages(taken, stage):
    others = {f"dicflow.stages.{name}" for name in stage_names() if name != stage}
    assert {name for name in taken[stage].parts if name.partition(":")[0] in others} == set()


@pytest.mark.parametrize(("form", "other"), [(PRECISE, THESIS), (THESIS, PRECISE)], ids=["precise", "thesis"])
def test_an_edit_of_one_form_of_the_pipeline_leaves_the_other_alone(taken, form, other):
    theirs = {f"dicflow.stages.{name}" for name in other}
    assert {name for stage in form for name in taken[stage].parts if name.partition(":")[0] in theirs} == set()


class Edited:
    """The source files with another body of one definition."""

    def __init__(self, index, name):
        self.index = index
        self.module, _, self.name = name.partition(":")

    def fact(self, file, purpose, find):
        code = self.index.fact(file, purpose, find)
        if not purpose.endswith(f":{self.module}"):
            return code
        _, targets = code["definitions"][self.name]
        return {**code, "definitions": {**code["definitions"], self.name: ["edited", targets]}}


@pytest.mark.parametrize("number", range(8))
def test_an_edit_changes_exactly_the_fingerprints_that_name_it(index, taken, number):
    names = sorted({name for one in taken.values() for name in one.parts if ":" in name})
    edited = names[len(names) * number // 8]
    after = fingerprints(Edited(index, edited))
    changed = {stage for stage in taken if after[stage] != taken[stage]}
    assert changed == {stage for stage, one in taken.items() if edited in one.parts}
    assert changed


class Reworded(ast.NodeTransformer):
    """Other docstrings, messages of errors and annotations of functions."""

    def visit_Expr(self, node):
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return ast.Expr(ast.Constant("other words")) if is_text else self.generic_visit(node)

    def visit_Raise(self, node):
        if isinstance(node.exc, ast.Call) and ast.unparse(node.exc.func).endswith("Error"):
            node.exc.args.append(ast.Constant("other words"))
        return node

    def visit_arg(self, node):
        words = ast.Constant("other words")
        return ast.arg(node.arg, node.annotation and ast.Tuple([node.annotation, words]))


@pytest.mark.parametrize("layer", ["core", "engine", "errors.py", "io", "stages"])
def test_words_recompute_nothing(tmp_path, layer):
    files = (PACKAGE / layer).rglob("*.py") if (PACKAGE / layer).is_dir() else [PACKAGE / layer]
    for path in files:
        module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        other = tmp_path / path.name
        other.write_text(ast.unparse(Reworded().visit(ast.parse(path.read_text()))))
        assert code_of(other, module) == code_of(path, module), path
