import json

import numpy as np
import pytest
from analytic import affine, cloud, run_all, track, tracks
from looking import ran

from dicflow.engine.node import Joined
from dicflow.engine.product import Product, Variable
from dicflow.errors import InputError, StageError
from dicflow.kinds.region import polygons_to_json
from dicflow.stages.compare import Compare
from dicflow.stages.deformation import Deformation

LENGTHS = [12.0, 15.0, 24.0, 18.0]
PHASES = ["loading", "loading", "loading", "unloading"]
TOTALS = [affine(xx=(12.0 / length) ** 0.5, yy=length / 12.0) for length in LENGTHS]


def table(tmp_path, lengths=LENGTHS):
    path = tmp_path / "caliper.csv"
    rows = [f"{phase},{100 * k},{length}" for k, (phase, length) in enumerate(zip(PHASES, lengths, strict=False))]
    path.write_text("\n".join(["phase,load_g,length_mm", *rows]) + "\n")
    return path


def compare(path, clouds=None, totals=TOTALS, **parameters):
    return Compare(caliper=str(path), **parameters).run(track=tracks(totals), cloud=clouds, caliper_path=path)


@pytest.mark.parametrize("length", ["tracked", "cloud"])
def test_perfect_lengths_have_no_error(tmp_path, length):
    result = compare(table(tmp_path), [cloud()] * 4, length=length)
    assert np.allclose(result["dic_length_mm"], LENGTHS, atol=1e-8)
    assert np.allclose(result["cloud_length_mm"], result["tracked_length_mm"], atol=1e-8)
    assert np.allclose(result["displacement_error_mm"], 0.0, atol=1e-8)
    assert np.allclose(result["dic_strain"], np.array(LENGTHS) / 12 - 1)
    assert result.attrs["summary"]["max_strain_error_pct"] < 1e-6
    assert result.attrs["summary"]["measured_steps"] == 4
    assert result.attrs["length"] == length


def test_columns_are_the_thesis_tables(tmp_path):
    result = compare(table(tmp_path), [cloud()] * 4)
    expected = [
        *("phase", "load_g", "caliper_length_mm", "caliper_displacement_mm", "caliper_strain"),
        *("dic_length_mm", "dic_displacement_mm", "dic_strain"),
        *("displacement_error_mm", "displacement_error_pct", "strain_error", "strain_error_pct"),
    ]
    assert list(result.attrs["rows"][0])[: len(expected)] == expected
    assert [row["phase"] for row in result.attrs["rows"]] == PHASES
    assert result.variables["displacement_error_pct"].units == "%"
    assert result.variables["caliper_strain"].units == "1"
    assert result.variables["load_g"].units == "g"
    json.dumps(result.attrs, allow_nan=False)


def test_errors_as_in_the_tables(tmp_path):
    """A caliper that reads 12, 14.7, … against 12, 15, …: 0.3 mm of 2.7 mm too much."""
    result = compare(table(tmp_path, [12.0, 14.7, 24.0, 18.0]), [cloud()] * 4)
    row = result.attrs["rows"][1]
    assert row["displacement_error_mm"] == pytest.approx(0.3)
    assert row["displacement_error_pct"] == pytest.approx(100 * 0.3 / 2.7)
    assert row["strain_error"] == pytest.approx(0.025)
    assert row["strain_error_pct"] == pytest.approx(100 * 0.025 / 0.225)
    assert result.attrs["rows"][0]["displacement_error_pct"] == 0.0
    assert result.attrs["summary"]["max_displacement_error_pct"] == pytest.approx(100 * 0.3 / 2.7)
    assert result.attrs["summary"]["max_displacement_error_mm"] == pytest.approx(0.3)


def test_a_tilted_specimen_is_measured_in_space(tmp_path):
    result = compare(table(tmp_path), [cloud((0.0, 0.75))] * 4)
    assert np.allclose(result["dic_length_mm"], 1.25 * np.array(LENGTHS), atol=1e-8)
    assert result.attrs["summary"]["max_strain_error_pct"] < 1e-6


