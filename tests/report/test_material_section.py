import pytest

from dicflow.pipeline import Pipeline
from dicflow.report.material import material
from dicflow.synth.rubber import write_rubber
from tests.pages import context_of

TEXT = """\
stages:
  uniaxial: {stage: curve, file: uniaxial.csv, mode: uniaxial, u_stress: 0.01, u_stretch: 0.002, common_stress: 0.02}
  planar: {stage: curve, file: planar.csv, mode: planar, u_stress: 0.01}
  fit: {stage: hyperelastic, models: [neo_hooke, yeoh]}
"""


@pytest.fixture(scope="module")
def section(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rubber")
    write_rubber(folder)
    (folder / "p.yaml").write_text(TEXT)
    loaded = Pipeline.load(folder / "p.yaml")
    assert loaded.run(scheduler="sync").outcome.ok
    return material(context_of(loaded, folder / "report"))


def test_curves_have_bars_on_both_axes(section):
    """14 points with two bars each, of a curve with both uncertainties; one bar each without that of the stretch."""
    _, first, second = section.body.split("nominal stress over stretch, with intervals of 95 %")
    assert [part.partition("</svg>")[0].count("M") for part in (first, second)] >= [28, 14]
    assert "largest nominal stress [MPa]" in section.body


def test_the_verdict_the_models_and_the_predictions(section):
    for part in ("Left out, planar (planar) is predicted", "neo-Hooke", "C10 = ", "AICc", "left out", "Correlation of"):
        assert part in section.body
    assert section.covers == ("fit",)
    assert all(text.startswith("fit: ") and text.endswith(".") for text in section.warnings)


def test_a_pipeline_without_curves_has_no_such_section(tmp_path):
    (tmp_path / "p.yaml").write_text("stages: {a: {stage: curve, file: a.csv, mode: uniaxial}}\n")
    (tmp_path / "a.csv").write_text("stretch,nominal_stress_MPa\n1.1,0.1\n1.2,0.2\n")
    assert material(context_of(Pipeline.load(tmp_path / "p.yaml"), tmp_path / "report")) is None
