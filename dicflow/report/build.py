"""The page: its sections in order, in one file. The answer and the summary stand first and are made last."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from markupsafe import Markup

from dicflow._version import __version__
from dicflow.engine.journal import RunInfo, find_run
from dicflow.engine.whole_file import read_file
from dicflow.errors import DicflowError, InputError
from dicflow.explorer.pack import packed_result
from dicflow.io.files import make_folder, write_whole
from dicflow.pipeline import Pipeline, Result
from dicflow.pipeline.provenance import RunFacts, run_facts
from dicflow.report.answer import answer
from dicflow.report.context import Context, Section
from dicflow.report.pieces import Pieces
from dicflow.report.rendering import assets, render
from dicflow.report.sections import SECTIONS, Entry, entries
from dicflow.report.summary import summary
from dicflow.report.words import date
from dicflow.views.publish import Note, unnoted
from dicflow.views.source_digest import source_digest

__all__ = ["write_report"]

_OPEN_IN_SWEEP = ("answer", "summary", "sweep")
APPENDIX = ("calibration", "quality", "provenance")
"""Sections that are printed on request alone."""


def write_report(
    pipeline: Pipeline,
    result: Result,
    folder: Path,
    workers: int = 1,
    note: Callable[[str], None] | None = None,
    progress: Note = unnoted,
) -> Path:
    """Write ``report.html`` and return its path.

    folder : of the maps and tables, made if missing
    workers : threads that draw at once
    note : called with the message of each section that fails; a page with one is made again by the next call
    progress : called with the number of sections made, and of all
    Nothing is computed: what the store lacks is listed as missing, and a section that fails shows its error.
    A page of the same products is kept if the run computed nothing: it describes the run that made them.
    Raises InputError where the file cannot be written.
    """
    found = _run(pipeline, result)
    facts = run_facts(pipeline.store, found) if found is not None else None
    logo, problems = _logo(pipeline)
    sources = _sources(pipeline, result, facts, logo)
    page, record = folder / "report.html", folder / ".report" / "sources"
    if _was_idle(result) and page.is_file() and _is(record, sources):
        return page
    make_folder(folder)
    pieces = Pieces(folder / ".report", _code())
    context = Context(pipeline, result.of_one_test(), facts, pieces, folder, workers)
    text = _page(context, _sections(context, problems, progress), logo)
    pieces.drop_unused()
    write_whole(page, text.encode())
    make_folder(record.parent)
    write_whole(record, b"" if problems else sources.encode())
    if note is not None:
        for problem in problems:
            note(problem)
    return page


def _is(path: Path, text: str) -> bool:
    """Whether a file holds a text."""
    try:
        return read_file(path) == text.encode()
    except OSError:
        return False


def _was_idle(result: Result) -> bool:
    """Whether the run computed nothing, or there was no run."""
    return result.outcome is None or not any(
        count for status, count in result.outcome.counts.items() if status != "hit"
    )


def _code() -> str:
    """Digest of the code that makes the page."""
    return json.dumps([source_digest("views", "explorer", "report"), *SECTIONS.plugin_code()])


def _sources(pipeline: Pipeline, result: Result, run: RunFacts | None, logo: bytes) -> str:
    """Digest of all that the page shows; of a run that ended, only that it ended."""
    is_whole = run is None or (run.ended and not run.interrupted and not run.counts["failed"])
    state = "" if run is None or is_whole else run.id
    settings = (pipeline.path.name, pipeline.title, pipeline.resolved())
    stated = [pipeline.facts.model_dump(), hashlib.sha256(logo).hexdigest()]
    content = json.dumps([_code(), *settings, stated, result.digests, result.notes, state])
    return hashlib.sha256(content.encode()).hexdigest()


def _run(pipeline: Pipeline, result: Result) -> RunInfo | None:
    """The run that has just ended, else the newest with the same stages and settings."""
    if result.outcome is not None and result.outcome.run_id:
        return find_run(pipeline.store, result.outcome.run_id)
    return pipeline.last_run()


def _sections(context: Context, problems: list[str], progress: Note) -> list[Section]:
    """The sections that this pipeline has, in order. problems : takes the messages of those that fail

    The values of the fields are packed while the other sections are made.
    """
    parts = entries()
    count, done = len(parts) + 2, itertools.count(1)

    def made(entry: Entry) -> list[Section]:
        section = _built(entry, context, problems)
        progress(next(done), count)
        return [] if section is None else [section]

    with ThreadPoolExecutor(1) as beside:
        shown = context.result, context.pipeline.title, context.pieces.get
        found = beside.submit(packed_result, *shown, threads=context.workers)
        sections = [section for entry in parts for section in made(entry)]
        opening = made(Entry("answer", "Result", lambda context: answer(context, found.result(), sections)))
    first = made(Entry("summary", "Summary", lambda context: summary(context, [*opening, *sections])))
    return [*opening, *first, *sections]


def _built(entry: Entry, context: Context, problems: list[str]) -> Section | None:
    """A section, or in its place the error message; a defect of a plug-in affects its own section only.

    problems : takes the message
    """
    try:
        return entry.build(context)
    except Exception as error:
        if not isinstance(error, DicflowError) and not entry.is_plugin:
            raise
        reason = str(error) if isinstance(error, DicflowError) else f"{type(error).__name__}: {error}"
        message = context.without_local_paths(reason)
        problems.append(f"report, section {entry.title}: {message}")
        return Section(entry.key, entry.title, Markup('<p class="warning">{}</p>').format(message), (message,))


def _logo(pipeline: Pipeline) -> tuple[bytes, list[str]]:
    """The logo as PNG, empty without any; and the message if it cannot be used."""
    name = pipeline.facts.logo
    if name is None:
        return b"", []
    from dicflow.views.logo import logo_png

    try:
        return logo_png(pipeline.path.parent, name), []
    except InputError as error:
        return b"", [f"report, head: {error}"]


def _page(context: Context, sections: list[Section], logo: bytes) -> str:
    return render(
        "page.html",
        title=context.pipeline.title,
        subtitle=_subtitle(context),
        style=assets(".css"),
        script=assets(".js"),
        sections=sections,
        folded=_folded(context, sections),
        appendix=APPENDIX,
        paper_title=_css_text(f"{context.pipeline.title} · {context.pipeline.path.name}"),
        logo=base64.b64encode(logo).decode(),
        version=__version__,
    )


def _folded(context: Context, sections: list[Section]) -> set[str]:
    """Keys of the sections that a reader unfolds: of a sweep all that describe its first variant in detail."""
    is_swept = len(context.result.values) > 1
    return {section.key for section in sections if is_swept and section.key not in _OPEN_IN_SWEEP}


def _css_text(text: str) -> Markup:
    """A text as CSS has it between quotes, by the codes of all that is not a letter or digit."""
    return Markup("".join(one if one.isalnum() and one.isascii() else f"\\{ord(one):06x}" for one in text))


def _subtitle(context: Context) -> str:
    """The pipeline file and the run that the page describes."""
    run = context.run
    when = "not run as it stands" if run is None else f"run {run.id} of {date(run.started)}"
    return f"{context.pipeline.path.name} · {when}"
