"""What the sections of a report are made from, and what each of them is."""

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
    """Everything that a section may ask.

    run : facts of the run that the products are of; None where this pipeline was never run as it stands
    pieces : keeps what is slow to make from one build to the next
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
        """A piece; None where it is not at hand and would be made of what the store does not keep."""
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
    """

    key: str
    title: str
    body: Markup
    warnings: tuple[str, ...] = ()


Builder = Callable[[Context], Section | None]
"""Makes a section; None where this pipeline has nothing of the kind."""
