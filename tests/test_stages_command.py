"""``dicflow stages``: the list of all stages, and all about one of them."""

import pytest
from small import dicflow

from dicflow.pipeline.registry import node_class, stage_names


def test_every_stage_is_listed_with_what_it_takes_and_gives():
    answer = dicflow("stages")
    assert answer.code == 0
    lines = answer.out.splitlines()
    assert [line.split()[0] for line in lines if not line.startswith(" ")] == list(stage_names())
    place = next(number for number, line in enumerate(lines) if line.startswith("rectify "))
    assert lines[place].split(maxsplit=1)[1] == "rectify, once per step"
    assert lines[place + 1].split() == ["images,", "rig", "→", "rectified"]


@pytest.mark.parametrize(
    ("name", "nearest"),
    [("correlation", "correlate"), ("Noise-Floor", "noise_floor"), ("STRAIN", "strain"), ("calibration", "calibrate")],
)
def test_an_unknown_name_leads_to_the_nearest_stage(name, nearest):
    answer = dicflow("stages", name)
    answer.refuses(2, f"no stage '{name}', did you mean '{nearest}'?; 'dicflow stages' says what each does")
    assert "plug-ins" not in answer.err
    dicflow("stages", "xyz").refuses(2, "no stage 'xyz'; stages: accumulate, calibrate, ")


@pytest.mark.parametrize("name", ["", *stage_names()])
def test_a_line_fits_a_terminal_of_80_columns(name):
    lines = dicflow("stages", *filter(None, [name])).out.splitlines()
    assert max(map(len, lines)) < 80


@pytest.mark.parametrize("name", stage_names())
def test_every_parameter_and_input_of_a_stage_is_there(name):
    words = dicflow("stages", name).out
    kind = node_class(name)
    for parameter, field in kind.model_fields.items():
        if parameter != "stage":
            assert f"\n  {parameter}: " in words
            assert " ".join(str(field.description).split()) in " ".join(words.split())
    assert all(f"\n  {port}: " in words for port in kind.takes)
    assert f"\ngives {kind.gives}\n" in words


@pytest.mark.parametrize(
    ("name", "parameter", "lines"),
    [
        ("correlate", "subset_size", ["31 px", "whole number, at least 5"]),
        ("correlate", "noise", ["auto, in grey levels", "auto or number, above 0"]),
        ("calibrate", "square", ["required, in mm", "number, above 0"]),
        ("smooth", "window", ["[80.0, 20.0] px", "list of 2: number, above 0"]),
        ("region", "file", ["null", "null or file"]),
        ("match", "mutual", ["true", "true or false"]),
        ("probes", "points", ["{}", "mapping of names to: list of 2: number"]),
        ("features", "detector", ["KAZE", "KAZE | AKAZE | BRISK | ORB | SIFT"]),
    ],
)
def test_default_unit_and_limits(name, parameter, lines):
    said = dicflow("stages", name).out.splitlines()
    place = said.index(f"  {parameter}: {lines[0]}")
    assert said[place + 1].strip() == lines[1]


def test_an_unknown_stage():
    dicflow("stages", "correlat").refuses(2, "no stage 'correlat', did you mean 'correlate'?")


def test_a_parameter_that_follows_another_stage_says_so():
    shown = dicflow("stages", "stereo").out
    assert "  gaussian: as in correlation\n" in shown
    assert "  max_znssd: 0.3\n" in shown
