"""Stages, formats and sections that another package brings, and those that are a file more of ours."""

import json
import re

import numpy as np
import pytest
from PIL import Image

from dicflow.discovery import Registry
from dicflow.errors import ConfigurationError
from tests.installed import Site

STAGE = '''
from typing import ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product

class Brightness(Node):
    """Measure the brightness of a photograph."""

    title: ClassVar = "mean grey level"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images")}
    gives: ClassVar = "brightness"
    stage: Literal["brightness"] = "brightness"
    offset: float = parameter(0.0, "added to the mean", unit="grey levels", ge=0)

    def run(self, images):
        from toys.grey import mean

        return Product("brightness", {}, {"mean": mean(images["left"]) + self.offset})
'''
GREY = "def mean(image):\n    return float(image.mean())\n"
CALIBRATION = """
import numpy as np

from dicflow.io.calibrations.draft import Draft, DraftCamera

PROGRAM = "Toy"

def recognises(source):
    return source.text.startswith("TOY ")

def parse(source):
    focal, baseline = (float(word) for word in source.text.split()[1:])
    camera = DraftCamera(np.array([[focal, 0, 15.5], [0, focal, 11.5], [0, 0, 1]]), np.zeros(5), (32, 24))
    return Draft(PROGRAM, camera, camera, np.eye(3), np.array([-baseline, 0, 0]))
"""
EXPORT = """
DESCRIPTION = "one line per product"
KINDS = None
BESIDE = ("rig",)

def write(items, folder, name):
    with open(folder / f"{name}.toy", "w") as file:
        for item in items:
            file.write(f"{item.stem} {item.product.kind}\\n")
"""
SECTION = """
from markupsafe import Markup

from dicflow.report.context import Section

PLACE = 45
TITLE = "Brightness of the photographs"

def brightness(context):
    return Section("brightness", TITLE, Markup("<p>{} steps</p>").format(len(context.result.steps("brightness"))))
"""
SCHEDULER = """
from contextlib import contextmanager
from pathlib import Path

from dicflow.engine.work import Defect, perform

class Backend:
    link = ""

    def compute(self, jobs, outcomes, finished):
        for job in jobs:
            try:
                finished(perform(job, *job.known_inputs(outcomes)))
            except Defect as defect:
                finished(job.outcome("failed", error=str(defect)))

@contextmanager
def queue(options):
    print("opened", options.scheduler, options.workers)
    yield Backend()
"""
POINTS = {
    "dicflow.stages": {"brightness": "toys.stage:Brightness"},
    "dicflow.calibrations": {"toy": "toys.calibration"},
    "dicflow.exports": {"toy": "toys.export"},
    "dicflow.report_sections": {"brightness": "toys.section"},
    "dicflow.schedulers": {"queue": "toys.scheduler:queue"},
}
MODULES = {
    "__init__": "",
    "stage": STAGE,
    "grey": GREY,
    "calibration": CALIBRATION,
    "export": EXPORT,
    "scheduler": SCHEDULER,
}
FILES = {f"toys/{name}.py": text for name, text in {**MODULES, "section": SECTION}.items()}
BROKEN = "import a_package_that_is_missing\n"
GROUPS = (*POINTS,)
PIPELINE = """\
stages:
  photos: {stage: images, left: "left/*.png", right: "right/*.png"}
  rig: {stage: rig_file, file: rig.toy}
  brightness: {stage: brightness, offset: 1}
"""


@pytest.fixture
def site(tmp_path):
    made = Site(tmp_path / "site")
    made.install("toys", FILES, POINTS)
    return made


@pytest.fixture
def pipeline(tmp_path):
    """Photographs of 10 and 20 grey levels, and a calibration in the toy format."""
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for step in (1, 2):
            Image.fromarray(np.full((24, 32), 10 * step, np.uint8)).save(tmp_path / side / f"{step}.png")
    (tmp_path / "rig.toy").write_text("TOY 400 80\n")
    (tmp_path / "toy.yaml").write_text(PIPELINE)
    return tmp_path / "toy.yaml"


def shown(site, pipeline, *names):
    """The attributes that ``show`` prints."""
    out = site.dicflow("show", pipeline, *names)
    return json.loads(out[out.index("{") :])


def run(site, pipeline, scheduler="sync"):
    return site.dicflow("run", pipeline, "--scheduler", scheduler, "--workers", 1)


@pytest.mark.parametrize("scheduler", ["sync", "threads", "processes"])
def test_a_stage_of_another_package_runs_in_every_scheduler(site, pipeline, scheduler):
    run(site, pipeline, scheduler)
    means = [shown(site, pipeline, f"brightness/{step}")["mean"] for step in ("1", "2")]
    assert means == [11.0, 21.0]


