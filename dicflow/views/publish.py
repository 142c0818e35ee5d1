"""Pictures and tables of a result as files in a folder.

What is up to date is left alone, and what an earlier result had but this one has not is taken away. A list in the
folder says which files dicflow wrote, so that files of others are left untouched. A picture is made of the arrays that
it shows: where another array of a total has changed, it is left alone too.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dicflow.errors import InputError
from dicflow.io.files import make_folder
from dicflow.io.results import csv_text, table_text
from dicflow.pipeline.result import Result
from dicflow.views.published import Job, Published, source_of
from dicflow.views.source_digest import source_digest

if TYPE_CHECKING:
    from dicflow.views.published_maps import MapFiles

__all__ = ["Note", "publish", "unnoted"]

_TABLES = ("comparison", "probes", "channels", "noise")
Note = Callable[[int, int], None]
"""Takes how many parts of something are done, and of how many."""


def unnoted(_done: int, _count: int) -> None:
    """Takes the same, for nobody."""


def publish(
    result: Result, folder: Path, workers: int = 1, *, pictures: bool = True, note: Note = unnoted
) -> list[Path]:
    """Write the maps, the tables of comparisons, probes and noise floors, and the sweep's table of a result.

    folder : made if missing; files whose sources have not changed since are not made again. Pictures of
        steps, phases and quantities that the result no longer has are deleted, unless they were changed since.
    workers : threads that draw at once
    pictures : whether maps are drawn; else those of earlier runs are left as they are
    note : called with the number of drawn parts, and of all
    Ctrl-C ends it when the parts under way are drawn; they are kept.
    Returns the paths of all files, new or not.
    """
    make_folder(folder)
    published, code = Published(folder), source_digest("io", "views")
    whole = source_of(code, result.digests, result.values, pictures)
    files = published.files_of(whole)
    if files is None:
        files = _made(published, _rounds(result, published, code, pictures), workers, note)
        if pictures:
            _delete_others(result, published, files)
        published.save(whole, files)
    return [folder / file for file in files]


def _made(published: Published, rounds: Sequence[Sequence[Job]], workers: int, note: Note) -> list[str]:
    """Make what is missing; the names of all files of the result."""
    sources = {file: source for jobs in rounds for job in jobs for file, source in job.sources.items()}
    stale = {file for file, source in sources.items() if not published.is_current(file, source)}
    count, done = sum(map(len, rounds)), itertools.count(1)
    pool = ThreadPoolExecutor(workers)
    try:
        for jobs in rounds:
            for drawn in as_completed([pool.submit(_do, published, stale, job) for job in jobs]):
                drawn.result()
                note(next(done), count)
    except BaseException:
        pool.shutdown(cancel_futures=True)
        with suppress(InputError):
            published.save("", [])
        raise
    pool.shutdown()
    return list(sources)


def _delete_others(result: Result, published: Published, files: Sequence[str]) -> None:
    """Delete pictures that the result no longer has. files : those that it has"""
    kept = set(files)
    for file in published.listed:
        if file not in kept and file.startswith(_picture_folders(result)):
            published.delete(file)


def _do(published: Published, stale: Collection[str], job: Job) -> None:
    """Make those files of a job that are stale."""
    files = [file for file in job.sources if file in stale]
    if files:
        for file, content in job.make(files).items():
            published.write(file, job.sources[file], content)


def _rounds(result: Result, published: Published, code: str, draws: bool) -> list[list[Job]]:
    """All the work: first what shows the products, then what is put together from that. draws : also maps"""
    maps = list(_maps(result, code)) if draws else []
    tables = list(_tables(result, code))
    pictures = [job for files in maps for job in files.pictures()]
    return [[*pictures, *tables], [job for files in maps for job in files.overviews(published)]]


def _maps(result: Result, code: str) -> Iterator[MapFiles]:
    """The maps of all variants; those that share a product share its files."""
    from dicflow.views.published_maps import MapFiles

    seen: set[str] = set()
    for variant in range(len(result.values)):
        for stage in result.stages_of("maps"):
            if result.has(stage, None, variant) and (digest := result.digest(stage, None, variant)) not in seen:
                seen.add(digest)
                yield MapFiles(result, stage, variant, f"{_prefix(result, variant)}{stage}/", code)


def _picture_folders(result: Result) -> tuple[str, ...]:
    """Folders of pictures, with a slash at their ends, that belong to this result alone."""
    return tuple(
        f"{_prefix(result, variant)}{stage}/"
        for variant in range(len(result.values))
        for stage in result.stages_of("maps")
        if result.has(stage, None, variant)
    )


def _tables(result: Result, code: str) -> Iterator[Job]:
    for variant in range(len(result.values)):
        for stage in (stage for kind in _TABLES for stage in result.stages_of(kind)):
            if result.has(stage, None, variant):
                file = f"{_prefix(result, variant)}{stage}.csv"
                source = source_of(code, result.digest(stage, None, variant))
                yield Job({file: source}, partial(_table_file, result, stage, variant, file))
    if len(result.values) > 1:
        table = result.table()
        source = source_of(code, table_text(table))
        yield Job(dict.fromkeys(("sweep.csv", "sweep.png"), source), partial(_sweep_files, result.values, table))


def _prefix(result: Result, variant: int) -> str:
    """Folder of a variant with a slash at its end; empty if there is only one variant."""
    return "" if len(result.values) == 1 else f"variant_{variant + 1}/"


def _table_file(result: Result, stage: str, variant: int, file: str, _files: Collection[str]) -> dict[str, bytes]:
    return {file: csv_text(result.product(stage, None, variant), stage).encode()}


def _sweep_files(
    values: Sequence[Mapping[str, Any]], table: Sequence[dict[str, Any]], files: Collection[str]
) -> dict[str, bytes]:
    from dicflow.views.maps import png
    from dicflow.views.sweep import sweep_figure

    made = {"sweep.csv": lambda: table_text(table).encode(), "sweep.png": lambda: png(sweep_figure(values, table))}
    return {file: made[file]() for file in files}
