"""Stages curve, stress and hyperelastic, in pipelines without photographs."""

import numpy as np
import pytest

from dicflow.core.material.fit import Curve as FitCurve
from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import principal_stretches
from dicflow.core.material.response import stress_in_mode
from dicflow.engine.product import Variable
from dicflow.errors import ConfigurationError, DicflowError, InputError, StageError
from dicflow.io.results import csv_text
from dicflow.kinds.channels import Channel, Channels
from dicflow.kinds.curve import StressCurve
from dicflow.kinds.material import Material
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.sheet import SheetFacts, SheetFields
from dicflow.pipeline import Pipeline
from dicflow.stages._verdict import not_excluded
from dicflow.stages.curve import Curve
from dicflow.stages.hyperelastic import Hyperelastic, fitted_model
from dicflow.stages.stress import Stress
from dicflow.synth.rubber import CONSTANTS, rubber_table

G = 9.80665
STRIP = {"width": 20.0, "thickness": 0.21, "u_width": 0.2, "u_thickness": 0.005, "caliper": "a.csv"}


def written(tmp_path, text, name="a.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def caliper(tmp_path, loads, lengths):
    rows = [f"loading,{load},{length}" for load, length in zip(loads, lengths, strict=True)]
    return written(tmp_path, "\n".join(["phase,load_g,length_mm", *rows]))


def curve(tmp_path, text, **given):
    return StressCurve.read(Curve(file="a.csv", mode="uniaxial", **given).run(written(tmp_path, text)))


# curve


def test_true_stress_in_another_unit_becomes_nominal(tmp_path):
    found = curve(tmp_path, "strain_pct,true_stress_kPa,u_true_stress_kPa\n50,300,6\n100,800,8\n")
    assert found["stretch"].tolist() == [1.5, 2.0]
    np.testing.assert_allclose(found["nominal_stress"], [0.2, 0.4])
    np.testing.assert_allclose(found["u_nominal_stress"], [0.004, 0.004])
    np.testing.assert_allclose(found["true_stress"], [0.3, 0.8])


def test_uncertainties_may_be_given_for_all_points(tmp_path):
    found = curve(
        tmp_path, "stretch,nominal_stress_MPa\n1.01,0.01\n2,1\n", u_stress=0.02, u_stretch=0.001, common_stress=0.03
    )
    np.testing.assert_allclose(found["u_nominal_stress"], [0.001, 0.02])
    np.testing.assert_allclose(found["common_nominal_stress"], [0.0003, 0.03])
    assert found.common == (0.03, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stretch,force_N\n1,2\n2,3\n", r"a\.csv:1: no column of the stress .*name one column nominal_stress_MPa"),
        ("stretch,nominal_stress\n1,2\n2,3\n", r"'nominal_stress' does not say its unit"),
        ("stretch,nominal_stress_bar\n1,2\n2,3\n", r"'nominal_stress_bar' does not say its unit"),
        ("stretch,stress_MPa\n1,2\n2,3\n", r"'stress_MPa' does not say whether it is nominal or true"),
        ("length,nominal_stress_MPa\n1,2\n2,3\n", "no column of the stretch"),
        ("stretch,nominal_stress_MPa\n1,2\n", "has 1 rows below the names; write two or more"),
        ("stretch,nominal_stress_MPa\n0,0\n2,1\n", "a stretch is 0"),
        ("strain,nominal_stress_MPa\n-1.5,0\n2,1\n", "a stretch is -0.5"),
        ("phase,stretch,nominal_stress_MPa\nresting,1,0\n", "the phase is 'resting'"),
        ("stretch,nominal_stress_MPa,u_stretch\n1,0,-1\n2,1,1\n", "an uncertainty is empty, negative"),
        ("stretch,nominal_stress_MPa,u_nominal_stress_MPa\n1,0,0\n2,1,1\n", "or that of a stress 0"),
        ("stretch,nominal_stress_MPa,nominal_stress_kPa\n1,0,0\n2,1,1\n", "several columns of the stress"),
    ],
)
def test_what_is_wrong_in_a_table_is_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        Curve(file="a.csv", mode="uniaxial").check(written(tmp_path, text))


