"""A pipeline from Python: what is computed again after which change, and results by name."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray
from PIL import Image
from small import BOARDS, ROOT, STEPS, TASKS

import dicflow
from dicflow.engine.execute import dask_graph
from dicflow.errors import ConfigurationError, DicflowError, StoreError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.past import check_steps
from dicflow.stages._kernels import get_ready


@pytest.fixture
def own(pipeline, measured, tmp_path):
    """The measured experiment in a folder of the test's own."""
    shutil.copytree(pipeline.parent, tmp_path / "own")
    return tmp_path / "own" / pipeline.name


def run(path, *settings, **options):
    result = Pipeline.load(path, settings=settings).run(scheduler="sync", **options)
    assert result.outcome.ok, result.outcome.errors
    return result


def computed(result):
    """Names of the tasks that were computed."""
    return {name for name, outcome in result.outcome.outcomes.items() if outcome.status == "computed"}


def repaint(path, paint, **options):
    with Image.open(path) as image:
        grey = np.array(image)
    Image.fromarray(paint(grey)).save(path, **options)


# what is computed again


def test_moving_and_touching_files_computes_nothing(own):
    for path in own.parent.rglob("*.png"):
        os.utime(path, (1, 1))
    assert computed(run(own)) == set()


def test_the_same_pixels_in_other_bytes_are_only_read_again(own):
    path = own.parent / "photos" / "left" / "step_01.png"
    before = path.read_bytes()
    repaint(path, lambda grey: grey, compress_level=1)
    assert path.read_bytes() != before
    assert computed(run(own)) == {"photos/step_01"}


def test_one_pixel_is_felt_by_its_step_and_the_pairs_beside_it(own):
    def brighten(grey):
        grey[260, 220] ^= 0x1F
        return grey

    repaint(own.parent / "photos" / "left" / "step_01.png", brighten)
    names = computed(run(own))
    for stage in ("photos", "pair", "features"):
        assert {name for name in names if name.startswith(f"{stage}/")} == {f"{stage}/step_01"}
    assert {"matches/step_01", "matches/step_02"} <= names
    assert not {name for name in names if name.startswith(("boards", "corners", "rig", "region"))}
    assert not {name for name in names if name.endswith("step_00")}


def test_a_pixel_of_a_board_that_moves_no_corner_stops_at_the_corners(own):
    def darken(grey):
        grey[0, 0] ^= 1
        return grey

    repaint(own.parent / "boards" / "right" / "board_03.png", darken)
    assert computed(run(own)) == {"boards/board_03", "corners/board_03"}


def test_another_name_for_a_stage_computes_nothing(own):
    text = own.read_text().replace("surface: {", "shape: {").replace("cloud: surface", "cloud: shape")
    own.with_name("renamed.yaml").write_text(text)
    assert computed(run(own.with_name("renamed.yaml"))) == set()


def test_one_more_step_computes_that_step(own):
    for side in ("left", "right"):
        folder = own.parent / "photos" / side
        shutil.copy(folder / "step_01.png", folder / "step_03.png")
    rows = (own.parent / "caliper.csv").read_text().splitlines()
    (own.parent / "longer.csv").write_text("\n".join([*rows, rows[-2]]) + "\n")
    names = computed(run(own, "comparison.caliper=longer.csv"))
    assert {name for name in names if "/" in name} >= {"matches/step_03", "track/step_03", "total/step_03"}
    assert not {name for name in names if name.endswith(("step_01", "step_02"))}
    assert {name for name in names if "/" not in name} == {"comparison", "maps"}


