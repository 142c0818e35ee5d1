"""Edits of the pipeline file keep all else, are checked as the command line checks, and can be taken back."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
from app_serving import FILE, served, small_test
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dicflow.app import versions
from dicflow.app.document import edit, edits_of, problems, read_pipeline
from dicflow.app.project import open_project
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse
from dicflow.io.edited_yaml import REMOVED, Edit, edited
from dicflow.pipeline import Pipeline

ROOT = Path(__file__).resolve().parents[2]
PIPELINES = sorted((ROOT / "pipelines").glob("*.yaml"))


@pytest.fixture
def project(tmp_path):
    return open_project(small_test(tmp_path / "test"))


def change(project, place, text, words="words"):
    """Write one edit as the page does."""
    edits = edits_of([{"place": place, "text": text}])
    return edit(project, FILE, versions.digest_of(project, FILE), edits, words)


@pytest.mark.parametrize("path", PIPELINES, ids=lambda path: path.stem)
def test_an_edit_changes_one_line_of_every_pipeline(path):
    text = path.read_text()
    name = next(iter(parse(text, "p").data["stages"]))
    new = edited(text, "p", [Edit(("stages", name, "keep"), "never")])
    changed = [(old, now) for old, now in zip(text.splitlines(), new.splitlines(), strict=True) if old != now]
    assert [now for _, now in changed] == [old.replace("}", ", keep: never}", 1) for old, _ in changed]
    assert len(changed) == 1
    assert edited(new, "p", [Edit(("stages", name, "keep"), REMOVED)]) == text


def test_odd_style_and_comments_stay():
    text = (
        "stages:   # names\n    a:    {stage: images,   left: 'x'}   # one\n    b:\n        stage: region\n"
        "        # why\n        window: 32   # px\n\n# end\n"
    )
    new = edited(text, "p", [Edit(("stages", "b", "window"), 64)])
    assert new.splitlines()[1] == text.splitlines()[1]
    assert "# why" in new
    assert "window: 64" in new
    assert new.endswith("# end\n")


def test_a_new_parameter_of_a_block_stands_before_the_next_comment():
    text = "stages:\n  rig:\n    stage: calibrate\n    square: 5 mm\n\n  # the specimen\n  region: {stage: region}\n"
    new = edited(text, "p", [Edit(("stages", "rig", "tangential"), True)])
    assert new == text.replace("    square", "    tangential: true\n    square")


def test_a_reminder_goes_once_its_value_is_given():
    text = (
        "stages:\n  rig:\n    stage: calibrate\n    square:  # FILL IN the side of one square\n    tangential: true\n"
    )
    new = edited(text, "p", [Edit(("stages", "rig", "square"), "14.5 mm")])
    assert new == text.replace("square:  # FILL IN the side of one square", "square: 14.5 mm")


@pytest.mark.parametrize("end", ["", "# end\n", "\n\n  # more\n# end", "  # x\n\n"])
def test_a_section_stands_before_the_last_comments_and_goes_without_a_trace(end):
    text = "stages:\n  a: {stage: images}\n  b: {stage: region, images: a}\n" + end
    facts = {"specimen": 'strip "A": <b>', "camera": "two \\ cameras", "lens": "50", "light": "# lamps"}
    new = text
    for fact, words in facts.items():
        new = edited(new, "p", [Edit(("report", fact), words)])
    assert parse(new, "p").data["report"] == facts
    assert list(parse(new, "p").data["report"]) == list(facts)
    start = text.removesuffix(end)
    assert new.startswith(f"{start}report:\n  specimen: ")
    assert new.endswith(f'lamps"\n{end}')
    assert edited(new, "p", [Edit(("report",), REMOVED)]) == text


TEXTS = st.text(max_size=8, alphabet=st.characters(codec="utf-8", exclude_categories=["C"]))
KEYS = st.from_regex(r"[a-z_]{1,6}", fullmatch=True)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**6), 10**6) | st.floats(-1e6, 1e6) | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
)


@pytest.mark.slow
@settings(max_examples=150)
@given(path=st.sampled_from(PIPELINES), value=VALUES, key=st.from_regex(r"[a-z_]{1,8}", fullmatch=True))
def test_any_value_comes_back_and_all_else_stays(path, value, key):
    text = path.read_text()
    data = parse(text, "p").data
    name = list(data["stages"])[-1]
    wanted = copy.deepcopy(data)
    wanted["stages"][name][key] = value
    new = edited(text, "p", [Edit(("stages", name, key), value)])
    assert parse(new, "p").data == wanted
    comments = [line.partition("#")[2] for line in text.splitlines() if line.lstrip().startswith("#")]
    assert [line.partition("#")[2] for line in new.splitlines() if line.lstrip().startswith("#")] == comments


def test_edits_are_refused_in_the_words_of_the_command_line(project, tmp_path):
    before = project.path(FILE).read_bytes()
    for place, text in (
        (["stages", "correlation", "subset_size"], "22"),
        (["stages", "correlation", "subset_sise"], "21"),
        (["stages", "total", "points"], "nothing"),
        (["stages", "total", "window"], "4 kg"),
    ):
        wrong = tmp_path / "test" / "wrong.yaml"
        wrong.write_text(edited(before.decode(), "p", edits_of([{"place": place, "text": text}])))
        with pytest.raises(ConfigurationError) as said:
            Pipeline.load(wrong)
        with pytest.raises(ConfigurationError) as refused:
            change(project, place, text)
        assert str(refused.value) == str(said.value).replace("wrong.yaml", FILE)
    assert project.path(FILE).read_bytes() == before


def test_a_wrong_file_can_be_edited_step_by_step(project):
    path = project.path(FILE)
    path.write_text(
        path.read_text().replace("subset_size: 21", "subset_size: 22").replace("step_size: 5", "step_size: 0")
    )
    assert len(change(project, ["stages", "correlation", "subset_size"], "23")) == 1
    assert change(project, ["stages", "correlation", "step_size"], "7") == []
    assert problems(path.read_text(), FILE) == []


def test_undo_and_redo_survive_and_give_the_same_bytes(project, tmp_path):
    path = project.path(FILE)
    states = [path.read_bytes()]
    for size in ("23", "25", "27"):
        change(project, ["stages", "correlation", "subset_size"], size, f"size {size}")
        states.append(path.read_bytes())
    again = open_project(tmp_path / "test")
    assert versions.can(again) == {"undo": "size 27", "redo": ""}
    for state, words in zip(states[-2::-1], ("size 27", "size 25", "size 23"), strict=True):
        assert versions.undo(again, {}) == words
        assert path.read_bytes() == state
    assert versions.undo(again, {}) == ""
    for state in states[1:]:
        versions.redo(again, {})
        assert path.read_bytes() == state
    versions.undo(again, {})
    change(project, ["stages", "correlation", "subset_size"], "31")
    assert versions.can(again)["redo"] == ""


ACTS = st.lists(st.tuples(st.sampled_from(["edit", "undo", "redo", "elsewhere"]), st.integers(0, 50)), max_size=25)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(acts=ACTS)
def test_history_is_that_of_a_list(acts, tmp_path_factory):
    """What an editor wrote before the app's first change is where the history begins; later it is a change itself."""
    project = open_project(small_test(tmp_path_factory.mktemp("test") / "test", steps=1))
    path = project.path(FILE)
    states, at, base = [path.read_bytes()], 0, path.read_text()

    def meet():
        if path.read_bytes() == states[at]:
            return at
        states[at + 1 if len(states) > 1 else 0 :] = [path.read_bytes()]
        return len(states) - 1

    for act, number in acts:
        if act == "elsewhere":
            path.write_text(f"{base}# elsewhere {number}\n")
            continue
        at = meet()
        seen = {FILE: versions.digest_of(project, FILE)}
        if act == "edit":
            versions.change(project, seen, {FILE: f"{base}# {number}\n".encode()}, "edit")
            if path.read_bytes() != states[at]:
                states[at + 1 :], at = [path.read_bytes()], at + 1
        else:
            way = -1 if act == "undo" else 1
            (versions.undo if act == "undo" else versions.redo)(project, seen)
            at += way if 0 <= at + way < len(states) else 0
        assert path.read_bytes() == states[at]


