"""Measured quantities against their bars, and the table of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

__all__ = ["Figure", "print_as_they_come", "print_figures"]


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


def print_figures(figures: Sequence[Figure]) -> int:
    """Print the table; returns the exit code, 1 where a bar is missed."""
    return print_as_they_come(figures, max(len(figure.quantity) for figure in figures))


def print_as_they_come(figures: Iterable[Figure], width: int) -> int:
    """Print each row of the table once it is measured; returns the exit code, 1 where a bar is missed.

    width : of the column of quantities
    """
    print(f"{'quantity':<{width}}  {'bar':>12}  {'measured':>12}")
    missed = False
    for figure in figures:
        bar = "" if figure.bar is None else f"{'≥' if figure.at_least else '≤'} {figure.bar:.4g}"
        row = f"{figure.quantity:<{width}}  {bar:>12}  {figure.measured:>12.4g} {figure.unit:<4} {figure.verdict}"
        print(row, flush=True)
        missed = missed or figure.verdict == "MISSED"
    return int(missed)
