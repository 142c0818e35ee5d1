"""Logs in the shapes in which three sorts of machines write them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["START", "balance_log", "logger_log", "machine_log"]


START = 1_773_310_500.0
"""The quarter past ten on 12 March 2026 from which dated logs count [s since 1970]."""


def machine_log(seconds: Sequence[float], newtons: Sequence[float], mm: Sequence[float]) -> bytes:
    """A testing machine's export: a block of facts, names, a line of units, quotes, thousands parted."""
    facts = [
        '"Test method","Tension_rubber.im_tens"',
        '"Specimen label","latex 3"',
        '"Rate 1","50.00000","mm/min"',
        '"Preload","0.50","N"',
        "",
        '"Results Table 1"',
        '"","Maximum Load","Modulus"',
        '"1","12.51","0.84"',
        "",
        '"Time","Extension","Load"',
        '"(s)","(mm)","(N)"',
    ]
    rows = [f'"{t:,.3f}","{x:,.5f}","{f:,.5f}"' for t, x, f in zip(seconds, mm, newtons, strict=True)]
    return "\r\n".join([*facts, *rows, ""]).encode("utf-8")


def balance_log(seconds: Sequence[float], grams: Sequence[float]) -> bytes:
    """A balance's serial lines as a terminal keeps them: date, time, two letters of status, a number and its unit."""
    rows = [
        f"2026-03-12 {_time_of_day(t)}  S {'S' if k % 7 else 'D'} {_sign(g)}{abs(g):12.2f} g"
        for k, (t, g) in enumerate(zip(seconds, grams, strict=True))
    ]
    return "\n".join([*rows, ""]).encode("ascii")


def logger_log(seconds: Sequence[float], celsius: Sequence[float], kilonewtons: Sequence[float]) -> bytes:
    """A data logger's file in a German Windows: cp1252, semicolons, decimal commas, date and time in two columns."""
    facts = ["Gerät:;Datenlogger 4K", "Messrate:;10;Hz", "", "Datum;Uhrzeit;Temperatur in °C;Kraft in kN;Bemerkung"]
    rows = [
        f"12.03.2026;{_time_of_day(t).replace('.', ',')};{c:.2f};{f:.6f};".replace(".2026", "·").replace(".", ",")
        for t, c, f in zip(seconds, celsius, kilonewtons, strict=True)
    ]
    rows = [row.replace("12,03·", "12.03.2026") for row in rows]
    return "\r\n".join([*facts, *rows, ""]).encode("cp1252")


def _time_of_day(seconds: float) -> str:
    """Time of day that many seconds after a quarter past ten."""
    whole = int(np.floor(round(seconds * 1000) / 1000))
    clock = 10 * 3600 + 15 * 60 + whole
    return f"{clock // 3600:02d}:{clock // 60 % 60:02d}:{clock % 60:02d}.{round((seconds - whole) * 1000):03d}"


def _sign(value: float) -> str:
    return "-" if value < 0 else "+"