def test_processes_give_the_same_bytes_and_a_dashboard_that_names_the_stages(own):
    """Compared with what was computed in turn; the dashboard is asked over HTTP while the work goes on."""
    from bokeh.client import pull_session

    loaded, link, shown = Pipeline.load(own, store=own.parent / "other"), [], set()
    looked_for = {"rig", "disparity", "surface", "maps"}

    def record(event):
        if event.kind == "dashboard":
            link.append(event.text)
        elif event.stage in looked_for - shown:
            document = pull_session(url=link[0].replace("/status", "/individual-progress")).document
            models = [model for root in document.roots for model in root.references()]
            shown.update(name for model in models if hasattr(model, "data") for name in model.data.get("name", ()))

    there = loaded.run(scheduler="processes", workers=2, dashboard=True, on_event=record)
    assert there.outcome.counts["computed"] == TASKS
    assert link[0].startswith("http://127.0.0.1:")
    assert looked_for <= shown <= set(loaded.graph.stages)
    here = Pipeline.load(own).result()
    for stage in here.stages:
        for step in here.steps(stage) or (None,):
            assert there.digest(stage, step) == here.digest(stage, step), (stage, step)


def test_the_graph_for_dask_is_plain_and_readable(own, tmp_path):
    loaded = Pipeline.load(own, store=tmp_path / "new")
    tasks = dask_graph(loaded.plan(), loaded.store)
    assert len(tasks) == TASKS
    assert {key[0] for key in tasks} == set(loaded.graph.stages)
    assert all(callable(value[0]) for value in tasks.values())


# sweeps


def test_variants_share_stages_and_give_a_table(own):
    result = run(own, "strain.window=[80, 20],[60, 60]", "total.stage=accumulate")
    assert computed(result) == {
        *(f"{s}@2/step_0{k}" for s in ("strain", "total") for k in (1, 2)),
        "comparison@2",
        "maps@2",
    }
    table = result.table()
    assert [row["strain.window"] for row in table] == [[80, 20], [60, 60]]
    assert table[0]["rig.rms_px"] == table[1]["rig.rms_px"] < 0.1
    assert table[0]["total.mean_eyy"] != table[1]["total.mean_eyy"]
    means = [result.product("total", step, 1).attrs["summary"]["mean_eyy"] for step in result.steps("total")]
    assert table[1]["total.mean_eyy"] == pytest.approx(np.mean(means))
    assert result.digest("surface", 0, 0) == result.digest("surface", 0, 1)


def test_variants_with_equal_values_are_one(own):
    loaded = Pipeline.load(own, settings=["strain.window=[60, 60],[60.0, 60 px]"])
    assert len(loaded.variants) == 2
    assert len(loaded.graph.stages) == 19


