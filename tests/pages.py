"""Pages that must be complete: checked as HTML, and searched for anything outside of them."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

from dicflow.report.context import Context
from dicflow.report.pieces import Pieces

VOID = ("meta", "link", "img", "br", "hr", "input", "path", "use")


class Page(HTMLParser):
    """A page with every tag closed; its texts, classes and references.

    texts : of every element by itself, without white space around
    """

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.references: list[str] = []
        self.policies: list[str] = []
        self.ids: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []
        assert len(self.ids) == len(set(self.ids))

    @classmethod
    def read(cls, path: Path) -> Page:
        """The page in a file."""
        return cls(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self._look(tag, dict(attrs))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._look(tag, dict(attrs))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if data.strip() and not {"script", "style"} & set(self.open):
            self.texts.append(" ".join(data.split()))

    def _look(self, tag: str, attrs: dict[str, str | None]) -> None:
        self.references += [attrs[name] or "" for name in ("src", "href", "xlink:href") if name in attrs]
        self.ids += [attrs["id"] or ""] if "id" in attrs else []
        if attrs.get("http-equiv") == "Content-Security-Policy":
            self.policies.append(attrs["content"] or "")

    @property
    def text(self) -> str:
        """All that is to be read."""
        return " ".join(self.texts)

    def assert_complete(self) -> None:
        """It refers to itself, to data in it, or to files beside it, and is allowed no more."""
        assert self.policies[0].startswith("default-src 'none'; img-src data:;")
        outer = [reference for reference in self.references if not reference.startswith(("#", "data:"))]
        assert not [reference for reference in outer if ":" in reference or reference.startswith(("/", ".."))]


def context_of(loaded, folder):
    """What builders of sections are given, without a run."""
    return Context(loaded, loaded.result(), None, Pieces(folder / ".report", "code"), folder)