def test_the_exported_curve_of_another_test_is_the_same(tmp_path):
    """With a step that is lost, and both shares of its uncertainty; the table has six digits."""
    stage = Stress(width=20, u_width=0.2, thickness=0.21, u_thickness=0.005, probe="gauge")
    product = stage.run(channels=made_channels(), probes=made_probes((0.0, 0.1, np.nan)))
    written(tmp_path, csv_text(product, "strip"), "strip.csv")
    one, other = (StressCurve.read(p) for p in (product, Curve(file="a", mode="uniaxial").run(tmp_path / "strip.csv")))
    for mine, read in zip(one.points("loading", 0, 9), other.points("loading", 0, 9), strict=True):
        assert (mine is None) == (read is None)
        if mine is not None:
            np.testing.assert_allclose(read, mine, rtol=1e-5)
    np.testing.assert_allclose(other.common, one.common, rtol=1e-5)
    assert one.phases == other.phases


def test_an_empty_cell_is_an_unknown_point(tmp_path):
    found = Curve(file="a.csv", mode="uniaxial").run(
        written(tmp_path, "stretch,nominal_stress_MPa\n1,0\n1.2,\n1.5,0.3\n2,0.6\n")
    )
    assert found.warnings[0].startswith("1 step has no load or no stretch")
    assert len(StressCurve.read(found).points(None, 0, 9).stress) == 2


def test_a_load_that_runs_against_the_stretch_is_refused(tmp_path):
    with pytest.raises(StageError, match="runs against the stretch"):
        curve(tmp_path, "stretch,nominal_stress_MPa\n1,2\n1.5,1\n2,0\n")
    with pytest.raises(StageError, match="the load is the same at all 2 steps"):
        curve(tmp_path, "stretch,nominal_stress_MPa\n1,2\n1.5,2\n")


# stress


def test_stress_of_weights_on_a_section(tmp_path):
    path = caliper(tmp_path, [0, 100, 200], [60, 66, 75])
    found = StressCurve.read(Stress(**STRIP).run(caliper_path=path))
    nominal = np.array([0, 0.1, 0.2]) * G / (20 * 0.21)
    np.testing.assert_allclose(found["nominal_stress"], nominal)
    np.testing.assert_allclose(found["stretch"], [1, 1.1, 1.25])
    np.testing.assert_allclose(found["true_stress"], nominal * [1, 1.1, 1.25])
    np.testing.assert_allclose(found["u_stretch"], [0, 0.05 / 60, 0.05 / 60])
    np.testing.assert_allclose(found["u_nominal_stress"][1:], 1e-4 * G / (20 * 0.21))
    share = np.hypot(0.2 / 20, 0.005 / 0.21)
    np.testing.assert_allclose(found["common_nominal_stress"], share * nominal)
    np.testing.assert_allclose(found["common_stretch"], found["stretch"] * 0.05 / 60)
    assert found.common == (pytest.approx(share), pytest.approx(0.05 / 60))


def test_loading_ends_at_the_largest_load_whatever_the_table_says(tmp_path):
    path = caliper(tmp_path, [0, 100, 200, 100, 0], [60, 66, 75, 68, 61])
    found = StressCurve.read(Stress(**STRIP).run(caliper_path=path))
    assert found.phases == ("loading",) * 3 + ("unloading",) * 2
    assert found.summary["set"] == pytest.approx(1 / 60)
    assert found.summary["u_set"] == pytest.approx(0.05 / 60, rel=0.01)
    assert found.summary["loop_work_mJ_mm3"] > 0


def made_channels(unit="N", load="force", u=0.02):
    force = np.array([0.0, 1.0, 2.0])
    channel = Channel(force, unit, "force", None if u is None else np.full(3, u))
    return Channels.write({"force": channel}, ["a", "b", "c"], load=load, phases=["loading"] * 3)


def made_probes(strain=(0.0, 0.1, 0.25)):
    values = np.array([strain])
    arrays = {
        name: Variable(("extensometer", "step"), array)
        for name, array in (("strain", values), ("u_strain", values * 0 + 1e-4), ("calibration_strain", values * 1e-3))
    }
    arrays |= {
        name: Variable(("probe", "step"), array)
        for name, array in (("eyy", values), ("exx", -0.4 * values), ("u_eyy", values * 0 + 2e-4))
    }
    probes = {"point": [], "line": [], "area": ["middle"], "extensometer": ["gauge"]}
    return ProbeTable.write(arrays, ["a", "b", "c"], probes, [], {"unit": "mm"})


