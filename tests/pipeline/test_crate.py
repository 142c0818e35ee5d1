"""Crates: written, taken in elsewhere with nothing measured again, and never believed."""

import json
import os
import shutil

import cv2
import numpy as np
import pytest
from small import dicflow

from dicflow.engine.hashing import digest_file
from dicflow.engine.store import Store
from dicflow.engine.verification import verify
from dicflow.io.crate import METADATA
from dicflow.pipeline import Pipeline
from tests.io.s3_server import serving

pytestmark = pytest.mark.slow

STEPS = 6
PIPELINE = """\
dicflow: 1
title: A plate
stages:
  photos: {stage: images, left: "left/*.png", select: {every: 2}, times: times.csv, keep: always}
  region: {stage: region, images: photos, rectangle: [5, 5, 35, 35]}
"""
TASKS = STEPS // 2 + 1


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A folder with photographs, some of which are not selected, and a run of one camera."""
    folder = tmp_path_factory.mktemp("plate")
    (folder / "left").mkdir()
    levels = np.random.default_rng(4).integers(40, 200, (40, 40), dtype=np.uint8)
    for step in range(STEPS):
        cv2.imwrite(str(folder / "left" / f"Löad {step}.png"), np.roll(levels, step, axis=1))
    (folder / "times.csv").write_text("name,time\n" + "".join(f"Löad {k}.png,{k}\n" for k in range(STEPS)))
    (folder / "left" / "secret.txt").write_text("not read")
    (folder / "pipeline.yaml").write_text(PIPELINE)
    assert dicflow("run", folder / "pipeline.yaml", "--no-report", "--scheduler", "sync").code == 0
    answer = dicflow("export", folder / "pipeline.yaml", "--format", "crate", "--output", folder / "crates")
    assert answer.out == f"{folder / 'crates' / 'pipeline.crate'}\n", answer.err
    return folder


@pytest.fixture
def crate(measured, tmp_path):
    """A copy of the crate, to be damaged."""
    return shutil.copytree(measured / "crates" / "pipeline.crate", tmp_path / "pipeline.crate")


def metadata(crate):
    return json.loads((crate / METADATA).read_text(encoding="utf-8"))


def rewrite(crate, change):
    """Change the description of a crate."""
    found = metadata(crate)
    change({entity["@id"]: entity for entity in found["@graph"]})
    (crate / METADATA).write_text(json.dumps(found), encoding="utf-8")


def hits(pipeline, store=None):
    found = Pipeline.load(pipeline, store=store)
    return found.run(scheduler="sync").outcome.counts


def test_a_crate_taken_in_elsewhere_is_all_hits(crate, tmp_path):
    answer = dicflow("import", crate, tmp_path / "there")
    assert answer.code == 0, answer.err
    assert answer.out.splitlines()[-1] == f"next: dicflow run {tmp_path / 'there' / 'pipeline.yaml'}"
    shutil.rmtree(crate)
    assert hits(tmp_path / "there" / "pipeline.yaml") == {"hit": TASKS, "computed": 0, "failed": 0, "skipped": 0}
    assert verify(Store.open(tmp_path / "there" / ".dicflow", create=False)) == []


def test_a_crate_holds_what_is_read_and_nothing_else(measured, crate):
    files = {path.relative_to(crate / "files").as_posix() for path in (crate / "files").rglob("*") if path.is_file()}
    assert files == {"pipeline.yaml", "times.csv", *(f"left/Löad {step}.png" for step in range(STEPS))}
    assert not {path.name for path in crate.glob("store/*")} & {"files.index", "actions.index", "tmp"}
    texts = [path.read_bytes() for path in crate.rglob("*") if path.is_file()]
    assert not [text for text in texts if os.fsencode(measured) in text]


def test_a_crate_describes_itself(measured, crate):
    graph = {entity["@id"]: entity for entity in metadata(crate)["@graph"]}
    root = graph["./"]
    assert graph[METADATA]["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert root["name"] == "A plate"
    assert "were measured" in root["description"] or "was measured" in root["description"]
    parts = {part["@id"] for part in root["hasPart"]}
    assert parts == {id for id, entity in graph.items() if "File" in entity["@type"]} | {"store/"}
    photograph = graph["files/left/L%C3%B6ad%200.png"]
    path = measured / "left" / "Löad 0.png"
    assert f"sha256:{photograph['sha256']}" == digest_file(path)
    assert int(photograph["contentSize"]) == path.stat().st_size
    assert graph["#run"]["result"] == {"@id": "store/"}
    assert graph["#dicflow"]["softwareVersion"]


def test_a_run_pushed_to_a_bucket_and_pulled_is_all_hits(measured, tmp_path, monkeypatch):
    shutil.copytree(measured / "left", tmp_path / "left")
    for name in ("pipeline.yaml", "times.csv"):
        shutil.copy(measured / name, tmp_path)
    with serving("laboratory") as (address, objects):
        for name, value in {"ENDPOINT_URL": address, "ALLOW_HTTP": "true", "REGION": "eu-1"}.items():
            monkeypatch.setenv(f"AWS_{name}", value)
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "name")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        pushed = dicflow("push", measured / ".dicflow", "s3://laboratory/plate")
        assert f"{TASKS} products in s3://laboratory/plate, {TASKS} of them new" in pushed.out, pushed.err
        pulled = dicflow("pull", tmp_path / "store", "s3://laboratory/plate")
        assert f"{TASKS} products" in pulled.out, pulled.err
        name = next(name for name in objects if "/objects/" in name and name.count("/") == 3)
        objects[name] = objects[name][:-1]
        damaged = dicflow("pull", tmp_path / "again", "s3://laboratory/plate")
        damaged.refuses(2, name.removeprefix("plate"), "is damaged")
    assert hits(tmp_path / "pipeline.yaml", tmp_path / "store")["hit"] == TASKS


def test_a_run_pushed_to_a_folder_is_a_store_there(measured, tmp_path):
    assert dicflow("push", measured / ".dicflow", tmp_path / "share").code == 0
    assert hits(measured / "pipeline.yaml", tmp_path / "share")["hit"] == TASKS
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    dicflow("push", measured / ".dicflow", tmp_path / "mine").refuses(2, "holds other files and is not a store")


def changed_photograph(crate):
    path = next((crate / "files" / "left").glob("*.png"))
    path.write_bytes(path.read_bytes()[:-1] + b"?")


def longer_photograph(crate):
    path = next((crate / "files" / "left").glob("*.png"))
    path.write_bytes(path.read_bytes() + b"?")


def missing_photograph(crate):
    next((crate / "files" / "left").glob("*.png")).unlink()


def pipe_for_a_photograph(crate):
    path = next((crate / "files" / "left").glob("*.png"))
    path.unlink()
    os.mkfifo(path)


def link_to_a_secret(crate):
    path = next((crate / "files" / "left").glob("*.png"))
    shutil.move(path, crate.parent / "secret")
    path.symlink_to(crate.parent / "secret")


def linked_store(crate):
    shutil.move(crate / "store", crate.parent / "elsewhere")
    (crate / "store").symlink_to(crate.parent / "elsewhere")


def damaged_product(crate):
    path = next((crate / "store" / "objects").glob("*/*/*/c*"))
    path.write_bytes(path.read_bytes()[:-1])


def no_store(crate):
    shutil.rmtree(crate / "store")


def no_description(crate):
    (crate / METADATA).unlink()


def cut_description(crate):
    (crate / METADATA).write_bytes((crate / METADATA).read_bytes()[:-20])


def other_description(crate):
    (crate / METADATA).write_text('{"@graph": [{"@id": "./"}]}')


def list_for_a_description(crate):
    (crate / METADATA).write_text("[1, 2]")


def endless_size(crate):
    rewrite(crate, lambda graph: graph["files/times.csv"].update(contentSize="9" * 5000))


def undescribed_pipeline(crate):
    rewrite(crate, lambda graph: graph["./"]["mainEntity"].update({"@id": "files/other.yaml"}))


DAMAGES = [
    changed_photograph, longer_photograph, missing_photograph, pipe_for_a_photograph, link_to_a_secret, linked_store,
    damaged_product, no_store, no_description, cut_description, other_description, list_for_a_description, endless_size,
    undescribed_pipeline,
]  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_crate_is_one_sentence_and_leaves_nothing(crate, tmp_path, damage):
    damage(crate)
    before = set(tmp_path.rglob("*"))
    dicflow("import", crate, tmp_path / "there").refuses(2, str(crate))
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "name",
    [
        "../escaped.txt",
        "left/../../escaped.txt",
        "/tmp/escaped.txt",
        ".dicflow/dicflow.json",
        "a\\b",
        "c:x",
        "a//b",
        "a\x1b",
    ],
)
def test_no_name_in_a_crate_leads_out_of_the_folder(crate, tmp_path, name):
    """Also where the file is there, with its size and digest."""
    (crate / "files" / "left").mkdir(exist_ok=True)

    def rename(graph):
        entity = graph["files/times.csv"]
        entity["@id"] = f"files/{name}"
        next(part for part in graph["./"]["hasPart"] if part["@id"] == "files/times.csv")["@id"] = f"files/{name}"

    rewrite(crate, rename)
    shutil.copy(crate / "files" / "times.csv", crate / "escaped.txt")
    before = set(tmp_path.rglob("*"))
    dicflow("import", crate, tmp_path / "there").refuses(2, "names a file outside the crate, hidden, or not described")
    assert set(tmp_path.rglob("*")) == before


def test_what_could_not_be_measured_elsewhere_is_refused(measured, tmp_path, monkeypatch):
    folder = shutil.copytree(measured, tmp_path / "plate")
    pipeline, text = folder / "pipeline.yaml", PIPELINE

    def refused(*words, more=()):
        dicflow("export", pipeline, "--format", "crate", "--output", tmp_path / "out", *more).refuses(2, *words)
        assert not (tmp_path / "out").exists()

    refused("write --set into the file", more=["--set", "photos.unpaired=skip"])
    refused("name no stage", more=["--step", "Löad 0"])
    pipeline.write_text(text.replace('"left/*.png"', f'"{folder}/left/*.png"'))
    assert hits(pipeline)["hit"] == TASKS
    refused("names files by their whole paths; write relative ones")
    monkeypatch.chdir(folder)
    refused("names files by their whole paths; write relative ones")
    pipeline.write_text(text)
    photograph = folder / "left" / "Löad 0.png"
    photograph.write_bytes((folder / "left" / "Löad 1.png").read_bytes())
    refused("would be measured again", "run it again, then export it")
    pipeline.write_text(text.replace("[5, 5, 35, 35]", "[6, 5, 35, 35]"))
    refused("has not been run with these settings; run it, then export it")


def test_a_folder_with_files_is_not_imported_into(crate, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    dicflow("import", crate, tmp_path / "mine").refuses(2, "is not empty")