def test_variants_may_have_photographs_of_their_own(tmp_path):
    for name in ("soft/1.png", "soft/2.png", "stiff/7.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        Image.fromarray(np.eye(40, dtype=np.uint8)).save(tmp_path / name)
    path = tmp_path / "p.yaml"
    path.write_text(
        'stages: {photos: {stage: images, left: ""}}\nsweep: {grid: {photos.left: [soft/*.png, stiff/*.png]}}\n'
    )
    result = run(path)
    assert [result.steps("photos", variant) for variant in (0, 1)] == [("1", "2"), ("7",)]
    assert [row["photos.left"] for row in result.table()] == ["soft/*.png", "stiff/*.png"]
    assert result.has("photos", "7", variant=1)


# results by name


@pytest.fixture(scope="module")
def result(pipeline, measured):
    return Pipeline.load(pipeline).result()


def test_the_package_offers_pipelines():
    assert dicflow.Pipeline is Pipeline
    with pytest.raises(AttributeError, match="no attribute 'pipline'"):
        _ = dicflow.pipline


def test_datasets_by_name(result):
    total = result.dataset("total", "step_02")
    assert isinstance(total, xarray.Dataset)
    assert total["eyy"].dims == ("row", "col")
    assert total["U"].attrs["units"] == "mm"
    xarray.testing.assert_identical(total, result.dataset("total", -1))
    assert result.kind("total") == "total"
    assert result.steps("total") == ("step_01", "step_02")
    assert result.steps("rig") == ()
    assert len(result.steps("boards")) == BOARDS
    assert result.stages_of("cloud") == ["cloud", "filled", "surface"]
    assert result.source("maps", "total") == "total"


def test_every_product_opens_as_a_dataset(result):
    for stage in result.stages:
        step = 0 if result.steps(stage) else None
        assert set(result.dataset(stage, step).data_vars) == set(result.product(stage, step).variables)


def test_the_strain_is_what_was_imposed(result):
    """In the middle of the strip, within two per cent of the caliper's stretch."""
    rows = result.product("comparison").attrs["rows"]
    lengths = np.array([row["caliper_length_mm"] for row in rows])
    for step, imposed in zip(result.steps("total"), lengths[1:] / lengths[0] - 1, strict=True):
        assert np.nanmean(result.product("total", step)["eyy"]) == pytest.approx(imposed, rel=0.02)


def test_names_that_do_not_exist(result):
    for call, message in [
        (lambda: result.product("totl"), "no stage 'totl', did you mean 'total'?"),
        (lambda: result.product("total"), "total has steps; name one, as in total/step_01, of step_01, step_02"),
        (lambda: result.product("total", 7), "total has no step '7'; it has step_01, step_02"),
        (lambda: result.product("rig", "step_01"), "rig runs once and has no steps"),
        (lambda: result.product("rig", variant=1), r"no variant with index 1: there is one, '#1' or index 0"),
    ]:
        with pytest.raises(ConfigurationError, match=message.replace("?", r"\?")):
            call()


def test_a_product_that_was_not_computed_is_missing(pipeline, tmp_path):
    empty = Pipeline.load(pipeline, store=tmp_path / "new").result()
    assert not empty.has("rig")
    assert empty.outcome is None
    with pytest.raises(DicflowError, match="rig is not in the store"):
        empty.product("rig")


def test_defaults_of_a_pipeline(pipeline):
    loaded = Pipeline.load(str(pipeline))
    assert loaded.name == "quickstart"
    assert loaded.title.startswith("Latex strip")
    assert loaded.store_folder == pipeline.parent / ".dicflow"
    stages = loaded.resolved()["stages"]
    assert stages["strain"]["degree"] == 2
    assert stages["strain"]["inputs"] == {"increment": "smooth"}
    assert loaded.resolved()["instances"] == [{stage: stage for stage in stages}]
    swept = Pipeline.load(pipeline, settings=["maps.percentile=0,1"]).resolved()
    assert [names["maps"] for names in swept["instances"]] == ["maps", "maps@2"]


def test_a_result_draws_what_it_holds(pipeline, measured):
    result = dicflow.Pipeline.load(pipeline).result()
    figure = dicflow.plot(result, "total", "eyy", step="step_01")
    assert figure.axes[0].get_title() == "step_01"
    with pytest.raises(ConfigurationError, match=r"'ezz' in total.* U, V, W"):
        dicflow.plot(result, "total", "ezz")
    with pytest.raises(ConfigurationError, match="total has no step 'step_7'"):
        dicflow.plot(result, "total", "eyy", step="step_7")


def test_workers_compute_with_one_thread():
    import cv2

    before = cv2.getNumThreads()
    try:
        get_ready()
        assert cv2.getNumThreads() == 1
    finally:
        cv2.setNumThreads(before)


@pytest.mark.parametrize("path", sorted((ROOT / "pipelines").glob("*.yaml")), ids=lambda path: path.stem)
def test_pipelines_of_the_repository_are_valid(path):
    loaded = Pipeline.load(path, data=ROOT / "data_samples")
    assert loaded.variants
    assert path.read_text().startswith("# ")
    assert Path(loaded.document.source) == path


def test_steps_are_counted(result):
    assert sum(len(result.steps(stage)) or 1 for stage in result.stages) == TASKS
    assert len(result.steps("photos")) == STEPS


@pytest.mark.parametrize("name", ["../x", "a/b", "/etc/passwd", "..", ""])
def test_steps_that_a_store_names_are_names_of_files(name):
    with pytest.raises(StoreError, match=r"names a step .*; do not use this store"):
        check_steps(Path("store"), {"photos": ["step_01", name]})
    check_steps(Path("store"), {"photos": ["step_01", "a b.c", "..a"]})