@pytest.mark.parametrize(("unit", "factor"), [("N", 1.0), ("kN", 1e3), ("g", 1e-3 * G), ("kg", G)])
def test_load_of_a_channel_and_stretch_of_an_extensometer(unit, factor):
    stage = Stress(width=20, thickness=0.21, u_thickness=0.005, probe="gauge")
    found = StressCurve.read(stage.run(channels=made_channels(unit), probes=made_probes()))
    np.testing.assert_allclose(found["nominal_stress"], np.arange(3) * factor / 4.2)
    np.testing.assert_allclose(found["u_nominal_stress"], 0.02 * factor / 4.2)
    np.testing.assert_allclose(found["u_stretch"], 1e-4)
    assert found.common[1] == pytest.approx(0.25e-3 / 1.25)
    assert found.steps == ("a", "b", "c")


def test_an_area_gives_poissons_and_henckys_ratio():
    stage = Stress(width=20, thickness=0.21, u_thickness=0.005, probe="middle", mode="biaxial")
    found = StressCurve.read(stage.run(channels=made_channels(), probes=made_probes()))
    np.testing.assert_allclose(found["poisson_ratio"][1:], 0.4)
    np.testing.assert_allclose(found["hencky_ratio"][1:], -np.log([0.96, 0.9]) / np.log([1.1, 1.25]))
    assert np.isnan(found["poisson_ratio"][0])
    np.testing.assert_allclose(found.points("loading", 0, 9).lateral, [0.96, 0.9])


def test_a_step_without_points_is_left_out_with_a_warning():
    stage = Stress(width=20, thickness=0.21, u_thickness=0.005, probe="gauge")
    product = stage.run(channels=made_channels(), probes=made_probes((0.0, np.nan, 0.25)))
    assert product.warnings[0].startswith("1 step has no load or no stretch")
    assert StressCurve.read(product).points(None, 0, 9).stretch.tolist() == [1.25]
    with pytest.raises(StageError, match="1 of 3 steps have both a load and a stretch"):
        stage.run(channels=made_channels(), probes=made_probes((0.0, np.nan, np.nan)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: made_channels(load=None), "no channel is the load"),
        (lambda: made_channels(unit="V"), "has the unit 'V'; expected one of N, kN, mN, g, kg"),
    ],
)
def test_a_channel_that_is_no_load_is_refused(make, message):
    stage = Stress(width=20, thickness=0.21, u_thickness=0.005, probe="gauge")
    with pytest.raises(StageError, match=message):
        stage.run(channels=make(), probes=made_probes())


def test_other_numbers_of_loads_and_stretches_are_refused(tmp_path):
    stage = Stress(width=20, thickness=0.21, u_thickness=0.005, caliper="a.csv")
    with pytest.raises(StageError, match="3 loads for 2 stretches"):
        stage.run(caliper_path=caliper(tmp_path, [0, 1], [60, 61]), channels=made_channels())


@pytest.mark.parametrize(
    ("joined", "given", "named"),
    [
        ({}, {"width": 20}, ["channels", "probe"]),
        ({"channels": None}, {"width": 20}, ["probe"]),
        ({"channels": None}, {"width": 20, "probe": "gauge"}, ["probe"]),
        ({"channels": None}, {}, ["width", "probe"]),
        ({"channels": None, "sheet": None, "probes": None}, {"probe": "gauge"}, []),
        ({}, {"width": 20, "caliper": "a.csv"}, []),
    ],
)
def test_what_a_stress_needs_is_named_before_it_runs(joined, given, named):
    found = Stress(thickness=0.21, u_thickness=0.005, **given).problems(joined)
    assert [parameter for parameter, _ in found] == named


PIPELINE = """\
stages:
  strip: {stage: stress, caliper: a.csv, width: 20 mm%s}
  material: {stage: hyperelastic}
"""


def test_a_missing_thickness_is_named_with_its_place(tmp_path):
    caliper(tmp_path, [0, 100, 200], [60, 66, 75])
    path = written(tmp_path, PIPELINE % "", "p.yaml")
    with pytest.raises(DicflowError, match=r"p\.yaml:2.*strip.*thickness"):
        Pipeline.load(path).run(scheduler="sync")


def test_a_width_that_nobody_gives_is_asked_for_at_its_place(tmp_path):
    caliper(tmp_path, [0, 100, 200], [60, 66, 75])
    text = PIPELINE.replace("width: 20 mm", "thickness: 0.21 mm") % ", u_thickness: 5 um"
    with pytest.raises(ConfigurationError, match=r"p\.yaml:2:3: strip.width: is missing; give it, or a stage sheet"):
        Pipeline.load(written(tmp_path, text, "p.yaml")).plan()


