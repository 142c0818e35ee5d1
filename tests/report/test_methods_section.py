"""The methods paragraph: sentences of the stages that the pipeline has, figures of settings, references by number."""

import re
import sys

import pytest
from small import ROOT, STEPS, dicflow

from dicflow.engine.product import Product
from dicflow.pipeline import Pipeline
from dicflow.pipeline.registry import node_classes
from dicflow.report.methods import methods
from dicflow.report.paragraph import Paragraph, methods_paragraph
from dicflow.report.rendering import assets, render
from dicflow.stages._references import REFERENCES
from tests.browser import chromium, opened
from tests.pages import Page, context_of

SILENT = {"images", "region", "probes", "compare", "maps"}
REQUIRED = {
    "calibrate": {"square": 1.0},
    "channels": {"file": "log.csv"},
    "corners": {"size": (9, 6)},
    "rig_file": {"file": "rig.json"},
    "scale": {"square": 1.0},
    "curve": {"file": "a.csv", "mode": "uniaxial"},
    "stress": {"width": 20.0, "thickness": 0.2, "u_thickness": 0.005},
    "sheet": {"thickness": 0.2, "u_thickness": 0.005},
}


def sentence_of(kind, **parameters):
    return sys.modules[kind.__module__].sentence(kind(**parameters), None)


def own_stages():
    return {name: kind for name, kind in node_classes()[0].items() if kind.__module__.startswith("dicflow.stages.")}


def test_every_stage_that_measures_has_a_sentence_whose_references_are_known():
    spoken = {name: kind for name, kind in own_stages().items() if hasattr(sys.modules[kind.__module__], "sentence")}
    assert own_stages().keys() - spoken.keys() == SILENT
    cited = set()
    for name, kind in spoken.items():
        text = sentence_of(kind, **REQUIRED.get(name, {}))
        assert text.endswith("."), name
        keys = {key for found in re.findall(r"\[([^\]]*)\]", text) for key in found.split(", ")}
        assert keys <= REFERENCES.keys(), name
        cited |= keys
    assert len(cited) > 15


@pytest.mark.parametrize(
    ("stage", "parameters", "words"),
    [
        ("correlate", {"subset_size": 33, "step_size": 9}, ("33 × 33 px", "step size of 9 px", "affine")),
        ("correlate", {"interpolation": "bicubic", "gaussian": 4}, ("cubic B-splines", "Gaussian of σ 4 px")),
        ("correlate", {"max_znssd": 0.15}, ("ZNSSD above 0.15",)),
        ("stereo", {"match": "first_step", "max_epipolar": 0.7}, ("at the first step", "0.7 px")),
        (
            "deformation",
            {"window": 65, "degree": 3, "measure": "hencky"},
            ("65 × 65", "degree 3", "Hencky", "hill1968"),
        ),
        ("deformation", {"rigid": True}, ("removed from the displacement [kabsch1976]",)),
        ("calibrate", {"square": "2 cm", "radial": 3, "loss": "huber"}, ("20 mm", "three", "Huber's loss [huber1981]")),
        ("corners", {"size": (9, 6), "target": "circles"}, ("9 × 6 circles",)),
        ("features", {"detector": "ORB"}, ("ORB features [orb2011]",)),
        ("surface", {"degree": "auto"}, ("Bayesian information criterion",)),
        ("surface", {"method": "lowess", "robust": "none"}, ("local regression of degree 1 in windows of 61 px",)),
    ],
)
def test_a_sentence_gives_the_settings(stage, parameters, words):
    text = sentence_of(own_stages()[stage], **parameters)
    assert [word for word in words if word not in text] == []


