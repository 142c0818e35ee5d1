"""The page as a whole: complete, escaped, made once, and written for every outcome of a run."""

import json
import re
import shutil
import subprocess
import sys

import pytest
from PIL import Image
from small import ROOT, STEPS, TASKS, dicflow

from dicflow.engine.journal import find_run
from dicflow.errors import StageError, StoreError
from dicflow.io.rig import rig_text
from dicflow.kinds.rig import rig_from_json
from dicflow.pipeline import Pipeline
from dicflow.report import build
from dicflow.report.pieces import Pieces
from dicflow.report.sections import SECTIONS, Entry, entries
from tests.pages import Page

RESULTS = re.compile("^  (comparison|maps):", re.MULTILINE)
BOARDS = re.compile("^  (boards|corners|rig):", re.MULTILINE)
NAMESPACE = "http://www.w3.org/2000/svg"


@pytest.fixture
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


def page_of(path, folder, **options):
    loaded = Pipeline.load(path, **options)
    return Page.read(build.write_report(loaded, loaded.result(), folder))


def test_a_run_leaves_a_report_with_its_title_and_stages(loaded, measured):
    path = loaded.path.parent / "results" / loaded.name / "report.html"
    page = Page.read(path)
    page.assert_complete()
    assert page.texts[:2] == [loaded.title, loaded.title]
    assert f"track: {STEPS} of {STEPS}" in page.texts
    assert f"{TASKS} tasks computed, 0 from the store" in page.texts
    assert {"summary", "settings", "provenance"} <= set(page.ids)
    for folder in (loaded.folder, loaded.folder.resolve(), loaded.store_folder):
        assert str(folder) not in path.read_text()
    assert not [text for text in re.findall(r"https?://[^\\\s\"]*", path.read_text()) if text != NAMESPACE]


def test_the_second_build_makes_no_piece_and_the_same_page(loaded, tmp_path, monkeypatch):
    first = build.write_report(loaded, loaded.result(), tmp_path).read_bytes()
    (tmp_path / "report.html").unlink()
    made, get = [], Pieces.get

    def counted(pieces, sources, make):
        return get(pieces, sources, lambda: made.append(sources) or make())

    monkeypatch.setattr(Pieces, "get", counted)
    again = build.write_report(Pipeline.load(loaded.path), loaded.result(), tmp_path).read_bytes()
    assert made == []
    assert again == first


def test_a_page_of_the_same_products_stays_and_any_other_is_made_again(loaded, tmp_path):
    page = build.write_report(loaded, loaded.result(), tmp_path)
    first = page.read_text()
    page.write_text("kept")
    build.write_report(loaded, loaded.result(), tmp_path)
    assert page.read_text() == "kept"
    sources = tmp_path / ".report" / "sources"
    sources.write_text("other products")
    assert build.write_report(loaded, loaded.result(), tmp_path).read_text() == first
    page.unlink()
    assert build.write_report(loaded, loaded.result(), tmp_path).read_text() == first


