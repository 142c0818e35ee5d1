"""Scalars of the products of all steps, read in parts that are kept from one page to the next."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from dicflow.kinds.kind import summary_of
from dicflow.pipeline import Result
from dicflow.report.context import Context

__all__ = ["step_summaries"]

_AT_ONCE = 100
"""Steps of a part."""


def step_summaries(context: Context, stage: str) -> dict[str, Mapping[str, Any]]:
    """Step → scalars of its product, for the steps of a stage that the store holds."""
    result = context.result
    steps = [step for step in result.steps(stage) if result.has(stage, step)]
    found: dict[str, Mapping[str, Any]] = {}
    for start in range(0, len(steps), _AT_ONCE):
        part = steps[start : start + _AT_ONCE]
        sources = ["summaries", *(result.digest(stage, step) for step in part)]
        made = context.pieces.get(sources, partial(_read, result, stage, part))
        found |= dict(zip(part, json.loads(made), strict=True))
    return found


def _read(result: Result, stage: str, steps: Sequence[str]) -> bytes:
    return json.dumps([dict(summary_of(result.product(stage, step))) for step in steps]).encode()
