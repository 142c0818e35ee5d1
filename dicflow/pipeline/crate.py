"""A run as a crate, which another machine takes in so that nothing is measured again."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from dicflow.engine.journal import RunInfo
from dicflow.engine.store import Store
from dicflow.engine.transfer import Folder, Moved, pull
from dicflow.errors import ConfigurationError, InputError, StoreError
from dicflow.io.crate import (
    FILES,
    METADATA,
    STORE,
    Contents,
    Crate,
    Described,
    copy_file,
    is_plain,
    read_crate,
    refuse_link,
)
from dicflow.io.files import staged
from dicflow.pipeline.pipeline import Pipeline
from dicflow.pipeline.provenance import run_facts

__all__ = ["import_crate", "write_crate"]

Progress = Callable[[int, int, str], None]


def write_crate(
    pipeline: Pipeline, methods: str, output: Path, force: bool = False, on_product: Progress = lambda *_: None
) -> Path:
    """Write the last run of a pipeline file as a crate into a folder, and return the crate's own folder.

    methods : how it was measured, in sentences
    Raises ConfigurationError where the crate could not be run elsewhere, StoreError where a product is missing.
    """
    run = pipeline.last_run()
    if run is None:
        raise StoreError(str(pipeline.path), "has not been run with these settings", "run it, then export it")
    name = f"{pipeline.name}.crate"
    with staged(output, force) as draft:
        crate = draft / name
        (crate / FILES).mkdir(parents=True)
        files = {path: _copied(source, crate / FILES / path) for path, source in _sources(pipeline).items()}
        pull(Store.open(crate / STORE), Folder(pipeline.store.path), run.id, on_product)
        _check(pipeline, run, crate)
        facts = run_facts(pipeline.store, run)
        contents = Crate(pipeline.path.name, files)
        described = Described(contents, pipeline.title, methods, run.id, run.started, facts.versions)
        (crate / METADATA).write_bytes(described.to_json())
    return output / name


def import_crate(crate: Path, folder: Path, on_product: Progress = lambda *_: None) -> tuple[Path, Moved]:
    """Make a folder with the files and the store of a crate: all of it, or nothing.

    Returns the pipeline file, and what the store has taken. Raises InputError or StoreError for what is damaged.
    """
    found = read_crate(crate)
    with staged(folder) as draft:
        for path, contents in found.files.items():
            target = draft / path
            target.parent.mkdir(parents=True, exist_ok=True)
            refuse_link(crate / FILES / path, crate)
            copy_file(crate / FILES / path, target, contents)
        refuse_link(crate / STORE, crate)
        moved = pull(Store.open(draft / ".dicflow"), Folder(crate / STORE), on_product=on_product)
    return folder / found.pipeline, moved


def _sources(pipeline: Pipeline) -> dict[str, Path]:
    """Path in a crate → file here: the pipeline file, and every file that it reads or leaves out."""
    read = {Path(file) for task in pipeline.graph.tasks.values() for file in task.files.values()}
    found = {file for spec in pipeline.stages.values() for file in spec.node.finds(spec.folder)}
    sources = {_place(pipeline.folder, file): file for file in sorted(read | found)}
    beside = [pipeline.path.name] + ([] if pipeline.facts.logo is None else [pipeline.facts.logo])
    for name in beside:
        file = pipeline.path.parent / name
        if sources.setdefault(_place(pipeline.path.parent, file), file).resolve() != file.resolve():
            raise ConfigurationError(f"{file}: {sources[name]} has the same place in the crate; rename one")
    return sources


def _place(folder: Path, file: Path) -> str:
    """Path of a file below a folder."""
    path = Path(os.path.relpath(file, folder)).as_posix()
    if not is_plain(path):
        raise ConfigurationError(
            f"{file}: a crate holds files below {folder} alone, with names that are not hidden and that every system "
            "has; move or rename it"
        )
    return path


def _copied(source: Path, target: Path) -> Contents:
    target.parent.mkdir(parents=True, exist_ok=True)
    return copy_file(source, target)


def _check(pipeline: Pipeline, run: RunInfo, crate: Path) -> None:
    """Plan the run as whoever takes in the crate will. Raises ConfigurationError for what would be measured again."""
    there = Pipeline.load(crate / FILES / pipeline.path.name, store=crate / STORE)
    if not _reads_inside(there, crate.absolute()):
        raise ConfigurationError(f"{pipeline.path}: names files by their whole paths; write relative ones")
    entries = there.plan("ignore").entries
    again = [task for task in run.index if task not in entries or entries[task].state != "hit"]
    if again:
        raise ConfigurationError(
            f"{pipeline.path}: {len(again)} products of its last run would be measured again, the first {again[0]}; "
            "files have changed since; run it again, then export it"
        )
    for name in ("files.index", "actions.index", "tmp"):  # only of use where they were written
        path = crate / STORE / name
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def _reads_inside(pipeline: Pipeline, folder: Path) -> bool:
    """Whether all files that a pipeline reads lie in a folder."""
    try:
        files = [Path(file) for task in pipeline.graph.tasks.values() for file in task.files.values()]
    except InputError:  # it would read outside
        return False
    return all(file.is_relative_to(folder) for file in files)
