"""The section ``report``: checked like the rest of the file, and without influence on what is computed."""

import pytest

from dicflow.errors import ConfigurationError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.schema import pipeline_schema

STAGES = 'stages:\n  boards: {stage: images, left: "left/*.png", right: "right/*.png"}\n'


def load(folder, report):
    path = folder / "pipeline.yaml"
    path.write_text(f"{report}{STAGES}")
    return Pipeline.load(path)


def test_stated_facts_are_read_as_text(tmp_path):
    facts = load(tmp_path, 'report:\n  specimen: " strip, 20 mm wide "\n  aperture: "8"\n').facts
    assert facts.specimen == "strip, 20 mm wide"
    assert facts.aperture == "8"
    assert facts.camera is None


def test_a_file_without_the_section_states_nothing(tmp_path):
    assert not any(load(tmp_path, "").facts.model_dump().values())


@pytest.mark.parametrize(
    ("report", "words"),
    [
        ("report:\n  speciman: strip\n", (":2:3", "report.speciman", "did you mean 'specimen'?", "material")),
        ("report:\n  lens: 50\n", (":2:3", "report.lens", "text", "50", "focal length")),
        ("report:\n  lens: ' '\n", (":2:3", "report.lens", "at least 1 character")),
        ("report: a strip\n", (":1:1", "must map names to texts", "specimen")),
        ("report:\n  logo: ../logo.png\n", (":2:3", "report.logo", "below the pipeline file's folder")),
        ("report:\n  logo: /etc/logo.png\n", (":2:3", "below the pipeline file's folder")),
        ("report:\n  logo: 'C:\\logo.png'\n", (":2:3", "below the pipeline file's folder")),
        ("reprot:\n  lens: a\n", (":1:1", "reprot", "did you mean 'report'?")),
    ],
)
def test_what_does_not_fit_is_named_with_its_place(tmp_path, report, words):
    with pytest.raises(ConfigurationError) as found:
        load(tmp_path, report)
    assert [word for word in words if word not in str(found.value)] == []


def test_stated_facts_are_no_setting_of_a_stage(tmp_path):
    assert load(tmp_path, "").resolved() == load(tmp_path, "report: {operator: A. Noether}\n").resolved()


def test_the_schema_of_editors_has_the_section():
    section = pipeline_schema()["properties"]["report"]
    assert {"specimen", "camera", "logo"} <= set(section["properties"])
    assert section["additionalProperties"] is False
