"""What can be compared, and what a comparison finds, on a small experiment."""

import os
import shutil

import numpy as np
import pytest

from dicflow.comparison.difference import compare
from dicflow.comparison.sides import TableSide, open_sides
from dicflow.core.cameras.camera import project
from dicflow.engine.journal import runs
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, InputError, StoreError
from dicflow.io.points_table import PointTable
from dicflow.kinds.rig import rig_from_json
from dicflow.pipeline import Pipeline
from dicflow.views.exports import Selection, export


@pytest.fixture(scope="module")
def run_id(pipeline, measured):
    """The run of the unchanged pipeline file."""
    stages = Pipeline.load(pipeline).resolved()["stages"]
    return next(run.id for run in runs(Store.open(measured)) if run.resolved["stages"] == stages)


@pytest.fixture(scope="module")
def sweep(pipeline, measured, tmp_path_factory):
    """A sweep over the strain's window, beside a copy of the pipeline and in a copy of its store."""
    path = shutil.copytree(pipeline.parent, tmp_path_factory.mktemp("sweep") / "small") / "windows.yaml"
    text = pipeline.read_text()
    window = Pipeline.load(pipeline).resolved()["stages"]["strain"]["window"]
    path.write_text(f"{text}\nsweep:\n  grid: {{strain.window: [{window}, [61, 61]]}}\n")
    os.utime(path, (1e9, 1e9))
    Pipeline.load(path).run(scheduler="sync", workers=1)
    return path


def table_of(side, step, shift=0.0, sigma=None):
    """The field of a side as a table of points, U moved by a shift."""
    field = side.field(step)
    known = np.isfinite(field.values["U"])
    values = {name: field.values[name][known] for name in ("U", "V", "W")}
    values["U"] = values["U"] + shift
    sigmas = {} if sigma is None else {"U": np.full(known.sum(), sigma)}
    return TableSide("table.csv", PointTable(field.places[known], values, sigmas, {}))


def test_a_pipeline_and_its_run_do_not_differ(pipeline, run_id):
    found = compare(*open_sides(str(pipeline), run_id))
    assert not found.differs
    assert found.changes == ()
    assert {one.quantity for one in found.differences} == {"U", "V", "W", "exx", "eyy", "gxy"}
    assert all(one.agreement.largest == 0.0 and one.agreement.share == 1.0 for one in found.differences)
    assert found.to_json()["differs"] is False


def test_variants_differ_in_what_was_swept(sweep):
    found = compare(*open_sides(f"{sweep}#1", f"{sweep}#2"), steps=["step_02"], quantities=["U", "eyy"])
    assert [change.name for change in found.changes] == ["strain.window"]
    displacement, strain = found.differences
    assert displacement.agreement.largest == 0.0
    assert strain.agreement.rms > 0.0
    assert found.differs
    assert "#2 (strain.window = [61, 61])" in found.b


def test_swapping_changes_signs_only(sweep):
    one, other = open_sides(f"{sweep}#1", f"{sweep}#2")
    there, back = (compare(*sides, quantities=["exx"]).differences[-1] for sides in ((one, other), (other, one)))
    np.testing.assert_array_equal(there.values, -back.values)
    assert there.agreement.rms == back.agreement.rms
    assert there.agreement.mean == -back.agreement.mean


def test_a_shifted_table_with_sigma(pipeline, measured):
    side = open_sides(str(pipeline), str(pipeline))[0]
    step = side.steps[-1]
    found = compare(side, table_of(side, step, shift=0.25, sigma=0.3))
    moved = next(one for one in found.differences if one.quantity == "U")
    assert moved.step == step
    assert moved.agreement.mean == pytest.approx(-0.25)
    assert moved.agreement.sigma == pytest.approx(0.0, abs=1e-9)
    assert moved.agreement.share_beyond_sigma == 0.0
    assert found.changes is None
    assert any("Only B " in note and "σ" in note for note in found.notes)
    assert any("unit" in note for note in found.notes)


