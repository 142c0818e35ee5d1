import pytest

from dicflow.engine.product import Product
from dicflow.pipeline import Pipeline
from dicflow.report import quality as module
from dicflow.report.context import Context
from dicflow.report.pieces import Pieces
from dicflow.report.quality import quality
from tests.pages import context_of

GOOD = {"size_px": 4.0, "gradient": 20.0, "contrast": 0.4, "saturated": 0.0}


@pytest.fixture(scope="module")
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


@pytest.fixture(scope="module")
def section(loaded, tmp_path_factory):
    return quality(context_of(loaded, tmp_path_factory.mktemp("report")))


def test_the_thesis_form_says_that_it_predicts_no_deviation(section):
    assert "predicts no standard deviations" in section.body
    assert "residual [px]" in section.body
    assert "RMSE [mm]" in section.body


def test_figures_of_the_steps_are_those_of_the_products(loaded, tmp_path):
    result = loaded.result()
    steps = result.steps("track")
    panels = module._panels(context_of(loaded, tmp_path), steps)
    residuals = [result.product("track", step).attrs["summary"].get("residual_px") for step in steps]
    assert residuals[0] is None
    assert panels[module._RESIDUAL] == {"residual": residuals}
    assert module._heading(module._RESIDUAL, "residual") == "Residual of the features that were followed: residual [px]"
    assert module._heading(module._STRAIN, "eyy") == f"{module._STRAIN.title}: eyy, u [–]"
    assert set(panels[module._SURFACE]) == {"X", "Y", "Z"}
    assert module._rows(steps, panels)[0][:2] == [steps[0], "–"]


def test_a_good_pattern_needs_no_advice():
    assert all(good for good, _ in module.advice_on(GOOD, 21))


@pytest.mark.parametrize(
    ("change", "subset", "words"),
    [
        ({"size_px": 2.0}, None, "paint coarser ones"),
        ({"size_px": 9.0}, None, "paint finer ones"),
        ({}, 9, "take at least 12 px"),
        ({"gradient": 2.0}, None, "light the specimen better"),
        ({"contrast": 0.05}, None, "blacker and whiter"),
        ({"saturated": 0.2}, None, "20.0 % of the region is overexposed"),
        ({"size_px": None}, None, "no pattern"),
    ],
)
def test_what_is_not_good_comes_with_a_remedy(change, subset, words):
    bad = [sentence for good, sentence in module.advice_on(GOOD | change, subset) if not good]
    assert len(bad) == 1
    assert words in bad[0]


def test_nothing_followed_has_no_numbers(pipeline, tmp_path):
    empty = Pipeline.load(pipeline, store=tmp_path / "store")
    found = quality(context_of(empty, tmp_path))
    assert "Step by step" not in found.body
    assert found.warnings == ()


def test_the_noise_floor_is_a_table():
    class Floor:
        def stages_of(self, kind):
            return ["floor"] if kind == "noise" else []

        def has(self, stage):
            return True

        def product(self, stage):
            row = {"step": "s", "quantity": "exx", "unit": "1", "bias": 1e-5, "sigma": 2e-4, "predicted_sigma": None}
            return Product("noise", {}, {"rows": [row | {"points": 12}]})

    assert module._noise_floor(Floor()) == [["s", "εxx [–]", "1.0·10⁻⁵", "2.0·10⁻⁴", "–", "12"]]


def test_the_noise_is_that_of_the_last_step_at_hand():
    """By which its standard deviations were judged, as the reporting table says too."""

    class Followed:
        def steps(self, stage):
            return ("a", "b", "c")

        def has(self, stage, step):
            return step != "c"

        def product(self, stage, step):
            source = {"a": (1.38, "first photograph"), "b": (0.79, "static pair")}[step]
            facts = {"noise_grey": source[0], "noise_source": source[1], "noise_settled": True}
            return Product("correlation", {}, facts)

    text = module._noise_of_photographs(Followed(), "correlation")
    assert text == "Noise of the photographs: 0.79 grey levels, from static pair."


def test_steps_that_are_overexposed_come_with_a_warning(tmp_path):
    class Followed:
        def stages_of(self, kind):
            return {"correlation": ["left"], "stereo": ["right"]}[kind]

        def steps(self, stage):
            return ("a", "b", "c", "d")

        def has(self, stage, step):
            return step != "d"

        def digest(self, stage, step):
            return f"{stage} {step}"

        def product(self, stage, step):
            share = {"left": {"a": 0.0, "b": 0.005, "c": None}, "right": {"a": 0.2, "b": 0.02, "c": 0.313}}[stage][step]
            return Product(stage, {}, {"summary": {"overexposed_share": share}})

    context = Context(None, Followed(), None, Pieces(tmp_path, "code"), tmp_path)
    assert list(module._overexposed(context)) == [
        "The right photographs of 2 of 4 steps are overexposed in more than 1.0 % of the region, c in 31.3 %: "
        "expose for a shorter time."
    ]
