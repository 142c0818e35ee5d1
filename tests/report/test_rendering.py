import pytest
from jinja2 import DictLoader, Environment

from dicflow.report.rendering import KeptTemplates
from tests.replaced import replace_here


@pytest.fixture
def compiled(monkeypatch):
    """The names of templates that were compiled."""
    names, compile_template = [], Environment.compile

    def noted(self, source, name=None, *arguments, **options):
        names.append(name)
        return compile_template(self, source, name, *arguments, **options)

    replace_here(monkeypatch, Environment, "compile", noted)
    return names


def page(folder, text="{{ 6 * 7 }}"):
    return Environment(loader=DictLoader({"a": text}), bytecode_cache=KeptTemplates(folder)).get_template("a").render()


def test_a_template_is_compiled_once(tmp_path, compiled):
    assert [page(tmp_path), page(tmp_path)] == ["42", "42"]
    assert compiled == ["a"]


def test_a_changed_template_is_compiled_again(tmp_path, compiled):
    assert [page(tmp_path), page(tmp_path, "{{ 6 + 7 }}")] == ["42", "13"]
    assert compiled == ["a", "a"]


@pytest.mark.parametrize("end", [0, 20, 40, -1])
def test_a_damaged_one_counts_as_missing(tmp_path, compiled, end):
    page(tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    path.write_bytes(whole[:end])
    assert page(tmp_path) == "42"
    assert (compiled, path.read_bytes()) == (["a", "a"], whole)


def test_one_of_other_code_counts_as_missing(tmp_path, compiled, monkeypatch):
    page(tmp_path)
    monkeypatch.setattr("dicflow.report.rendering.source_digest", lambda *_: "other")
    assert page(tmp_path) == "42"
    assert compiled == ["a", "a"]


def test_a_folder_that_cannot_be_written_does_not_matter(tmp_path):
    assert page(tmp_path / "missing") == "42"
