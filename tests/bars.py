"""Measured quantities against their bars, and the table of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

__all__ = ["Figure", "print_figures"]

_WIDTH = 72
"""Of the names of quantities."""


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
    """Print the table, each line as soon as it is measured; returns the exit code, 1 where a bar is missed."""
    print(f"{'quantity':<{_WIDTH}}  {'bar':>12}  {'measured':>12}", flush=True)
    code = 0
    for figure in figures:
        bar = "" if figure.bar is None else f"{'≥' if figure.at_least else '≤'} {figure.bar:.4g}"
        line = f"{figure.quantity:<{_WIDTH}}  {bar:>12}  {figure.measured:>12.4g} {figure.unit:<4} {figure.verdict}"
        print(line.rstrip(), flush=True)
        code |= figure.verdict == "MISSED"
    return int(code)
