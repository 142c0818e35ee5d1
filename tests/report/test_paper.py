"""A page on paper: by any browser, and a message without one."""

import re
import sys
from types import SimpleNamespace

import pytest
from small import dicflow

from dicflow.errors import ConfigurationError, InputError
from dicflow.report import paper
from dicflow.report.paper import find_browser, write_pdf

PAGE = """<!DOCTYPE html><meta charset="utf-8"><style>@page {{ size: A4; }} p {{ break-after: page; }}</style>
{}<script>document.body.append("drawn")</script>"""


@pytest.fixture
def page(tmp_path):
    path = tmp_path / "a report #1.html"
    path.write_text(PAGE.format("<p>one</p><p>two</p>three"))
    return path


def program(folder, text):
    """A program that stands for a browser."""
    path = folder / "browser"
    path.write_text(f"#!{sys.executable}\nimport sys, time\n{text}\n")
    path.chmod(0o755)
    return str(path)


def left_behind(page):
    return sorted(path.name for path in page.parent.iterdir() if path.suffix not in (".html", ".pdf", ""))


@pytest.mark.slow
def test_a_browser_prints_on_a4(page):
    if find_browser() is None:
        pytest.skip("needs Chromium, Chrome or Edge")
    path = write_pdf(page)
    content = path.read_bytes()
    assert path.name == "a report #1.pdf"
    assert content.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", content)) == 3
    width, height = (float(size) for size in re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content).groups())
    assert (width, height) == pytest.approx((595.3, 841.9), abs=1)
    assert sorted(child.name for child in page.parent.iterdir()) == ["a report #1.html", "a report #1.pdf"]


def test_without_a_browser_the_message_says_what_to_install(page, monkeypatch):
    monkeypatch.setattr(paper, "shutil", SimpleNamespace(which=lambda name: None))
    monkeypatch.setattr(paper, "_usual_places", lambda: iter(()))
    with pytest.raises(ConfigurationError, match="install Chromium, Google Chrome or Microsoft Edge, or print"):
        write_pdf(page)


def test_a_browser_is_also_found_in_the_usual_places(tmp_path, monkeypatch):
    place = tmp_path / "Microsoft" / "Edge" / "Application" / "msedge.exe"
    place.parent.mkdir(parents=True)
    place.touch()
    monkeypatch.setattr(paper, "shutil", SimpleNamespace(which=lambda name: None))
    monkeypatch.setattr(paper, "sys", SimpleNamespace(platform="win32"))
    monkeypatch.setenv("PROGRAMFILES", str(tmp_path))
    assert find_browser() == str(place)


@pytest.mark.parametrize(
    ("text", "words"), [("sys.exit(3)", "cannot print it"), ("", "made no PDF"), ("time.sleep(60)", "after 1 s")]
)
def test_a_browser_that_fails_is_named_and_an_older_pdf_stays(page, monkeypatch, text, words):
    browser = program(page.parent, text)
    monkeypatch.setattr(paper, "find_browser", lambda: browser)
    monkeypatch.setattr(paper, "_PATIENCE_S", 1)
    older = page.with_suffix(".pdf")
    older.write_bytes(b"older")
    with pytest.raises(InputError, match=words) as found:
        write_pdf(page)
    assert browser in str(found.value)
    assert older.read_bytes() == b"older"
    assert left_behind(page) == []


def test_the_command_prints_the_report_of_a_test(pipeline, measured, tmp_path):
    if find_browser() is None:
        pytest.skip("needs Chromium, Chrome or Edge")
    answer = dicflow("report", pipeline, "--pdf", "--output", tmp_path)
    assert answer.out.splitlines() == [str(tmp_path / "report.html"), str(tmp_path / "report.pdf")]
    content = (tmp_path / "report.pdf").read_bytes()
    client = len(re.findall(rb"/Type /Page\b", content))
    assert 2 <= client <= 4
    assert b"/Subtype /Image" in content
    answer = dicflow("report", pipeline, "--pdf", "--appendix", "--output", tmp_path)
    assert answer.code == 0, answer.err
    assert len(re.findall(rb"/Type /Page\b", (tmp_path / "report.pdf").read_bytes())) > client + 2
    dicflow("report", pipeline, "--appendix").refuses(2, "--pdf")