def test_quantities_have_their_symbols():
    summary = {"sigma_exx": 2.1e-4, "sigma_V_px": 0.012, "u_exx": 3.2e-4, "u_V_px": 0.034}
    facts = {"unit": "px", "summary": summary, "steps": ["rest"]}
    floor = sys.modules[own_stages()["noise_floor"].__module__]
    text = floor.sentence(floor.NoiseFloor(), Product("noise", {}, facts))
    assert "0.012 px for V, 0.00021 for εxx [idics2018]" in text
    total = sys.modules[own_stages()["deformation"].__module__]
    text = total.sentence(total.Deformation(), Product("total", {}, facts))
    assert "0.034 px for V, 0.00032 for εxx at the last step" in text


def test_references_have_authors_a_title_a_place_and_a_year():
    for key, text in REFERENCES.items():
        year = key[-4:]
        assert f"({year})" in text, key
        assert len(text.split(", ")) >= 3, key
        assert text.split()[0].endswith("."), key


def test_the_paragraph_of_a_measured_test_has_its_stages_and_figures(pipeline, measured):
    loaded = Pipeline.load(pipeline)
    paragraph = methods_paragraph(loaded, result := loaded.result())
    assert f"at {STEPS} steps by stereo digital image correlation" in paragraph.text
    assert "semi-global matching" in paragraph.text
    assert "ZNSSD" not in paragraph.text
    rms = result.product("rig").attrs["summary"]["rms_px"]
    assert f"reprojection error was {rms:.2g} px" in paragraph.text
    numbers = [int(number) for found in re.findall(r"\[([\d, ]+)\]", paragraph.text) for number in found.split(", ")]
    assert list(dict.fromkeys(numbers)) == list(range(1, len(paragraph.references) + 1))


def test_the_command_prints_what_the_section_shows(pipeline, measured, tmp_path):
    loaded = Pipeline.load(pipeline)
    printed = dicflow("report", pipeline, "--methods").out.strip()
    paragraph = methods_paragraph(loaded, loaded.result())
    assert printed == str(paragraph)
    page = Page(f"<main>{methods(context_of(loaded, tmp_path)).body}</main>")
    assert paragraph.text in page.texts
    assert [f"{reference}." for reference in paragraph.references] == page.texts[-len(paragraph.references) :]


def test_a_paragraph_needs_no_products(pipeline, tmp_path):
    path = tmp_path / "precise.yaml"
    path.write_text((ROOT / "pipelines" / "quickstart.yaml").read_text())
    loaded = Pipeline.load(path, data=pipeline.parent, settings=["correlation.subset_size=33"])
    text = methods_paragraph(loaded, loaded.result()).text
    assert "33 × 33 px" in text
    assert "reprojection error was" not in text


@pytest.mark.skipif(chromium() is None, reason="needs chromium on the PATH")
@pytest.mark.parametrize("clipboard", ["navigator.clipboard", "undefined"])
def test_the_button_copies_paragraph_and_references(tmp_path, clipboard):
    paragraph = Paragraph("Measured [1, 2].", ("A. B, C (2000)", "D. E, F (2001)"))
    body = render("methods.html", paragraph=paragraph)
    path = tmp_path / "page.html"
    path.write_text(
        f"<meta charset=utf-8><style>{assets('.css')}</style><nav></nav>{body}<script>{assets('.js')}</script>"
    )
    (tmp_path / "browser").mkdir()
    with opened(tmp_path / "browser") as page:
        page.send("Emulation.setFocusEmulationEnabled", enabled=True)
        page.send("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
        page.open(path)
        page.evaluate("window.kept = navigator.clipboard, undefined")
        page.evaluate(f"Object.defineProperty(navigator, 'clipboard', {{ value: {clipboard} }}), undefined")
        press = "document.querySelector('.copy').click(), new Promise((done) => setTimeout(done, 300))"
        page.send("Runtime.evaluate", expression=press, userGesture=True, awaitPromise=True)
        assert page.evaluate("document.querySelector('.copied').textContent") == "copied"
        text = page.evaluate("window.kept.readText()")
    assert text == "Measured [1, 2].\n[1] A. B, C (2000).\n[2] D. E, F (2001)."
