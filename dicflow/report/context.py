"""Input and output of the sections of a report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from markupsafe import Markup

from dicflow.errors import NotKeptError
from dicflow.pipeline import Pipeline, Result
from dicflow.pipeline.provenance import RunFacts
from dicflow.report.pieces import Pieces

__all__ = ["Builder", "Context", "Section"]


class Context(NamedTuple):
    """Input of a section.

    run : facts of the run that made the products; None if this pipeline was never run with these settings
    pieces : slow parts, kept from one build to the next
    folder : where the report is written; maps and tables lie beside it
    workers : threads that may draw at once
    """

    pipeline: Pipeline
    result: Result
    run: RunFacts | None
    pieces: Pieces
    folder: Path
    workers: int = 1

    def piece(self, sources: Sequence[str], make: Callable[[], bytes]) -> bytes | None:
        """A piece; None if it is not kept and the store lacks the products to make it."""
        try:
            return self.pieces.get(sources, make)
        except NotKeptError:
            return None

    def without_local_paths(self, message: str) -> str:
        """A message without the folders of this machine: files are named from the pipeline's folder on."""
        pipeline = self.pipeline
        near = (pipeline.store_folder, pipeline.folder, pipeline.path.parent, self.folder, Path.cwd(), Path.home())
        known = {place for folder in near for place in (folder.absolute(), folder.resolve())}
        for folder in sorted(known - {Path("/")}, key=lambda place: len(place.parts), reverse=True):
            message = message.replace(f"{folder}/", "")
            for behind in ":;, ":
                message = message.replace(f"{folder}{behind}", f"{folder.name}{behind}")
        return message


class Section(NamedTuple):
    """One part of the page.

    key : its anchor, and the file name of its template
    body : HTML
    warnings : whole sentences that a reader must see first; the summary shows those of all sections
    covers : stages, by their names in the graph, all of whose warnings these are; the summary shows no others of them
    """

    key: str
    title: str
    body: Markup
    warnings: tuple[str, ...] = ()
    covers: tuple[str, ...] = ()


Builder = Callable[[Context], Section | None]
"""Makes a section; None if it does not apply to the pipeline."""
