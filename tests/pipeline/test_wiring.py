"""Pipeline files: all problems are listed at once, each with its place."""

import pytest

from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse
from dicflow.pipeline.wiring import wire

GOOD = """\
dicflow: 1
stages:
  photos:  {stage: images, left: l/*.png, right: r/*.png}
  boards:  {stage: images, left: bl/*.png, right: br/*.png}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig:     {stage: calibrate, square: 14.5 mm}
  pair:    {stage: rectify, images: photos}
"""


def _wire(text):
    return wire(parse(text, "p.yaml"))


def test_an_input_that_can_be_only_one_need_not_be_named():
    wired = _wire(GOOD)
    assert wired["rig"].inputs == {"corners": "corners"}
    assert wired["pair"].inputs == {"images": "photos", "rig": "rig"}


def test_inputs_of_other_steps_are_what_the_input_of_this_step_is():
    text = GOOD + "  region:  {stage: region, images: photos}\n  points:  {stage: correlate, images: photos}\n"
    inputs = _wire(text)["points"].inputs
    assert inputs["images_first"] == inputs["images_before"] == inputs["images"] == "photos"


FOLLOWED = """\
  region:   {stage: region, images: pair}
  features: {stage: features, images: pair}
  matches:  {stage: match, images: pair}
  track:    {stage: track}
"""


def test_a_port_of_another_one_is_joined_to_what_that_ones_stage_takes():
    seen = {"images": "pair", "images_before": "pair", "features": "features", "features_before": "features"}
    wired = _wire(GOOD + FOLLOWED)
    assert wired["track"].inputs == {**seen, "matches": "matches", "region": "region", "track_before": "track"}
    other = _wire(GOOD + FOLLOWED.replace("stage: track", "stage: track, images: photos"))
    assert other["track"].inputs == wired["track"].inputs | {"images": "photos", "images_before": "photos"}
    alone = _wire(GOOD + FOLLOWED.replace("stage: track", "stage: track, matches: null"))
    assert alone["track"].inputs == {"region": "region", "track_before": "track"}


def test_a_stage_that_gives_what_it_takes_stands_for_it():
    """A refined rig is that of stages that name none; of two that refine one rig, or two chains, one must be named."""
    refined = GOOD + "  refined: {stage: refine, images: photos}\n"
    wired = _wire(refined)
    assert wired["refined"].inputs == {"rig": "rig", "images": "photos", "images_early": "photos"}
    assert wired["pair"].inputs == {"images": "photos", "rig": "refined"}
    assert _wire(refined.replace("rectify, images", "rectify, rig: rig, images"))["pair"].inputs["rig"] == "rig"
    again = refined.replace("refine,", "refine, rig: rig,") + "  twice: {stage: refine, rig: refined, images: photos}\n"
    assert _wire(again)["pair"].inputs["rig"] == "twice"
    for other in ("stage: refine, rig: rig, images: photos", "stage: calibrate, square: 1 mm"):
        with pytest.raises(ConfigurationError, match=r"pair.rig: needs rig; name one of"):
            _wire(refined.replace("refine,", "refine, rig: rig,") + f"  another: {{{other}}}\n")


def test_a_port_is_joined_only_where_the_parameters_use_it():
    """A region that is given needs no later photographs, and a rig needs those of the specimen for an offset only."""
    text = GOOD + "  region:  {stage: region, images: photos}\n"
    assert _wire(text)["region"].inputs == {"images": "photos", "images_early": "photos", "rig": "rig"}
    given = text.replace("region, images", "region, rectangle: [0, 0, 9, 9], images")
    assert _wire(given)["region"].inputs == {"images": "photos", "rig": "rig"}
    offset = GOOD.replace("14.5 mm}", "14.5 mm, offset: {left: [8, 0]}, images: photos}")
    assert _wire(offset)["rig"].inputs == {"corners": "corners", "images": "photos"}
    assert _wire(offset)["rig"].node.offset.model_dump() == {"left": (8.0, 0.0), "right": (0.0, 0.0)}


