"""Measured quantities against their bars, and the table of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

__all__ = ["Figure", "print_figures"]

WIDTH = 64
"""Columns for the name of a quantity."""


class Figure(NamedTuple):
    """One measured quantity against its bar; a bar of None is only reported."""

    quantity: str
    measured: float
    bar: float | None = None
    at_least: bool = False
    unit: str = ""

    @property
    def verdict(self) -> str:
        if self.bar is None:
            return ""
        met = self.measured >= self.bar if self.at_least else self.measured <= self.bar
        return "ok" if met else "MISSED"


def print_figures(figures: Iterable[Figure]) -> int:
    """Print each figure as it comes, and once more those that miss their bar; returns 1 where there are any, else 0."""
    print(f"{'quantity':<{WIDTH}}  {'bar':>12}  {'measured':>12}", flush=True)
    missed = []
    for figure in figures:
        print(_row(figure), flush=True)
        missed += [figure] if figure.verdict == "MISSED" else []
    if missed:
        print("\nmissed:", *map(_row, missed), sep="\n", flush=True)
    return int(bool(missed))


def _row(figure: Figure) -> str:
    bar = "" if figure.bar is None else f"{'≥' if figure.at_least else '≤'} {figure.bar:.4g}"
    return f"{figure.quantity:<{WIDTH}}  {bar:>12}  {figure.measured:>12.4g} {figure.unit:<4} {figure.verdict}".rstrip()