def test_the_width_of_the_photographs():
    """That of a sheet with its uncertainty, unless the file gives it; then no sheet is joined."""
    facts = SheetFacts(20.4, 60.0, 0.21, 0.05, 0.005, 1.0, 0.0, 0.0)
    sheet = SheetFields.write({"areas": np.ones(1)}, ["b"], facts, ())
    stage = Stress(thickness=0.21, u_thickness=0.005, probe="gauge")
    found = StressCurve.read(stage.run(channels=made_channels(), probes=made_probes(), sheet=sheet))
    np.testing.assert_allclose(found["nominal_stress"], np.arange(3) / (20.4 * 0.21))
    assert found.common[0] == pytest.approx(np.hypot(0.05 / 20.4, 0.005 / 0.21))
    assert [stage.joins("sheet"), Stress(**STRIP).joins("sheet")] == [True, False]


@pytest.mark.parametrize(
    ("loads", "message"),
    [
        ([300, 200, 100, 0], "the first step has the largest load, 2.942 N"),
        ([0, -100, -200, -300], r"a\.csv:3: load_g is '-100', expected a number from 0"),
        ([0, "nan", 200, 300], r"a\.csv:3: load_g is 'nan', expected a number"),
        ([0, 0, 0, 0], "the load is the same at all 4 steps"),
    ],
)
def test_weights_that_no_test_has_are_refused(tmp_path, loads, message):
    lengths = [60, 66, 75, 80] if loads[0] == 0 else [80, 75, 66, 60]
    with pytest.raises((StageError, InputError), match=message):
        Stress(**STRIP).run(caliper_path=caliper(tmp_path, loads, lengths))


def test_a_load_of_the_other_sign_is_refused():
    with pytest.raises(StageError, match="the load runs against the stretch"):
        Stress(width=20, thickness=0.21, u_thickness=0.005, probe="gauge").run(
            channels=Channels.write({"force": Channel(-np.arange(3.0), "N", "force")}, ["a", "b", "c"], load="force"),
            probes=made_probes(),
        )


@pytest.mark.parametrize(
    ("loads", "lengths", "message"),
    [
        ([50, 100, 200, 300], [62, 66, 75, 80], "the first step is under a load of 0.4903 N"),
        ([0, 200, 100, 300], [60, 75, 66, 80], "the load falls, and rises again to step 4"),
        ([0, 100, 200, 100, 50], [60, 66, 75, 80, 90], "the specimen went on growing after the largest load"),
        ([0, 100, 200, 300], [60, 66, 75, 1200], "the largest stretch is 20, more than rubber bears"),
    ],
)
def test_weights_that_are_unlikely_are_said(tmp_path, loads, lengths, message):
    product = Stress(**STRIP).run(caliper_path=caliper(tmp_path, loads, lengths))
    assert any(message in text for text in product.warnings)


def test_repeated_steps_and_a_held_load_belong_to_loading(tmp_path):
    path = caliper(tmp_path, [0, 100, 100, 200, 300, 300, 150, 0], [60, 66, 66, 72, 80, 81, 70, 61])
    found = StressCurve.read(Stress(**STRIP).run(caliper_path=path))
    assert found.phases == ("loading",) * 6 + ("unloading",) * 2
    assert np.isfinite(list(found.summary.values())).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"thickness": 0}, "greater than 0"),
        ({"u_thickness": 5}, "u_thickness is 5 mm for a thickness of 0.21 mm; write the unit"),
        ({"u_width": "20 mm"}, "u_width is 20 mm for a width of 20 mm"),
    ],
)
def test_sections_that_no_specimen_has_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Stress(**{**STRIP, **given})


def test_a_test_in_compression_is_loaded_to_its_largest_pressure(tmp_path):
    found = curve(tmp_path, "stretch,nominal_stress_MPa\n1,0\n0.9,-0.1\n0.8,-0.3\n0.9,-0.05\n0.99,0\n")
    assert found.phases == ("loading",) * 3 + ("unloading",) * 2
    assert found.summary["set"] == pytest.approx(-0.01)
    assert found.summary["loop_work_mJ_mm3"] > 0
    assert found.summary["largest_stress_MPa"] == -0.3


# hyperelastic


def product_of(tmp_path, name, mode, c, stretch, **given):
    stress = stress_in_mode(MODELS[name], np.array(c), mode, stretch)
    rows = [f"{x:.10f},{y:.10f}" for x, y in zip(stretch, stress, strict=True)]
    path = written(tmp_path, "\n".join(["stretch,nominal_stress_MPa", *rows]), f"{mode}.csv")
    return Curve(file=path.name, mode=mode, **given).run(path)