def test_a_stage_of_another_package_is_in_schema_stages_plan_and_why(site, pipeline):
    stages = json.loads(site.dicflow("schema"))["properties"]["stages"]["additionalProperties"]["oneOf"]
    (own,) = [one for one in stages if one["properties"]["stage"]["const"] == "brightness"]
    assert own["properties"]["offset"]["unit"] == "grey levels"
    assert re.search(r"^brightness +mean grey level, once per step$", site.dicflow("stages"), re.MULTILINE)
    assert "  offset: 0.0 grey levels\n      number, at least 0\n" in site.dicflow("stages", "brightness")
    assert re.search(r"^brightness +0 +", site.dicflow("plan", pipeline), re.MULTILINE)
    assert "brightness/1: " in site.dicflow("why", pipeline, "brightness")


def test_an_edit_in_the_package_of_a_stage_recomputes_the_stage(site, pipeline):
    run(site, pipeline)
    assert re.search(r"^brightness +2 +0", site.dicflow("plan", pipeline), re.MULTILINE)
    (site.folder / "toys/grey.py").write_text(GREY.replace("mean()", "max()"))
    assert re.search(r"^brightness +0 +2", site.dicflow("plan", pipeline), re.MULTILINE)
    assert re.search(r"^photos +2 +0", site.dicflow("plan", pipeline), re.MULTILINE)


@pytest.mark.parametrize("scheduler", ["queue", "queue://far:1"])
def test_a_scheduler_of_another_package_runs_the_tasks(site, pipeline, scheduler):
    assert f"opened {scheduler} 1\n" in run(site, pipeline, scheduler)
    assert shown(site, pipeline, "brightness/1")["mean"] == 11.0


def test_an_unknown_scheduler_names_those_of_other_packages(broken, pipeline):
    done = broken.python("-m", "dicflow", "run", pipeline, "--scheduler", "quue")
    assert done.returncode == 2
    assert "unknown scheduler 'quue', did you mean 'queue'?" in " ".join(done.stderr.split())
    done = broken.python("-m", "dicflow", "run", pipeline, "--scheduler", "ruin")
    assert done.returncode == 2
    assert "ruins 1.0 (entry point ruin = ruins) cannot be used" in " ".join(done.stderr.split())


def test_a_calibration_of_another_package_is_read(site, pipeline):
    run(site, pipeline)
    found = shown(site, pipeline, "rig")
    assert found["program"] == "Toy"
    assert found["summary"]["baseline_mm"] == pytest.approx(80.0)


def test_an_export_format_of_another_package_writes_and_is_in_the_help(site, pipeline, tmp_path):
    run(site, pipeline)
    site.dicflow("export", pipeline, "brightness", "--format", "toy", "--output", tmp_path / "out")
    assert (tmp_path / "out" / "brightness.toy").read_text() == "brightness_1 brightness\nbrightness_2 brightness\n"
    assert "toy: one line per product" in " ".join(site.dicflow("export", "--help").split())


def test_what_a_format_of_another_package_writes_beside_a_whole_test(site):
    code = "from dicflow.io.exports import beside; print(beside()['toy'])"
    assert site.python("-c", code).stdout == "('rig',)\n"


def test_a_section_of_another_package_is_in_its_place_and_changes_with_its_code(site, pipeline):
    run(site, pipeline)
    page = pipeline.parent / "results" / "toy" / "report.html"
    titles = re.findall("<h2>(.*)</h2>", page.read_text())
    assert titles == ["Summary", "Calibration", "Brightness of the photographs", "Settings", "Methods", "Provenance"]
    assert "<p>2 steps</p>" in page.read_text()
    (site.folder / "toys/section.py").write_text(SECTION.replace("steps</p>", "photographs</p>"))
    site.dicflow("report", pipeline)
    assert "<p>2 photographs</p>" in page.read_text()


def test_a_section_of_another_package_that_fails_spoils_no_other(site, pipeline):
    (site.folder / "toys/section.py").write_text(SECTION.replace('steps("brightness")', "steps[0]"))
    run(site, pipeline)
    text = (pipeline.parent / "results" / "toy" / "report.html").read_text()
    assert "TypeError: " in text
    assert "Brightness of the photographs: TypeError: " in site.python("-m", "dicflow", "report", pipeline).stderr
    assert '<section id="settings">' in text


@pytest.fixture
def broken(site):
    """The same with a second package, of which nothing can be imported."""
    site.install("ruins", {"ruins.py": BROKEN}, {group: {"ruin": "ruins"} for group in GROUPS})
    return site


def test_a_broken_package_stops_nothing_that_does_not_use_it(broken, pipeline, tmp_path):
    run(broken, pipeline)
    broken.dicflow("export", pipeline, "brightness", "--format", "npz", "--output", tmp_path / "out")
    assert "ruin: a plug-in that cannot be used" in " ".join(broken.dicflow("export", "--help").split())
    done = broken.python("-m", "dicflow", "schema")
    assert '"brightness"' in done.stdout
    assert "ruins 1.0 (entry point ruin = ruins)" in done.stderr
    text = (pipeline.parent / "results" / "toy" / "report.html").read_text()
    assert text.count("ruins 1.0 (entry point ruin = ruins)") >= 1