def test_units_are_resolved():
    other = _wire(GOOD.replace("14.5 mm", "1.45 cm"))
    assert other["rig"].node == _wire(GOOD)["rig"].node
    assert other["rig"].node.square == 14.5


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("square: 14.5 mm", "sqare: 14.5 mm", r"p.yaml:6:31: rig.sqare: unknown parameter, did you mean 'square'\?"),
        ("square: 14.5 mm", "square: 14,5 mm", r"rig.5 mm: unknown parameter; write decimals with a point"),
        ("square: 14.5 mm", 'square: "14,5 mm"', r"'14,5 mm' has a decimal comma; write '14.5 mm'"),
        ("square: 14.5 mm", "square:14.5 mm", r"unknown parameter; write 'square: 14.5 mm', with a colon and a blank"),
        ("square: 14.5 mm", "square = 14.5 mm", r"unknown parameter; write 'square: 14.5 mm', with a colon and"),
        ("square: 14.5 mm", "square: 14.5 px", r"p.yaml:6:31: rig.square: '14.5 px' .*mm"),
        ("square: 14.5 mm", "square: -3", r"p.yaml:6:31: rig.square: .*greater than 0, found -3"),
        ("square: 14.5 mm", "square: .nan", r"p.yaml:6:31: rig.square: .*finite"),
        (", square: 14.5 mm", "", r"p.yaml:6:3: rig.square: is missing"),
        ("stage: rectify", "stage: rectfy", r"p.yaml:7:13: pair: no stage 'rectfy', did you mean 'rectify'\?"),
        ("images: photos", "images: photo", r"p.yaml:7:29: pair.images: no stage 'photo', did you mean 'photos'\?"),
        ("images: photos", "images: rig", r"p.yaml:7:29: pair.images: 'rig' gives rig, not images; name one of"),
        ("14.5 mm}", "14.5 mm, images: photos}", r"p.yaml:6:48: rig.images: not used with these parameters; remove it"),
        ("14.5 mm}", "14.5 mm, offset: {left: [1, 2]}}", r"p.yaml:6:3: rig.images: needs images; name one of photos"),
        (", images: photos", "", r"p.yaml:7:3: pair.images: needs images; name one of photos, boards"),
        ("size: [9, 6]", "size: [9]", r"p.yaml:5:45: corners.size: has too few values"),
        ("size: [9, 6]", "size: [9, 1]", r"p.yaml:5:55: corners.size.1: .*greater than or equal to 3, found 1"),
        ("dicflow: 1", "dicflow: 9", r"p.yaml:1:1: .*format 1.* 9"),
        ("dicflow: 1", "sweeps: {}", r"p.yaml:1:1: unknown key 'sweeps', did you mean 'sweep'\?"),
        ("rig:     {stage: calibrate", "3rig:    {stage: calibrate", r"p.yaml:6:3: '3rig'"),
        (
            "pair:    {stage: rectify",
            "pair:    {kind: rectify",
            r"p.yaml:7:3: pair: expected a mapping; say .* 'stage: …'",
        ),
        (
            "rectify, images: photos",
            "rectify, images: [photos]",
            r"p.yaml:7:29: pair.images: .* found \['photos'\]; name one of photos, boards",
        ),
    ],
)
def test_typical_typos(old, new, message):
    assert old in GOOD
    with pytest.raises(ConfigurationError, match=message):
        _wire(GOOD.replace(old, new, 1))


def test_all_problems_are_listed_at_once():
    text = GOOD.replace("square: 14.5 mm", "square: 0").replace("photos}", "phots}")
    with pytest.raises(ConfigurationError) as caught:
        _wire(text)
    assert str(caught.value).count("p.yaml:") == 2


def test_no_stages():
    with pytest.raises(ConfigurationError, match="'stages:'"):
        _wire("dicflow: 1\n")


def test_very_many_stages_are_refused():
    chain = "".join(f"  s{k}: {{stage: smooth, increment: s{k - 1}}}\n" for k in range(1, 3000))
    with pytest.raises(ConfigurationError, match=r"p\.yaml:1:1: 3,000 stages, at most 100 are possible; write fewer"):
        _wire("stages:\n  s0: {stage: displacement}\n" + chain)


def test_long_values_are_cut_in_messages():
    with pytest.raises(ConfigurationError) as raised:
        _wire(GOOD.replace("14.5 mm", f"[{'1, ' * 5000}]"))
    assert len(str(raised.value)) < 1000


def test_of_many_problems_of_a_stage_the_first_are_said():
    with pytest.raises(ConfigurationError) as raised:
        _wire(GOOD.replace("square: 14.5 mm", ", ".join(f"p{k}: 1" for k in range(20_000))))
    assert len(str(raised.value).split("\n")) == 50