@pytest.mark.parametrize(("form", "mean"), [("csv", 1e-4), ("matchid", 1e-6), ("challenge", 1e-6)])
def test_an_exported_table_differs_by_its_digits_alone(form, mean, pipeline, measured, tmp_path):
    """Places of six digits in a CSV, of nine else; steep triangles at the edge make the most of the last one."""
    result = Pipeline.load(pipeline).result()
    step = result.steps("total")[-1]
    (table,) = export(result, tmp_path, Selection("total", step), to=form)
    sides = open_sides(str(pipeline), str(table))
    found = compare(*sides, (step,))
    (guessed,) = set(compare(*sides).notes) - set(found.notes)
    assert step in guessed
    assert {"U", "V", "W", "exx", "eyy"} <= {one.quantity for one in found.differences}
    assert max(abs(one.agreement.mean) for one in found.differences) < mean
    assert max(one.agreement.largest for one in found.differences) < 100.0 * mean


def test_a_coarser_table_is_compared_at_its_own_points(pipeline, measured):
    side = open_sides(str(pipeline), str(pipeline))[0]
    whole = table_of(side, side.steps[-1]).table
    few = TableSide("few.csv", PointTable(whole.xy[::7], {"U": whole.values["U"][::7]}, {}, {}))
    (found,) = compare(few, side).differences
    assert found.places.shape == few.table.xy.shape
    assert found.agreement.points > 0.9 * len(few.table.xy)
    assert found.agreement.largest < 1e-9


def test_places_are_those_of_the_raw_left_photograph(pipeline, measured):
    side = open_sides(str(pipeline), str(pipeline))[0]
    result = Pipeline.load(pipeline).result()
    rig = rig_from_json(result.product("rig").attrs["rig"])
    seen = project(rig.left, result.product("total", -1)["xyz_reference"])
    apart = np.linalg.norm(side.field(side.steps[-1]).places - seen, axis=-1)
    assert np.nanmedian(apart) < 0.5


def refused(error, *words):
    """The one sentence of an error holds all these words."""
    assert "\n" not in str(error.value)
    assert all(word in str(error.value) for word in words), str(error.value)


def test_sides_that_cannot_be_compared(pipeline, measured, run_id, tmp_path):
    ours = str(pipeline)
    with pytest.raises(StoreError) as error:
        open_sides(ours, "20200101-000000-abcdef")
    refused(error, "unknown run '20200101-000000-abcdef'")
    with pytest.raises(ConfigurationError) as error:
        open_sides(ours, "nowhere.csv")
    refused(error, "nowhere.csv", "file")
    with pytest.raises(ConfigurationError) as error:
        open_sides(ours, f"{ours}#2")
    refused(error, "there are 1 variants")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError) as error:
        open_sides(ours, str(tmp_path / "other.csv"))
    refused(error, "other.csv:1", "a, b")
    with pytest.raises(StoreError) as error:
        open_sides(ours, ours, store=tmp_path / "empty")
    refused(error, "no displacement or strain")


def test_steps_and_quantities_that_are_not_shared_are_listed(pipeline, measured):
    side = open_sides(str(pipeline), str(pipeline))[0]
    with pytest.raises(ConfigurationError) as error:
        compare(side, side, steps=["step_09"])
    refused(error, "step_09", *side.steps)
    with pytest.raises(ConfigurationError) as error:
        compare(side, side, quantities=["ezz"])
    refused(error, "'ezz'", "eyy")
    other = side._replace(refs={(stage, f"other {step}"): ref for (stage, step), ref in side.refs.items()})
    with pytest.raises(ConfigurationError) as error:
        compare(side, other)
    refused(error, "no step", *side.steps)


def test_a_table_in_another_unit_has_nothing_in_common(pipeline, measured):
    side = open_sides(str(pipeline), str(pipeline))[0]
    table = table_of(side, side.steps[-1])
    pixels = TableSide("px.csv", table.table._replace(units=dict.fromkeys("UVW", "px")))
    with pytest.raises(ConfigurationError) as error:
        compare(side, pixels)
    refused(error, "in one unit")


def test_products_that_were_freed_are_named(pipeline, measured, run_id, tmp_path):
    store = tmp_path / ".dicflow"
    shutil.copytree(measured, store)
    side = open_sides(run_id, run_id, store=store)[0]
    digest = side.refs[side.total, side.steps[-1]].digest
    Store.open(store).object_path(digest).with_suffix(".json").unlink()
    with pytest.raises(StoreError) as error:
        compare(side, side, steps=side.steps[-1:])
    refused(error, run_id, side.steps[-1], "run the pipeline again")