def test_a_file_that_changed_meanwhile_is_never_overwritten(project):
    path = project.path(FILE)
    seen = versions.digest_of(project, FILE)
    change(project, ["title"], "one page")
    with pytest.raises(versions.Conflict, match="changed meanwhile"):
        edit(project, FILE, seen, [Edit(("title",), "another page")], "x")
    ours = path.read_text()
    path.write_text(ours + "# by an editor\n")
    with pytest.raises(versions.Conflict):
        versions.undo(project, {})
    with pytest.raises(versions.Conflict):
        versions.change(project, {}, {FILE: b""}, "x")
    assert path.read_text() == ours + "# by an editor\n"


def test_what_an_editor_did_can_be_taken_back_once_a_page_has_seen_it(project):
    path = project.path(FILE)
    change(project, ["title"], "ours")
    ours = path.read_bytes()
    path.write_bytes(ours + b"# by an editor\n")
    versions.undo(project, {FILE: versions.digest_of(project, FILE)})
    assert path.read_bytes() == ours
    versions.redo(project, {FILE: versions.digest_of(project, FILE)})
    assert path.read_bytes() == ours + b"# by an editor\n"


def test_a_damaged_history_is_an_empty_one(project):
    change(project, ["title"], "ours")
    for text in ("", "{}", '{"entries": [{"words": "x", "files": {"../x": ["zz", "../../x"]}}], "position": 1}'):
        (project.own_folder / "history.json").write_text(text)
        assert versions.can(project) == {"undo": "", "redo": ""}
        assert read_pipeline(project, FILE).text


def test_a_file_that_is_no_yaml_is_shown_with_its_problem(project):
    project.path(FILE).write_text("stages: {a: [}\n")
    assert "not valid YAML" in problems(read_pipeline(project, FILE).text, FILE)[0]
    with pytest.raises(ConfigurationError):
        change(project, ["title"], "x")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"- photos\n- region\n", "found a list"),
        (b"dicflow: 1\ntitle: none yet\n", "stages"),
        ("title: Dehnung über Kraft\nstages: {}\n".encode("cp1252"), "UTF-8"),
        (b"\x00\x01", "control character"),
    ],
)
def test_a_file_of_the_usual_name_is_opened_and_its_problem_shown(tmp_path, content, words):
    (tmp_path / FILE).write_bytes(content)
    with served(tmp_path) as app:
        assert app.found("project")["chosen"] == FILE
        found = app.found("document", file=FILE)
        assert words in found["problems"][0]
        assert (found["text"] is None) == (words in ("UTF-8", "control character"))
    assert (tmp_path / FILE).read_bytes() == content


def test_a_blank_file_counts_as_none(tmp_path):
    (tmp_path / FILE).write_text("\n")
    assert open_project(tmp_path).pipelines() == []