@pytest.mark.slow
def test_constants_of_three_exact_curves(tmp_path):
    stretch = np.linspace(1.05, 2.2, 12)
    curves = [
        product_of(tmp_path, "mooney_rivlin", mode, [0.15, 0.05], stretch, u_stress=0.01)
        for mode in ("uniaxial", "planar", "equibiaxial")
    ]
    found = Material.read(Hyperelastic().run(curves))
    best = found.models[0]
    assert best.name == "mooney_rivlin"
    np.testing.assert_allclose(best.values, [0.15, 0.05], rtol=1e-4)
    assert best.shear_modulus[0] == pytest.approx(0.4, rel=1e-4)
    assert best.young_modulus[0] == pytest.approx(1.2, rel=1e-4)
    assert max(best.left_out) < 1e-3
    assert {model.name for model in found.models} == set(MODELS)
    neo = next(model for model in found.models if model.name == "neo_hooke")
    assert neo.left_out[2] > 0.15
    np.testing.assert_allclose(found["stress_mooney_rivlin"], found["nominal_stress"], rtol=1e-4)
    assert found.of_curve("stretch", 1).tolist() == pytest.approx(stretch.tolist())


def test_one_mode_cannot_tell_what_three_can(tmp_path):
    stretch = np.linspace(1.05, 1.7, 10)
    curves = [
        product_of(tmp_path, "mooney_rivlin", mode, [0.15, 0.05], stretch, u_stress=0.02)
        for mode in ("uniaxial", "planar", "equibiaxial")
    ]
    stage = Hyperelastic(models=("neo_hooke", "mooney_rivlin"))
    alone, joint = (Material.read(stage.run(given)) for given in (curves[:1], curves))
    text = " ".join(alone.verdict)
    assert "these tests cannot tell C01 from C10" in text
    assert "no prediction of another mode could be checked" in text
    assert "add a wide specimen" in text
    assert alone.product.warnings
    assert "cannot tell" not in " ".join(joint.verdict)
    assert "Left out, 3 (equibiaxial) is predicted within" in " ".join(joint.verdict)


@pytest.mark.parametrize(("name", "c"), [("yeoh", [0.2, -0.01, 0.0015]), ("ogden_2", [0.55, 1.4, 0.004, 5.5])])
def test_uniaxial_points_leave_the_model_open_that_three_modes_show(tmp_path, name, c):
    """Points uncertain by 2 %; another model fits one mode as well, and predicts others otherwise."""
    stretch = np.linspace(1.05, 1.7, 8)
    curves = [
        product_of(tmp_path, name, mode, c, stretch, u_stress=0.02) for mode in ("uniaxial", "planar", "equibiaxial")
    ]
    stage = Hyperelastic(models=("mooney_rivlin", name))
    alone, joint = (Material.read(stage.run(given)) for given in (curves[:1], curves))
    assert any("these tests cannot tell which holds there; add " in text for text in alone.verdict)
    assert not any("cannot tell which holds" in text for text in joint.verdict)
    assert joint.models[0].name == name


def of_variance(variance, freedom, known):
    """A fitted model with one constant and a variance per degree of freedom."""
    curve = np.linspace(1.1, 2.0, 5)
    stretches = principal_stretches("uniaxial", curve)
    stress = stress_in_mode(MODELS["neo_hooke"], np.array([0.2]), "uniaxial", curve)
    model = fitted_model("neo_hooke", MODELS["neo_hooke"], [FitCurve("1", "uniaxial", stretches, stress)])
    rms = np.sqrt(variance * freedom / (freedom + 1))
    return model._replace(freedom=freedom, rms_all=rms, misfit_ratio=variance if known else None)


@pytest.mark.parametrize(
    ("known", "least", "kept", "excluded"),
    [
        pytest.param(True, 0.5, 1.82, 1.84, id="chi squared of 10 degrees is below 18.31 in 95 % of all cases"),
        pytest.param(True, 3.0, 8.92, 8.95, id="F of 10 and 10 degrees is below 2.978 in 95 % of all cases"),
        pytest.param(False, 1e-4, 2.97e-4, 2.99e-4, id="without u the least variance is the measure"),
    ],
)
def test_models_are_excluded_by_their_residuals(known, least, kept, excluded):
    models = [of_variance(variance, 10, known) for variance in (least, kept, excluded)]
    assert not_excluded(models) == models[:2]


