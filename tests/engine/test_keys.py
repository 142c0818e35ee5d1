import pytest
import toys
from toys import Scale

from dicflow.engine.keys import Change, differences, input_digests, key_maker, key_of, key_parts, parameters
from dicflow.engine.references import Ref

ONE, TWO = "sha256:" + "1" * 64, "sha256:" + "2" * 64


def key(node, inputs=None, files=None):
    """The key of a task, which a plan and a worker find in two ways."""
    found, values = input_digests(inputs if inputs is not None else {"number": Ref(ONE)}), parameters(node)
    whole = key_of(key_parts(node, values, found, files or {}))
    assert key_maker(node, values)(found, files or {}) == whole
    return whole


GOLDEN = {
    "scale": "sha256:841b6cc629fb8805a2bffff4d87e55b0c08a2fde94f51d66f5135c242fe7c6a0",
    "rig": "sha256:ff76934dd3a79e132fe7770f9ea90ad8b952db50ac7608dbf54b52f8a1d0eb35",
    "read": "sha256:30ec63e973faf57d44ab18c05212456b4707bc749eacfb5247129fc161d36c81",
}


def test_golden_keys():
    """A store made by an earlier release must still be found."""
    assert key(Scale()) == GOLDEN["scale"]
    assert key(toys.Rig(), {"numbers": (("a", Ref(ONE)), ("b", Ref(TWO)))}) == GOLDEN["rig"]
    assert key(toys.Read(), {}, {"source": TWO}) == GOLDEN["read"]


@pytest.mark.parametrize(
    "same",
    [{"factor": 2.0}, {"factor": 2}, {"length": "2 cm"}, {"length": "20 mm"}, {"threads": 7}, {"keep": "never"}],
)
def test_one_meaning_one_key(same):
    assert key(Scale(**same)) == key(Scale())


@pytest.mark.parametrize("other", [{"factor": 2.5}, {"length": "2 mm"}])
def test_another_meaning_another_key(other):
    assert key(Scale(**other)) != key(Scale())


def test_the_path_of_a_file_is_not_in_the_key():
    assert key(Scale(table="a.txt"), files={"table": ONE}) == key(Scale(table="/b/c.txt"), files={"table": ONE})
    assert key(Scale(table="a.txt"), files={"table": ONE}) != key(Scale(table="a.txt"), files={"table": TWO})


def test_the_version_of_the_implementation_is_in_the_key(monkeypatch):
    before = key(Scale())
    monkeypatch.setattr(Scale, "impl_version", 2)
    assert key(Scale()) != before


def test_an_absent_input_and_a_future_one_are_the_same():
    assert key(Scale(), {"number": Ref(ONE), "rig": None}) == key(Scale(), {"number": Ref(ONE)})


def test_names_of_steps_count_where_they_are_seen():
    one, other = {"numbers": (("a", Ref(ONE)),)}, {"numbers": (("b", Ref(ONE)),)}
    assert key(toys.Rig(), one) != key(toys.Rig(), other)


def test_what_cannot_be_hashed_is_an_error():
    with pytest.raises(TypeError):
        key_of({"parameters": object()})


def test_differences_say_what_changed():
    old = key_parts(Scale(), {"degree": {"x": 2, "y": 2}, "a": 1}, {"number": ONE, "rig": ONE}, {"table": ONE})
    new = key_parts(Scale(), {"degree": {"x": 3, "y": 2}, "a": 1}, {"number": TWO}, {"table": TWO})
    texts = [change.text for change in differences(old, new)]
    assert texts == ["degree.x: 2 → 3", "file table changed", "input number changed", "input rig is no longer given"]
    assert differences(old, old) == []


def test_changes_in_words():
    assert Change("parameter", "a", None, "x" * 100).text == f"a: none → {'x' * 57}…"
    assert Change("code", "dicflow.core.tensors:inverse").text == "code of dicflow.core.tensors:inverse changed"
    assert Change("code").text == "the code changed"
    assert Change("version", "impl_version", 1, 2).text == "impl_version: 1 → 2"
    assert Change("file", "left", None, ONE).text == "file left is new"