def test_a_broken_package_is_named_where_it_is_used(broken, pipeline):
    said = "ruins 1.0 (entry point ruin = ruins) cannot be used: ModuleNotFoundError: No module named"
    pipeline.write_text(PIPELINE.replace("stage: brightness", "stage: ruin"))
    plan = broken.python("-m", "dicflow", "plan", pipeline)
    assert plan.returncode == 2
    assert said in plan.stderr
    assert "toy.yaml:4:" in plan.stderr
    pipeline.write_text(PIPELINE)
    (pipeline.parent / "rig.toy").write_text("not a calibration")
    plan = broken.python("-m", "dicflow", "plan", pipeline)
    assert plan.returncode == 2
    assert said in plan.stderr
    assert "Traceback" not in plan.stderr


def test_two_stages_of_one_name_name_both_places(site, pipeline):
    site.install("others", {"others.py": STAGE}, {"dicflow.stages": {"brightness": "others", "images": "others"}})
    plan = site.python("-m", "dicflow", "plan", pipeline)
    assert plan.returncode == 2
    assert "others 1.0 (entry point brightness = others)" in plan.stderr
    assert "toys 1.0 (entry point brightness = toys.stage:Brightness)" in plan.stderr
    assert "others 1.0 (entry point images = others)" in plan.stderr
    assert "dicflow.stages.images" in plan.stderr


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("toys.stage:Node", "has no name of its own"),
        ("toys.stage:Literal", "is not a Node"),
        ("toys.stage", "is not a Node"),
        ("toys.stage:Missing", "AttributeError"),
    ],
)
def test_an_entry_point_that_is_not_a_stage_of_its_name(site, pipeline, value, said):
    site.install("wrong", {}, {"dicflow.stages": {"wrong": value}})
    done = site.python("-m", "dicflow", "stages", "wrong")
    assert done.returncode == 2
    assert f"wrong 1.0 (entry point wrong = {value})" in done.stderr
    assert said in done.stderr


def test_a_format_without_what_it_needs(site):
    site.install("half", {"half.py": 'PROGRAM = "Half"\n'}, {"dicflow.calibrations": {"half": "half"}})
    code = "from dicflow.io.calibrations import FORMATS; FORMATS.load('half')"
    assert "has no recognises and no parse" in site.python("-c", code).stderr


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("def run(self, images)", "def run(self, pictures)"), "takes images, but run has no such argument"),
        (("title: ClassVar", "heading: ClassVar"), "lacks title"),
    ],
)
def test_a_stage_that_cannot_work_is_refused_when_planned(site, pipeline, change, said):
    (site.folder / "toys/stage.py").write_text(STAGE.replace(*change))
    plan = site.python("-m", "dicflow", "plan", pipeline)
    assert plan.returncode == 2
    assert said in plan.stderr


def test_a_format_whose_kinds_are_no_tuple(site, pipeline, tmp_path):
    (site.folder / "toys/export.py").write_text(EXPORT.replace("KINDS = None", 'KINDS = ("total")'))
    done = site.python("-m", "dicflow", "export", pipeline, "--format", "toy", "--output", tmp_path / "out")
    assert done.returncode == 2
    assert "KINDS is 'total'; write a tuple" in done.stderr


def test_a_section_without_its_function_says_its_name(site, pipeline):
    (site.folder / "toys/section.py").write_text(SECTION.replace("def brightness(", "def light("))
    run(site, pipeline)
    assert "needs a function 'brightness'" in site.python("-m", "dicflow", "report", pipeline).stderr


def test_a_file_more_in_a_package_of_ours_is_found(tmp_path):
    """The packages are extended by a folder, as a file in their own would."""
    files = {"stages/brightness": STAGE + '\n__all__ = ["Brightness"]\n', "io/calibrations/toy": CALIBRATION}
    files |= {"io/exports/toy": EXPORT, "report/brightness": SECTION, "io/exports/helper": "x = 1\n"}
    site = Site(tmp_path)
    site.install("nothing", {f"{path}.py": text for path, text in files.items()}, {})
    code = """
import sys, dicflow.stages, dicflow.io.calibrations, dicflow.io.exports, dicflow.report
for package in (dicflow.stages, dicflow.io.calibrations, dicflow.io.exports, dicflow.report):
    package.__path__.append(sys.argv[1] + "/" + package.__name__.removeprefix("dicflow.").replace(".", "/"))
from dicflow.pipeline.registry import node_class
from dicflow.report.sections import entries
print(node_class("brightness").__module__)
print(dicflow.io.calibrations.FORMATS.load("toy").PROGRAM)
print(dicflow.io.exports.descriptions()["toy"], "helper" in dicflow.io.exports.FORMATS.names())
print([entry.title for entry in entries()][4])
"""
    done = site.python("-c", code, tmp_path)
    expected = ["dicflow.stages.brightness", "Toy", "one line per product False", "Brightness of the photographs"]
    assert done.stdout.splitlines() == expected, done.stderr


def test_the_nearest_name_is_suggested():
    registry = Registry("format", "dicflow.io.exports", "dicflow.nothing", ("KINDS",))
    with pytest.raises(ConfigurationError, match="no format 'hdf', did you mean 'hdf5'"):
        registry.load("hdf")
    assert registry.constant("vtu", "KINDS") == ("total",)
    assert registry.constant("vtu", "BESIDE", ()) == ()