def test_axis_x(tmp_path):
    totals = [affine(xx=length / 12.0) for length in LENGTHS]
    for length in ("tracked", "cloud"):
        result = compare(table(tmp_path), [cloud(shape=(200, 200))] * 4, totals, axis="x", length=length)
        assert np.allclose(result["dic_length_mm"], 0.5 * np.array(LENGTHS), atol=1e-8)


def test_one_camera_compares_strain_only(tmp_path):
    result = compare(table(tmp_path))
    assert np.allclose(result["dic_length_px"], 10 * np.array(LENGTHS))
    assert "displacement_error_mm" not in result
    assert "cloud_length_px" not in result
    assert set(result.attrs["summary"]) == {"measured_steps", "max_strain_error_pct"}
    with pytest.raises(StageError, match="use length: tracked"):
        compare(table(tmp_path), length="cloud")


def test_mean_strain_of_the_field_stands_beside(tmp_path):
    path = table(tmp_path)
    totals = [total for _, _, total in run_all(TOTALS, [cloud()] * 4)]
    given = {"track": tracks(TOTALS), "cloud": [cloud()] * 4, "total": totals}
    result = ran(Compare(caliper=str(path)), **given, caliper_path=path)
    assert np.allclose(result["field_strain"], np.array(LENGTHS) / 12 - 1)


def test_a_lost_step_is_empty_and_the_others_count(tmp_path):
    steps = tracks(TOTALS)
    lost = np.full_like(steps[2]["points"], np.nan)
    variables = {**steps[2].variables, "points": Variable(("row", "col", "component"), lost)}
    steps[2] = Product("track", variables, steps[2].attrs)
    path = table(tmp_path)
    result = Compare(caliper=str(path)).run(track=steps, caliper_path=path)
    assert result.attrs["rows"][2]["dic_length_px"] is None
    assert result.attrs["summary"]["measured_steps"] == 3


def test_the_largest_part_of_a_region_is_measured(tmp_path):
    steps = tracks(TOTALS)
    crumb = [{"exterior": [[0, 0], [3, 0], [3, 3]], "holes": []}]
    parts = [Product("track", s.variables, {**s.attrs, "polygons": crumb + s.attrs["polygons"]}) for s in steps]
    path = table(tmp_path)
    result = Compare(caliper=str(path)).run(track=parts, cloud=[cloud()] * 4, caliper_path=path)
    assert np.allclose(result["cloud_length_mm"], LENGTHS, atol=1e-8)


def test_wrong_number_of_rows_names_both(tmp_path):
    path = table(tmp_path, LENGTHS[:3])
    node = Compare(caliper=str(path))
    node.agree({path: node.check(path)}, {}, {"track": ("0", "1", "2")})
    with pytest.raises(InputError, match=r"caliper\.csv: .*3 rows.* 4 steps"):
        node.agree({path: node.check(path)}, {}, {"track": ("0", "1", "2", "3")})


def test_the_table_is_checked_before_anything_runs(tmp_path):
    path = table(tmp_path)
    assert Compare(caliper=str(path)).check(path) == {"rows": 4}
    path.write_text("phase,load_g,length_mm\nloading,0,long\n")
    with pytest.raises(InputError, match=r"caliper\.csv:2: length_mm .*'long'"):
        Compare(caliper=str(path)).check(path)


def test_polygons_of_the_track_are_json():
    assert json.loads(json.dumps(track(np.eye(3)).attrs["polygons"])) == track(np.eye(3)).attrs["polygons"]
    assert polygons_to_json([]) == []


def probes(lengths, unit="mm"):
    strains = np.array(lengths) / lengths[0] - 1
    variables = {
        "length": Variable(("extensometer", "step"), np.array([[1.0] * 4, lengths]), unit),
        "strain": Variable(("extensometer", "step"), np.array([[0.0] * 4, strains])),
        "sigma_strain": Variable(("extensometer", "step"), np.array([[0.0] * 4, [0.0, 1e-4, 2e-4, 3e-4]])),
    }
    return Product("probes", variables, {"unit": unit, "probes": {"extensometer": ["short", "long"]}})


