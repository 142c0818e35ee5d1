"""Short names of the variants of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["last_name", "short_value", "variant_labels", "variant_names"]


def variant_labels(values: Sequence[Mapping[str, Any]]) -> list[str]:
    """A short label per variant, one line per swept value; parameters by their last name."""
    return ["\n".join(f"{last_name(key)} {short_value(value)}" for key, value in row.items()) for row in values]


def variant_names(values: Sequence[Mapping[str, Any]]) -> list[str]:
    """The labels in one line each."""
    return [label.replace("\n", ", ") for label in variant_labels(values)]


def last_name(parameter: str) -> str:
    """The parameter behind its stage."""
    return parameter.rpartition(".")[2]


def short_value(value: Any) -> str:
    """A swept value in a few letters."""
    if isinstance(value, dict):
        return " ".join(f"{key}{short_value(inner)}" for key, inner in value.items())
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)
