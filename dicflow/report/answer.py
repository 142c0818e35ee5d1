"""The opening of the page: a verdict in one line, the largest field, and the curve beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import Markup

from dicflow.explorer.manifest import Manifest
from dicflow.explorer.pack import Packed
from dicflow.explorer.page import fragment
from dicflow.report.context import Context, Section
from dicflow.report.main_fields import main_fields
from dicflow.report.rendering import render
from dicflow.report.step_summaries import step_summaries
from dicflow.report.words import least_percent, number

__all__ = ["Seen", "Verdict", "answer", "verdict"]

_FEW = 0.9


class Verdict(NamedTuple):
    """What was measured, in one line.

    tone : "good"; "warning" if something must be looked at first; "error" if steps are missing
    head : one or two words
    text : a sentence
    """

    tone: str
    head: str
    text: str


class Seen(NamedTuple):
    """Number of steps, how many of them were measured, and the least share of points with a value."""

    steps: int
    measured: int
    least: float


def answer(context: Context, found: Packed | None, sections: Sequence[Section]) -> Section | None:
    """The section, None for a pipeline whose points have no place.

    found : the fields of the result, None without any
    sections : all others, whose warnings the verdict counts
    """
    if found is None:
        return None
    warnings = sum(len(section.warnings) for section in sections)
    line = verdict(found.manifest, _seen(context, found.manifest), warnings, _failures(context))
    body = render(
        "answer.html",
        verdict=line,
        meaning=" ".join(found.manifest["meaning"]),
        explorer=Markup(fragment(found)),
        fields=main_fields(context, found.manifest),
    )
    return Section("answer", "Result", body)


def _seen(context: Context, manifest: Manifest) -> Seen:
    """What is known of the steps, also of those that the page does not show."""
    stage, shown = manifest["stage"], {step["name"]: step["valid"] for step in manifest["steps"]}
    steps = context.result.steps(stage)
    hidden = len(shown) < len(steps)
    summaries = step_summaries(context, stage) if hidden else {}
    shares = [*shown.values(), *(one.get("valid_share") for step, one in summaries.items() if step not in shown)]
    measured = sum(context.result.has(stage, step) for step in steps)
    return Seen(len(steps), measured, min((share for share in shares if share is not None), default=0.0))


def verdict(manifest: Manifest, seen: Seen, warnings: int, failures: int) -> Verdict:
    """The verdict on a result.

    warnings, failures : how many warnings there are, and how many tasks failed
    """
    count, measured, least = seen
    steps = f"{measured} of {count} steps" if count > 1 else "the surface"
    valid = "all points have a value" if least == 1.0 else f"{_floor(least, measured)} of the points have a value"
    remark = {0: "", 1: " One warning is below."}.get(warnings, f" {warnings} warnings are below.")
    text = f"{_peak(manifest)}; {steps} measured, {valid}.{remark}"
    if failures or measured < count:
        return Verdict("error", "Incomplete", text)
    if least < _FEW or warnings:
        return Verdict("warning", "Measured, with warnings" if warnings else "Measured, with gaps", text)
    return Verdict("good", "Measured", text)


def _floor(share: float, steps: int) -> str:
    """A share below one, rounded downwards; of several steps the least."""
    return ("at least " if steps > 1 else "") + least_percent(share)


def _peak(manifest: Manifest) -> str:
    """The largest mean of the main quantity, or the range of the depth."""
    name, place = manifest["main"]
    quantity = next(one for one in manifest["quantities"] if one["name"] == name)
    unit = "" if quantity["unit"] == "1" else f" {quantity['unit']}"
    if manifest["form"] == "shape":
        low, high = (number(value) for value in quantity["range"])
        return f"{quantity['symbol']} from {low} to {high}{unit}"
    mean, spread = quantity["means"][place] or (math.nan, math.nan)
    step = manifest["steps"][place]
    return f"mean {quantity['symbol']} {number(mean)}{unit} (spread {number(spread)}) at {step['name']}"


def _failures(context: Context) -> int:
    return 0 if context.run is None else context.run.counts["failed"]
