from html.parser import HTMLParser

import pytest
from small import STEPS

from dicflow.errors import StageError
from dicflow.pipeline import Pipeline
from dicflow.report import build


class Page(HTMLParser):
    """Tags that are open, and the text of every list item and heading."""

    VOID = ("meta", "link", "img", "br", "hr", "input")

    def __init__(self, path):
        super().__init__()
        self.open, self.texts = [], []
        self.feed(path.read_text(encoding="utf-8"))
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("li", "h1", "h2", "p"):
            self.texts.append(data)


@pytest.fixture
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


def test_a_run_leaves_a_report_with_its_title_and_stages(loaded, measured):
    path = loaded.path.parent / "results" / loaded.name / "report.html"
    page = Page(path)
    assert page.open == []
    assert page.texts[0] == loaded.title
    assert f"track: {STEPS} of {STEPS}" in page.texts
    assert str(loaded.folder) not in path.read_text()


def test_the_report_says_nothing_of_the_machine(loaded, tmp_path, monkeypatch):
    def broken(context):
        raise StageError(f"{loaded.store_folder}/tmp: <b>no</b> room in {loaded.folder}/photos; make some")

    monkeypatch.setattr(build, "SECTIONS", (broken,))
    path = build.write_report(loaded, loaded.result(), tmp_path / "new")
    assert "tmp: <b>no</b> room in photos; make some" in Page(path).texts
    assert "tmp: &lt;b&gt;no&lt;/b&gt; room" in path.read_text()


def test_the_run_of_a_report_is_one_with_the_same_settings(loaded, pipeline, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(build, "SECTIONS", (lambda context: seen.append(context.run),))
    build.write_report(loaded, loaded.result(), tmp_path)
    other = Pipeline.load(pipeline, settings=["strain.window=[61, 61]"])
    build.write_report(other, other.result(), tmp_path)
    assert seen[0] is not None
    assert seen[0].ended
    assert seen[1] is None


def test_nothing_measured_is_shown_as_nothing(pipeline, tmp_path):
    empty = Pipeline.load(pipeline, store=tmp_path / "store")
    path = build.write_report(empty, empty.result(), tmp_path / "new")
    assert f"track: 0 of {STEPS}" in Page(path).texts