def test_an_extensometer_is_compared_in_the_same_columns(tmp_path):
    path = table(tmp_path)
    measured = [12.06, 15.09, 24.12, 18.0]
    result = Compare(caliper=str(path), extensometer="long").run(probes=probes(measured), caliper_path=path)
    assert list(result["dic_length_mm"]) == measured
    assert list(result["extensometer_length_mm"]) == measured
    assert result["strain_error"] == pytest.approx(np.array(measured) / 12.06 - np.array(LENGTHS) / 12)
    assert result["displacement_error_mm"] == pytest.approx([0.0, 0.03, 0.06, -0.06])
    assert list(result["sigma_strain"]) == [0.0, 1e-4, 2e-4, 3e-4]
    assert result.attrs["length"] == "extensometer"
    assert list(result.attrs["rows"][0])[:9] == list(compare(path, [cloud()] * 4).attrs["rows"][0])[:9]


def test_a_shorter_extensometer_is_compared_in_strain_alone(tmp_path):
    path = table(tmp_path)
    half = Compare(caliper=str(path), extensometer="long").run(
        probes=probes([length / 2 for length in LENGTHS]), caliper_path=path
    )
    assert "displacement_error_mm" not in half
    assert half.attrs["summary"]["max_strain_error_pct"] == pytest.approx(0.0, abs=1e-9)
    pixels = Compare(caliper=str(path), extensometer="long").run(probes=probes(LENGTHS, "px"), caliper_path=path)
    assert "displacement_error_mm" not in pixels
    assert list(pixels["dic_length_px"]) == LENGTHS


@pytest.mark.parametrize(
    ("joined", "given", "named"),
    [
        ({}, {}, ["extensometer"]),
        ({}, {"extensometer": "long"}, []),
        ({"total": "green_lagrange"}, {}, ["total"]),
        ({"total": "engineering"}, {}, []),
    ],
)
def test_what_a_comparison_needs_is_named_before_it_runs(joined, given, named):
    whole = {port: Joined(Deformation(measure=measure), (), {}, (), {}) for port, measure in joined.items()}
    assert [parameter for parameter, _ in Compare(caliper="c.csv", **given).problems(whole)] == named


def test_an_extensometer_that_is_not_there(tmp_path):
    path = table(tmp_path)
    with pytest.raises(StageError, match=r"'wide'.* short, long"):
        Compare(caliper=str(path), extensometer="wide").run(probes=probes(LENGTHS), caliper_path=path)
    with pytest.raises(StageError, match="add a stage 'probes'"):
        Compare(caliper=str(path), extensometer="wide").run(caliper_path=path)
    with pytest.raises(InputError, match=r"4 rows.* 3 steps"):
        Compare(caliper=str(path), extensometer="long").agree({path: {"rows": 4}}, {}, {"total": ("b", "c")})


PRECISE = {"definition": "precise"}


def test_without_a_track_the_mean_strain_of_the_field_is_compared(tmp_path):
    path = table(tmp_path)
    strains = [length / LENGTHS[0] - 1.0 for length in LENGTHS[1:]]
    field = np.array([[-1e-3, np.nan], [1e-3, 0.0]])
    total = [Product("total", {"eyy": Variable(("row", "col"), strain + field)}, PRECISE) for strain in strains]
    found = ran(Compare(caliper=str(path)), total=total, caliper_path=path)
    assert found.attrs["length"] == "field"
    assert found["dic_strain"] == pytest.approx([0.0, *strains])
    other = [Product("total", total[0].variables, {**PRECISE, "measure": "hencky"})] * len(total)
    with pytest.raises(StageError, match="hencky; set measure: engineering"):
        ran(Compare(caliper=str(path)), total=other, caliper_path=path)
    thesis = [Product("total", total[0].variables, {"definition": "thesis"})] * len(total)
    with pytest.raises(StageError, match=r"thesis.* definition: material"):
        ran(Compare(caliper=str(path)), total=thesis, caliper_path=path)
    with pytest.raises(StageError, match=r"4 rows .*3 steps"):
        ran(Compare(caliper=str(path)), total=total[1:], caliper_path=path)