def test_an_unstable_fit_is_named_and_not_the_first(tmp_path):
    stretch = np.linspace(1.05, 2.2, 12)
    curve = product_of(tmp_path, "mooney_rivlin", "uniaxial", [0.3, -0.08], stretch, u_stress=0.005)
    found = Material.read(Hyperelastic(models=("mooney_rivlin", "neo_hooke")).run([curve]))
    assert [model.name for model in found.models] == ["neo_hooke", "mooney_rivlin"]
    assert found.models[1].unstable
    assert any("Mooney–Rivlin with these constants is unstable in" in text for text in found.product.warnings)


def test_models_with_more_constants_than_points_are_left_out_by_name(tmp_path):
    curve = product_of(tmp_path, "neo_hooke", "uniaxial", [0.2], np.array([1.2, 1.4, 1.6, 1.8]))
    found = Material.read(Hyperelastic(models=("neo_hooke", "ogden_2")).run([curve]))
    assert found.refused == {"ogden_2": "4 points for 4 constants; more points than constants are needed"}
    assert any(text.startswith("ogden_2 was not fitted: 4 points") for text in found.product.warnings)
    with pytest.raises(StageError, match="no model can be fitted, ogden_2: 4 points for 4 constants"):
        Hyperelastic(models=("ogden_2",)).run([curve])
    with pytest.raises(StageError, match="no model can be fitted, not even ogden_2: 4 points for 4 constants"):
        Hyperelastic(models=("ogden_3", "ogden_2")).run([curve])


def test_a_range_without_points_is_refused(tmp_path):
    curve = product_of(tmp_path, "neo_hooke", "uniaxial", [0.2], np.array([1.2, 1.4]))
    with pytest.raises(StageError, match="1 has no point of phase loading with a stretch from 3 to 4"):
        Hyperelastic(stretch=(3, 4)).run([curve])
    with pytest.raises(ValueError, match="write the least stretch"):
        Hyperelastic(stretch=(4, 3))


@pytest.mark.slow
def test_the_made_rubber(tmp_path):
    """All constants are within three of their standard deviations; curves are joined from several stages."""
    for mode in ("uniaxial", "planar", "equibiaxial"):
        written(tmp_path, rubber_table(mode), f"{mode}.csv")
    text = """\
stages:
  uniaxial: {stage: curve, file: uniaxial.csv, mode: uniaxial, u_stress: 0.01}
  planar: {stage: curve, file: planar.csv, mode: planar, u_stress: 0.01}
  equibiaxial: {stage: curve, file: equibiaxial.csv, mode: equibiaxial, u_stress: 0.01}
  all: {stage: hyperelastic, models: [ogden_2]}
  two: {stage: hyperelastic, curves: [planar, uniaxial], models: [ogden_2]}
  one: {stage: hyperelastic, curves: planar, models: [ogden_1]}
"""
    result = Pipeline.load(written(tmp_path, text, "p.yaml")).run(scheduler="sync")
    assert result.outcome.ok, result.outcome.errors
    found = {name: Material.read(result.product(name)) for name in ("all", "two", "one")}
    assert [[curve.name for curve in one.curves] for one in found.values()] == [
        ["uniaxial", "planar", "equibiaxial"],
        ["planar", "uniaxial"],
        ["planar"],
    ]
    (model,) = found["all"].models
    truth = sorted(CONSTANTS.values())
    constants = sorted(model.constants, key=lambda one: one.value)
    for constant, value in zip(constants, truth, strict=True):
        assert abs(constant.value - value) <= 1.5 * constant.half_width
    assert model.rms_all == pytest.approx(0.01, rel=0.3)
    assert model.scatter == 0.0


@pytest.mark.parametrize(
    ("curves", "message"),
    [
        ("[uniaxial, missing]", "no stage 'missing'"),
        ("[uniaxial, fit]", "takes its own product"),
        ("3", "expected the name of one stage"),
    ],
)
def test_curves_that_do_not_exist_are_named(tmp_path, curves, message):
    one = "  uniaxial: {stage: curve, file: a.csv, mode: uniaxial}\n"
    text = f"stages:\n{one}  fit: {{stage: hyperelastic, curves: {curves}}}\n"
    with pytest.raises(ConfigurationError, match=message):
        Pipeline.load(written(tmp_path, text, "p.yaml")).plan()


def test_a_fit_without_any_curve_says_so(tmp_path):
    path = written(tmp_path, "stages:\n  fit: {stage: hyperelastic}\n", "p.yaml")
    with pytest.raises(ConfigurationError, match=r"fit\.curves: needs curve; add a stage that gives curve"):
        Pipeline.load(path).plan()
