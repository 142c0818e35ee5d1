"""The methods paragraph of a paper, from what the stages say of themselves."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from dicflow._version import __version__
from dicflow.errors import NotKeptError
from dicflow.pipeline import Pipeline, Result
from dicflow.stages._references import REFERENCES

if TYPE_CHECKING:
    from dicflow.engine.product import Product

__all__ = ["Paragraph", "methods_paragraph"]

_CITED = re.compile(r"\[(\w+(?:, \w+)*)\]")
"""Keys of references in a sentence."""


class Paragraph(NamedTuple):
    """Sentences with numbers of references, ``[1, 2]``, and the references in the order of their numbers."""

    text: str
    references: tuple[str, ...]

    def __str__(self) -> str:
        numbered = (f"[{number}] {reference}." for number, reference in enumerate(self.references, start=1))
        return "\n".join([self.text, "", *numbered])


def methods_paragraph(pipeline: Pipeline, result: Result) -> Paragraph:
    """How the test was measured, of the first variant; stages without a sentence are left out."""
    known = dict(REFERENCES)
    numbers: dict[str, int] = {}
    sentences = [_opening(pipeline, result)]
    for stage in result.stages:
        node = result.node(stage)
        module = vars(sys.modules[type(node).__module__])
        if "sentence" in module:
            known |= module.get("REFERENCES", {})
            sentences.append(module["sentence"](node, _last_product(result, stage)))
    text = _CITED.sub(lambda found: _numbered(found, known, numbers), " ".join(sentences))
    return Paragraph(text, tuple(known[key] for key in numbers))


def _numbered(found: re.Match[str], known: Mapping[str, str], numbers: dict[str, int]) -> str:
    """A citation by numbers, given out in the order of the text; brackets that cite nothing stay."""
    keys = found[1].split(", ")
    if not all(key in known for key in keys):
        return found[0]
    cited = [numbers.setdefault(key, len(numbers) + 1) for key in keys]
    return f"[{', '.join(map(str, sorted(cited)))}]"


def _last_product(result: Result, stage: str) -> Product | None:
    """The product of the last step that the store holds; None without any."""
    for step in reversed(result.steps(stage) or (None,)):
        if result.has(stage, step):
            with suppress(NotKeptError):
                return result.product(stage, step)
    return None


def _opening(pipeline: Pipeline, result: Result) -> str:
    """What was measured, by which method, and what the user states of specimen and cameras."""
    if not result.stages_of("images"):
        return f"Curves of stress and stretch were evaluated with dicflow {__version__}."
    what = "Displacement and strain" if result.stages_of("total") else "The shape of the surface"
    two = "stereo " if result.stages_of("rig") and not result.stages_of("plane") else ""
    steps = max((len(result.steps(result.source(stage, "images"))) for stage in result.stages_of("region")), default=0)
    at = f" at {steps} steps" if steps > 1 else ""
    were = "were" if result.stages_of("total") else "was"
    text = f"{what} {were} measured{at} by {two}digital image correlation with dicflow {__version__}."
    stated = "; ".join(_stated(pipeline))
    return text + (f" {stated[:1].upper()}{stated[1:]}." if stated else "")


def _stated(pipeline: Pipeline) -> Iterator[str]:
    facts = pipeline.facts
    for name, text in (
        ("specimen", facts.specimen),
        ("material", facts.material),
        ("pattern", facts.pattern),
        ("cameras", facts.camera),
        ("lenses", facts.lens),
        ("lighting", facts.light),
    ):
        if text is not None:
            yield f"{name}: {text.rstrip('.')}"