@pytest.mark.parametrize(
    ("sections", "absent"),
    [
        ("calibration quality sweep settings provenance", ["matplotlib", "numba"]),
        ("settings provenance", ["cv2", "scipy", "zarr"]),
    ],
)
def test_the_second_build_loads_nothing_that_draws_or_computes(loaded, tmp_path, sections, absent):
    build.write_report(loaded, loaded.result(), tmp_path).unlink()
    code = (
        "import sys; from pathlib import Path\n"
        "from dicflow.pipeline import Pipeline; from dicflow.report import build, sections\n"
        f"chosen = [sections._placed(name)[1] for name in '{sections}'.split()]\n"
        "build.entries = lambda: chosen\n"
        "loaded = Pipeline.load(sys.argv[1])\n"
        "build.write_report(loaded, loaded.result(), Path(sys.argv[2]))\n"
        "print(*sorted(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code, loaded.path, tmp_path], capture_output=True, text=True)
    assert "dicflow.report.build" in done.stdout, done.stderr
    assert not set(absent) & set(done.stdout.split())


def test_names_are_text_and_never_tags(copied, tmp_path):
    text = copied.read_text().replace("title: ", 'title: "<b>&\\"</b>" # ', 1)
    copied.write_text(text)
    for path in sorted((copied.parent / "photos").glob("*/step_08*")):
        path.rename(path.with_name(path.name.replace("step_08", "step_08<i>&")))
    path = build.write_report(loaded := Pipeline.load(copied), loaded.result(), tmp_path)
    page = Page.read(path)
    assert page.texts[0] == '<b>&"</b>'
    assert "<b>&" not in path.read_text()
    assert "<i>" not in path.read_text()


def test_the_report_says_nothing_of_the_machine(loaded, tmp_path, monkeypatch):
    def broken(context):
        raise StageError(f"{loaded.store_folder}/tmp: <b>no</b> room in {loaded.folder}/photos; make some")

    monkeypatch.setattr(build, "entries", lambda: [Entry("broken", "Broken", broken)])
    path = build.write_report(loaded, loaded.result(), tmp_path / "new")
    assert Page.read(path).texts.count("tmp: <b>no</b> room in photos; make some") == 1
    assert "tmp: &lt;b&gt;no&lt;/b&gt; room" in path.read_text()


def test_a_summary_that_fails_leaves_the_other_sections(loaded, tmp_path, monkeypatch):
    def broken(context, sections):
        raise StoreError("the store is gone")

    monkeypatch.setattr(build, "summary", broken)
    page = Page.read(build.write_report(loaded, loaded.result(), tmp_path))
    assert "the store is gone" in page.texts
    assert {"summary", "provenance"} <= set(page.ids)


def test_the_run_of_a_report_is_one_with_the_same_settings(loaded, pipeline, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(build, "entries", lambda: [Entry("seen", "Seen", lambda context: seen.append(context.run))])
    build.write_report(loaded, loaded.result(), tmp_path)
    other = Pipeline.load(pipeline, settings=["strain.window=[61, 61]"])
    build.write_report(other, other.result(), tmp_path)
    assert seen[0] is not None
    assert seen[0].ended
    assert seen[1] is None


def test_nothing_measured_is_shown_as_nothing(pipeline, tmp_path):
    page = page_of(pipeline, tmp_path / "new", store=tmp_path / "store")
    page.assert_complete()
    assert f"track: 0 of {STEPS}" in page.texts
    assert "No run of this pipeline as it stands is known" in page.text


@pytest.mark.parametrize("flags", [(), ("--keep-going",)])
def test_a_run_that_failed_half_way_names_what_failed(copied, tmp_path, flags):
    shutil.copyfile(
        *sorted((copied.parent / "boards").glob("right/*"))[:1], min((copied.parent / "photos").glob("right/*"))
    )
    answer = dicflow("run", copied, "--scheduler", "sync", "--workers", "1", *flags)
    assert answer.code != 0
    page = Page.read(copied.parent / "results" / copied.stem / "report.html")
    page.assert_complete()
    loaded = Pipeline.load(copied)
    failed = [event for event in find_run(loaded.store).events() if event.status == "failed"]
    assert failed
    assert "What failed" in page.texts
    assert all(event.task in page.texts for event in failed)
    assert "tasks failed" in page.text
    assert str(copied.parent) not in page.text


@pytest.mark.parametrize(
    ("result", "sentence"),
    [({"counts": {}, "interrupted": True}, "The run was interrupted"), (None, "The run was cut off")],
)
def test_a_run_that_did_not_end(copied, tmp_path, result, sentence):
    loaded = Pipeline.load(copied)
    folder = find_run(loaded.store).folder
    events = [line for line in (folder / "journal.jsonl").read_text().splitlines() if '"stage":"total"' not in line]
    (folder / "journal.jsonl").write_text("\n".join(events))
    (folder / "index.json").write_text("{}")
    (folder / "result.json").write_text(json.dumps(result))
    page = page_of(copied, tmp_path / "new")
    assert sentence in page.text
    assert f"{STEPS - 1} of its {TASKS} tasks" in page.text


def test_a_sweep_has_a_box_for_every_instance(copied, tmp_path):
    page = page_of(copied, tmp_path, settings=["smooth.degree=1,2"])
    page.assert_complete()
    assert {"smooth", "smooth@2"} <= set(page.texts)
    assert "Of the first variant: smooth.degree = 1." in page.texts


def test_a_pipeline_without_maps_and_caliper(copied, tmp_path):
    copied.write_text("".join(line for line in copied.read_text().splitlines(True) if not RESULTS.search(line)))
    page = page_of(copied, tmp_path)
    page.assert_complete()
    assert "Means over the field, step by step" in page.texts
    assert "mean εyy [–]" in page.texts


def test_a_rig_from_a_file(copied, measured, pipeline, tmp_path):
    (copied.parent / "rig.json").write_bytes(
        rig_text(rig_from_json(Pipeline.load(pipeline).result().product("rig").attrs["rig"])).encode()
    )
    lines = [line for line in copied.read_text().splitlines(True) if not BOARDS.search(line)]
    copied.write_text("".join(lines).replace("  # the rig,", "  rig: {stage: rig_file, file: rig.json}\n  # the rig,"))
    page = page_of(copied, tmp_path)
    page.assert_complete()
    assert "rig: 0 of 1" in page.texts


def test_one_camera(copied, tmp_path):
    text = (ROOT / "pipelines" / "planar.yaml").read_text()
    copied.write_text(text.replace("photos/left/*.png", "photos/left/*.*"))
    page = page_of(copied, tmp_path)
    page.assert_complete()
    assert "plane: 0 of 3" in page.texts


def test_the_sections_and_their_order():
    order = ["sweep", "material", "calibration", "quality", "settings", "methods", "provenance"]
    assert [entry.key for entry in entries()] == order
    assert set(SECTIONS.names()) == set(order)


def test_the_logo_stands_in_the_head_and_one_that_fails_is_reported(copied, tmp_path):
    text = copied.read_text()
    copied.write_text(text.replace("stages:", "report: {logo: logo.png}\nstages:", 1))
    notes: list[str] = []
    loaded = Pipeline.load(copied)
    page = build.write_report(loaded, loaded.result(), tmp_path, note=notes.append)
    assert "Logo of the laboratory" not in page.read_text()
    assert [("logo.png" in note, "does not exist" in note) for note in notes] == [(True, True)]
    Image.new("RGB", (40, 20)).save(copied.parent / "logo.png")
    build.write_report(loaded, loaded.result(), tmp_path, note=notes.append)
    assert page.read_text().count('alt="Logo of the laboratory"') == 1
    assert len(notes) == 1
    Page.read(page).assert_complete()


def test_a_changed_statement_makes_the_page_again(copied, tmp_path):
    text = copied.read_text()
    for operator in ("Ada", "Emmy"):
        copied.write_text(text.replace("stages:", f"report: {{operator: {operator}}}\nstages:", 1))
        loaded = Pipeline.load(copied)
        assert operator in Page.read(build.write_report(loaded, loaded.result(), tmp_path)).texts
