"""Every command: its output, its files, and its exit codes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from small import ROOT, STEPS, TASKS, dicflow

from dicflow.engine.schedulers import SCHEDULERS
from dicflow.pipeline import Pipeline
from tests.io.photograph_files import png
from tests.waiting import PATIENCE_S, started

SAMPLE = ROOT / "pipelines" / "thesis_quickstart.yaml"
COMMANDS = ("run", "plan", "why", "graph", "ls", "show", "report", "export", "compare", "gc", "verify", "pin")
COMMANDS += ("stages", "schema", "init", "doctor", "tune")
RIG_ALONE = """\
stages:
  boards: {stage: images, left: boards/left/*.png, right: boards/right/*.png}
  corners: {stage: corners, size: [9, 6]}
  rig: {stage: calibrate, square: 14.5 mm}
"""


@pytest.fixture
def given(pipeline, measured):
    """Arguments that every command on the measured pipeline takes."""
    return (pipeline, "--store", measured)


@pytest.fixture
def own(pipeline, measured, tmp_path):
    """The same with a store of the test's own."""
    shutil.copytree(measured, tmp_path / "store")
    return (pipeline, "--store", tmp_path / "store")


def run(given, folder, *more):
    return dicflow("run", *given, "--output", folder, "--scheduler", "sync", "--workers", 1, "--json", *more)


def python(code, *arguments):
    """Output of a few lines of Python in a process of their own."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


# run


def test_a_run_with_nothing_to_do(own):
    answer = dicflow("run", *own, "--json")
    assert answer.code == 0
    assert answer.line["counts"] == {"hit": TASKS, "computed": 0, "failed": 0, "skipped": 0}
    assert set(answer.line) == {"run", "counts", "seconds", "warnings", "stages"}
    assert answer.line["stages"]["total"]["hit"] == STEPS - 1
    assert len(answer.out.splitlines()) == 1
    assert "rig: " in answer.err
    assert answer.err.splitlines()[-1].endswith("report.html")
    assert "pairs" in answer.err


def test_pictures_and_the_report_may_be_left_out(own, tmp_path):
    folder = tmp_path / "out"

    def files():
        return {path.name: path.stat().st_mtime_ns for path in folder.rglob("*") if ".report" not in path.parts}

    assert run(own, folder, "--no-pictures", "--no-report").code == 0
    assert set(files()) == {".published.json", "comparison.csv"}
    assert run(own, folder, "--no-report").code == 0
    drawn = files()
    assert "eyy.gif" in drawn
    assert "report.html" not in drawn
    assert run(own, folder, "--no-pictures").code == 0
    assert "report.html" in files()
    assert files()["eyy.gif"] == drawn["eyy.gif"]


def test_a_value_changes_what_depends_on_it_and_nothing_else(own, tmp_path):
    def objects():
        return {path: path.read_bytes() for path in (tmp_path / "store" / "objects").rglob("*") if path.is_file()}

    before = objects()
    changed = run(own, tmp_path / "o", "--set", "strain.window=[60, 60]").line
    computed = {stage: counts["computed"] for stage, counts in changed["stages"].items() if counts["computed"]}
    assert computed == {"strain": STEPS - 1, "total": STEPS - 1, "comparison": 1, "maps": 1}
    assert changed["counts"]["hit"] == TASKS - 2 * (STEPS - 1) - 2
    after = objects()
    assert all(after[path] == content for path, content in before.items())
    assert run(own, tmp_path / "o").line["counts"]["hit"] == TASKS
    assert objects() == after


def test_a_sweep_shares_what_its_variants_have_in_common(own, tmp_path):
    answer = run(own, tmp_path / "o", "--set", "strain.window=[80, 20],[60, 60],[50, 50]")
    assert answer.code == 0
    assert answer.line["counts"]["hit"] == TASKS
    assert answer.line["counts"]["computed"] == 2 * (2 * (STEPS - 1) + 2)
    rows = (tmp_path / "o" / "sweep.csv").read_text().splitlines()
    assert [row.split('"')[1] for row in rows[1:]] == ["[80, 20]", "[60, 60]", "[50, 50]"]
    assert (tmp_path / "o" / "sweep.png").read_bytes().startswith(b"\x89PNG")
    for number in (1, 2, 3):
        assert (tmp_path / "o" / f"variant_{number}" / "maps" / "eyy.gif").is_file()


PHOTOGRAPHS_ALONE = """\
stages:
  photos: {stage: images, left: l/*.png, right: r/*.png, unpaired: skip}
"""


def test_steps_that_are_left_out_are_on_the_last_lines_and_in_the_json(tmp_path):
    for side, frames in (("l", (0, 1, 3, 4)), ("r", (0, 1, 2, 3))):
        (tmp_path / side).mkdir()
        for k in frames:
            grey = np.random.default_rng(k).integers(0, 255, (20, 30), dtype=np.uint8)
            Image.fromarray(grey).save(tmp_path / side / f"frame_{k:03d}.png")
    (tmp_path / "p.yaml").write_text(PHOTOGRAPHS_ALONE)
    answer = run((tmp_path / "p.yaml",), tmp_path / "o")
    assert (answer.code, answer.line["counts"]["computed"]) == (0, 3)
    (warning,) = answer.line["warnings"]
    assert all(word in warning for word in ("photos", "left frame_004.png", "right frame_002.png"))
    assert answer.err.count(warning) == 1
    assert run((tmp_path / "p.yaml",), tmp_path / "o").line["warnings"] == [warning]
    assert dicflow("plan", tmp_path / "p.yaml").out.count(warning) == 1
    assert warning in (tmp_path / "o" / "report.html").read_text()


def test_the_risk_of_a_scheduler_is_said_once(tmp_path, monkeypatch):
    (tmp_path / "a.png").write_bytes(png(np.full((4, 6, 1), 9), 0))
    (tmp_path / "p.yaml").write_text("stages:\n  photos: {stage: images, left: a.png}\n")
    risky = replace(SCHEDULERS["sync"], warning=lambda _: "anybody may listen")
    monkeypatch.setitem(SCHEDULERS, "sync", risky)
    answer = run((tmp_path / "p.yaml",), tmp_path / "o")
    assert answer.err.count("anybody may listen") == 1
    assert answer.line["warnings"] == ["anybody may listen"]


def test_a_failure_is_reported_and_repeated_at_the_end_which_is_1(own, tmp_path):
    answer = run(own, tmp_path / "o", "--set", "region.rectangle=[10, 10, 900, 20]", "--set", "region.file=null")
    answer.refuses(1, "region: the region spans x 10 … 900", "0 … 431", "choose the region inside it")
    assert [line.startswith("failed: region: the region spans") for line in answer.err.splitlines()[-5:]].count(
        True
    ) == 1
    assert answer.line["counts"]["failed"] == 1
    assert answer.line["counts"]["skipped"] > 0


def test_keep_going_computes_what_does_not_need_the_failure(own, tmp_path):
    settings = ("--set", "features.max_features=50", "--set", "disparity.range=[500, 516]")
    stopped = run(own, tmp_path / "o", *settings).line["stages"]
    kept_on = run(own, tmp_path / "o", *settings, "--keep-going")
    assert stopped["disparity"]["failed"] == kept_on.line["stages"]["disparity"]["failed"] == 1
    assert stopped["matches"]["skipped"] == 2
    assert kept_on.line["stages"]["matches"]["skipped"] == 0
    assert kept_on.code == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run",), "Missing argument"),
        (("frobnicate",), "No such command"),
        (("run", SAMPLE, "--frobnicate"), "No such option"),
        (("run", SAMPLE, "--workers", "0"), "must be at least 1"),
        (
            ("run", "nothing.yaml"),
            "(no such file or directory); name a pipeline file, or make one",
        ),
        (("run", ROOT), "expected a pipeline file, but it is a folder"),
        (("run", SAMPLE.parent), "name the file itself; the folder has "),
        (("run", SAMPLE.with_name("quikstart.yaml")), "; the folder has "),
        (
            ("run", SAMPLE, "--set", "strain.window=50,5 px"),
            "write 50.5 px for one value, 50 px,5 px for a sweep of two",
        ),
        (("run", SAMPLE, "--set", "strain.window=60", "px"), 'needs quotes, as in "14.5 mm"'),
        (("run", SAMPLE, "--data", "nowhere"), "nowhere: no such folder"),
        (("run", SAMPLE, "--set", "strain"), "write stage.parameter=value"),
        (("run", SAMPLE, "--set", "strain.window=[1"), "close every bracket"),
        (("run", SAMPLE, "--set", "strain.window="), "has no value"),
        (("run", SAMPLE, "--set", "strian.window=1"), "no stage 'strian', did you mean 'strain'?"),
        (("run", SAMPLE, "--set", "strain.windw=1"), "unknown parameter, did you mean 'window'?"),
        (("run", SAMPLE, "--set", "strain.window=-3"), "--set strain.window=-3: strain.window: must be a list"),
        (("synth", "latex", "x", "--experiment", "6"), "less than or equal to 5"),
    ],
)
def test_a_wrong_command_ends_with_2(arguments, words):
    dicflow(*arguments).refuses(2, words)


def test_a_scheduler_that_is_not_there(own, tmp_path):
    run(own, tmp_path, "--scheduler", "slurm").refuses(2, "unknown scheduler 'slurm'; use auto, processes, threads")


def test_help_and_version_load_nothing_heavy():
    code = """
import sys
from dicflow.cli import main
sys.argv = ["dicflow", sys.argv[1]]
try:
    main()
finally:
    heavy = "numpy scipy cv2 numba dask distributed zarr xarray matplotlib rich yaml bokeh".split()
    print([name for name in heavy if name in sys.modules])
"""
    for option in ("--help", "--version"):
        assert python(code, option).splitlines()[-1] == "[]"


def test_every_command_explains_itself():
    listed = dicflow("--help").out
    for command in COMMANDS:
        assert f"\n  {command} " in listed
        text = dicflow(command, "--help").out
        assert f"dicflow {command}" in text.replace("Usage: dicflow", ""), "an example"
    assert "..." not in listed.partition("Commands:")[2]


def test_a_run_with_nothing_to_do_loads_no_numerics(own):
    code = """
import sys
from dicflow.cli import main
try:
    main()
except SystemExit as stop:
    assert stop.code == 0
heavy = "scipy cv2 numba dask distributed zarr xarray matplotlib PIL".split()
print([name for name in heavy if name in sys.modules])
"""
    dicflow("plan", *own)  # remembers the photographs, which were too new for that when they were measured
    printed = python(code, "run", *own, "--dashboard")
    assert printed.splitlines()[-1] == "[]"


def test_an_interrupted_run_ends_with_130_and_the_next_goes_on(pipeline, tmp_path):
    alone = tmp_path / "rig.yaml"
    alone.write_text(RIG_ALONE)
    given = (alone, "--data", pipeline.parent)
    command = ["dicflow", "run", *given, "--workers", "1", "--json"]
    code = "from dicflow.cli import main; main()"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with started([sys.executable, "-c", code, *map(str, command[1:])], start_new_session=True, **pipes) as process:
        first = next(line for line in iter(process.stderr.readline, "") if line.startswith("boards"))
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, first + err
    assert "Traceback" not in err
    assert "the same command" in err
    done = json.loads(out)["counts"]
    assert done["skipped"] > 0
    assert done["failed"] == 0
    again = dicflow("run", *given, "--scheduler", "sync", "--json")
    assert again.code == 0
    assert again.line["counts"]["hit"] == done["computed"]


# plan, why, graph, ls, show


def test_plan_and_why_show_old_and_new_values(given):
    changed = (*given, "--set", "strain.window=[60, 60]")
    answer = dicflow("plan", *changed)
    assert answer.code == 0
    row = next(line for line in answer.out.splitlines() if line.startswith("strain "))
    assert row.split()[1:4] == ["0", str(STEPS - 1), "0"]
    assert "window: [80.0, 20.0] → [60.0, 60.0]" in row
    assert "waits for strain/step_01" in answer.out
    why = dicflow("why", *changed, "maps")
    assert "window: [80.0, 20.0] → [60.0, 60.0]" in why.out
    assert dicflow("why", *given, "strain/step_01").out == "strain/step_01: hit\n"
    dicflow("why", *given, "strian").refuses(2, "no stage or task 'strian', did you mean 'strain'?; stages: photos")


def test_plan_of_what_was_never_run(pipeline, tmp_path):
    answer = dicflow("plan", pipeline, "--store", tmp_path / "new")
    assert answer.code == 0
    assert "not made before (8 ×)" in answer.out


def test_graph_as_text(given):
    lines = dicflow("graph", *given[:1]).out.splitlines()
    assert len(lines) == 19
    surface = next(line for line in lines if line.startswith("surface"))
    assert surface.split()[1:3] == [str(STEPS), "×"]
    assert "[cloud ← filled]" in surface


def test_graph_as_svg_is_well_formed_and_never_overwritten(given, tmp_path):
    path = tmp_path / "new" / "graph.svg"
    assert dicflow("graph", *given[:1], "--output", path).code == 0
    tree = ElementTree.fromstring(path.read_text())
    texts = {node.text for node in tree.iter("{http://www.w3.org/2000/svg}text")}
    assert {"photos", "surface", "maps"} <= texts
    dicflow("graph", *given[:1], "--output", path).refuses(2, "graph.svg exists; add --force")
    assert dicflow("graph", *given[:1], "--output", path, "--force").code == 0


def test_ls_counts_what_is_there(given, pipeline, tmp_path):
    rows = {line.split()[0]: line.split() for line in dicflow("ls", *given).out.splitlines()}
    assert rows["boards"][1:5] == ["images", "8", "of", "8"]
    assert rows["total"][1:] == ["total", "2", "of", "2", "step_01", "…", "step_02"]
    empty = dicflow("ls", pipeline, "--store", tmp_path / "new").out
    assert "0 of 8" in empty


def test_show(given):
    answer = dicflow("show", *given, "total/step_01")
    assert answer.code == 0
    row = next(line for line in answer.out.splitlines() if line.startswith("eyy"))
    assert row.split()[1:3] == ["1", "float64"]
    attrs = json.loads(answer.out[answer.out.index("\n{") :])
    assert attrs["measures"]["gxy"].startswith("shear γxy")
    rig = json.loads(dicflow("show", *given, "rig").out)
    assert rig["summary"]["pairs_used"] == 8


@pytest.mark.parametrize(
    ("product", "code", "words"),
    [
        (("total",), 2, "total has steps; name one, as in total/step_01, of step_01, step_02"),
        (("total/step_7",), 2, "total has no step 'step_7'"),
        (("rig/step_01",), 2, "rig runs once and has no steps"),
        (("totl/step_01",), 2, "no stage 'totl', did you mean 'total'?"),
        (("rig", "--variant", "3"), 2, "--variant 3: there are 1, counted from 1"),
        (("rig", "--set", "rig.radial=3"), 1, "rig is not in the store; run the pipeline first"),
    ],
)
def test_show_of_what_is_not_there(given, product, code, words):
    dicflow("show", *given, *product).refuses(code, words)


# export


def test_export_gives_the_products_numbers(given, pipeline, measured, tmp_path):
    result = Pipeline.load(pipeline).result()
    answer = dicflow("export", *given, "total", "--output", tmp_path, "--digits", 17)
    assert answer.out.split() == [str(tmp_path / f"total_step_0{number}.csv") for number in (1, 2)]
    total = result.product("total", "step_02")
    text = (tmp_path / "total_step_02.csv").read_text()
    table = np.genfromtxt([line for line in text.splitlines() if line[0] != "#"], delimiter=",", names=True)
    for name in ("U", "V", "W", "exx", "eyy", "gxy"):
        np.testing.assert_allclose(table[name], total[name].ravel(), rtol=1e-8, equal_nan=True)
    np.testing.assert_allclose(table["Z"], total["xyz"][..., 2].ravel(), rtol=1e-8)
    assert "# U: mm\n" in text
    assert dicflow("export", *given, "total", "--step", "step_02", "--format", "npz", "--output", tmp_path).code == 0
    with np.load(tmp_path / "total_step_02.npz") as arrays:
        assert set(arrays) == {*total.variables, "attributes"}
        np.testing.assert_array_equal(arrays["eyy"], total["eyy"])
        assert json.loads(str(arrays["attributes"]))["units"]["eyy"] == "1"


def test_a_report_of_what_the_store_holds(given, tmp_path):
    answer = dicflow("report", *given, "--output", tmp_path / "new")
    assert answer.out == f"{tmp_path / 'new' / 'report.html'}\n"
    assert "<h1>Latex strip" in (tmp_path / "new" / "report.html").read_text()


def test_export_of_an_unknown_format(given):
    dicflow("export", *given, "total", "--format", "cvs").refuses(
        2, "no format 'cvs', did you mean 'csv'?; there are challenge, csv"
    )


def test_export_as_pictures(given, tmp_path):
    picked = ("surface", "--step", "step_00", "--format", "png", "--output", tmp_path)
    assert dicflow("export", *given, *picked).code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["surface_step_00_status.png"]
    dicflow("export", *given, "rig", "--format", "png", "--output", tmp_path).refuses(2, "has no array to draw")


def test_export_of_tables(given, tmp_path):
    for stage in ("comparison", "rig", "region"):
        assert dicflow("export", *given, stage, "--output", tmp_path).code == 0
    rows = [line for line in (tmp_path / "comparison.csv").read_text().splitlines() if not line.startswith("#")]
    assert len(rows) == 1 + STEPS
    dicflow("export", *given, "maps", "--output", tmp_path).refuses(2, "maps", "export it as npz")


def test_export_overwrites_nothing_and_leaves_no_halves(given, tmp_path):
    kept = tmp_path / "total_step_02.csv"
    kept.write_text("mine")
    dicflow("export", *given, "total", "--output", tmp_path).refuses(2, "total_step_02.csv exists; add --force")
    assert kept.read_text() == "mine"
    assert not list(tmp_path.glob("*.part"))
    assert dicflow("export", *given, "total", "--output", tmp_path, "--force").code == 0
    assert kept.read_text() != "mine"


# the store


def test_gc_pin_and_verify(own, tmp_path):
    store = tmp_path / "store"
    changed = run(own, tmp_path / "o", "--set", "strain.window=[60, 60]").line
    run(own, tmp_path / "o")
    pinned = dicflow("pin", store, changed["run"], "--note", "for the paper")
    assert pinned.code == 0
    assert f"{changed['run']}  quickstart  pinned: for the paper" in dicflow("pin", store).out
    kept = dicflow("gc", store, "--keep-runs", 1).out
    assert "0 products, 0 records" in kept
    assert dicflow("pin", store, changed["run"], "--remove").code == 0
    would = dicflow("gc", store, "--keep-runs", 1).out
    assert would.startswith("would free")
    assert "; add --delete to do it" in would
    assert dicflow("gc", store, "--keep-runs", 1, "--delete").out.startswith("freed")
    assert dicflow("verify", store).out == "nothing is damaged\n"
    assert run(own, tmp_path / "o").line["counts"]["hit"] == TASKS


def spoil(chunk):
    """Another byte in the middle of a file."""
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 0xFF
    chunk.write_bytes(content)


def test_verify_finds_damage_and_a_run_repairs_it(own, tmp_path):
    store = tmp_path / "store"
    chunk = max((store / "objects").rglob("c.*"), key=lambda path: path.stat().st_size)
    spoil(chunk)
    found = dicflow("verify", store)
    assert found.code == 1
    assert "1 damaged; add --repair" in found.out
    assert dicflow("verify", store, "--repair").code == 1
    assert dicflow("verify", store).code == 0
    assert run(own, tmp_path / "o").code == 0


def test_damage_that_an_export_meets(own, tmp_path):
    store = tmp_path / "store"
    for chunk in (store / "objects").rglob("c.*"):
        spoil(chunk)
    given = (*own, "--step", "step_01", "--output", tmp_path / "o")
    dicflow("export", own[0], "total", *given[1:]).refuses(1, "quarantine", "run again")


def test_what_is_wrong_with_a_store_command(measured, tmp_path):
    for command in ("gc", "verify", "pin"):
        dicflow(command, tmp_path / "none").refuses(2, "none: is not a store; run a pipeline first")
    dicflow("pin", measured, "yesterday").refuses(2, "'yesterday'", "'dicflow pin STORE'")
    dicflow("pin", measured, "yesterday", "--remove").refuses(2, "yesterday is not pinned")


# what helps


def test_schema_has_every_stage_and_accepts_the_pipelines():
    from dicflow.io.configuration import read
    from dicflow.pipeline.registry import stage_names

    schema = json.loads(dicflow("schema").out)
    stages = {
        one["properties"]["stage"]["const"]: one
        for one in schema["properties"]["stages"]["additionalProperties"]["oneOf"]
    }
    assert tuple(sorted(stages)) == stage_names()
    for path in sorted((ROOT / "pipelines").glob("*.yaml")):
        data = read(path).data
        assert set(data) <= set(schema["properties"])
        for entry in data["stages"].values():
            one = stages[entry["stage"]]
            assert set(entry) <= set(one["properties"]), path
            assert set(one["required"]) <= set(entry), path


def test_doctor(tmp_path):
    answer = dicflow("doctor", "--store", tmp_path / "a" / "b")
    subjects = [line.split()[1] for line in answer.out.splitlines()]
    assert subjects == ["python:", "packages:", "detectors:", "compiler:", "cores:", "store:", "disk:", "loopback:"]
    assert answer.code == ("PROBLEM" in answer.out)
    assert f"ok       store: {tmp_path} can be written" in answer.out


def test_doctor_says_where_kernels_are_kept_or_what_to_set(tmp_path, monkeypatch):
    line = next(line for line in dicflow("doctor", "--store", tmp_path).out.splitlines() if "compiler" in line)
    assert os.environ["NUMBA_CACHE_DIR"] in line
    monkeypatch.setattr("numba.core.caching.CacheImpl._locator_classes", [])  # as where nothing can be written
    answer = dicflow("doctor", "--store", tmp_path)
    assert answer.code == 1
    assert "PROBLEM  compiler: numba finds no folder to keep compiled kernels in; set NUMBA_CACHE_DIR" in answer.out


def test_synth_keeps_what_is_there(tmp_path):
    (tmp_path / "mine.txt").write_text("")
    for words in (("sample",), ("latex", "--scale", "0.2"), ("sheets",)):
        dicflow("synth", words[0], tmp_path, *words[1:]).refuses(2, "is not empty; name another folder or add --force")


def test_synth_sheets_names_its_models(tmp_path):
    dicflow("synth", "sheets", tmp_path / "new", "--model", "gent").refuses(
        2, "expected one of neo_hooke, mooney_rivlin"
    )


@pytest.mark.slow
def test_synth_sample_writes_what_is_in_the_repository(tmp_path, monkeypatch):
    """The bytes of the one photograph that takes part here; the rest is left out for the time it takes."""
    import dicflow.synth.folder as synth

    every = synth.photographs
    monkeypatch.setattr(synth, "photographs", lambda experiment: [next(every(experiment))])
    answer = dicflow("synth", "sample", tmp_path / "new")
    assert answer.out.endswith(f"next: dicflow init {tmp_path / 'new'} --square '14.5 mm'\n")
    for name in ("photos/left/step_00.png", "caliper.csv", "region.geojson", "truth/lengths.csv"):
        assert (tmp_path / "new" / name).read_bytes() == (ROOT / "data_samples" / name).read_bytes()
