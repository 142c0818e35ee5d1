"""What differs between two measurements: their settings, and their fields step by step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.comparison.sides import Field, Side
from dicflow.discovery import nearest
from dicflow.engine.keys import Change, differences
from dicflow.errors import ConfigurationError
from dicflow.kinds.quantities import BASIC

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.uncertainty.agreement import Agreement

__all__ = ["Comparison", "Difference", "changes_of", "compare"]

_SAME_PLACE_PX = 1e-6


class Difference(NamedTuple):
    """One quantity at one step, A − B.

    title : the measure
    places : (..., 2) px of the left photograph at the first step
    values : (...), NaN where one of them is unknown
    """

    step: str
    quantity: str
    title: str
    unit: str
    places: np.ndarray
    values: np.ndarray
    agreement: Agreement


class Comparison(NamedTuple):
    """What differs between A and B.

    changes : of the settings, from A to B; None where one of them is a table
    notes : whole sentences about what limits the comparison
    """

    a: str
    b: str
    changes: tuple[Change, ...] | None
    differences: tuple[Difference, ...]
    notes: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Whether a setting or a value differs, or a point is known to one of them alone."""
        found = [one.agreement for one in self.differences]
        return bool(self.changes) or any(one.largest != 0.0 or one.share < 1.0 for one in found)

    def to_json(self) -> dict[str, Any]:
        """All but the fields as JSON; an unknown value is null."""
        return {
            "a": self.a,
            "b": self.b,
            "differs": self.differs,
            "settings": None if self.changes is None else [change.text for change in self.changes],
            "notes": list(self.notes),
            "differences": [
                {"step": one.step, "quantity": one.quantity, "unit": one.unit, **_finite(one.agreement)}
                for one in self.differences
            ],
        }


def compare(a: Side, b: Side, steps: Sequence[str] = (), quantities: Sequence[str] = ()) -> Comparison:
    """The differences A − B at the points of the coarser grid; the finer one is interpolated there.

    steps : default those that both have by name; for a table, which has none, the last of the other
    quantities : default those of U, V, W, exx, eyy, gxy that both have
    Raises ConfigurationError that lists the common steps or quantities if a selected one is not among them.
    """
    found: list[Difference] = []
    chosen = _steps(a, b, steps)
    is_guess = not steps and bool(a.steps) != bool(b.steps)
    notes = dict.fromkeys([*a.notes, *b.notes])
    if is_guess:
        notes[f"A table has no steps; it is compared with the last one, {chosen[-1]}."] = None
    for step in chosen:
        one, other = a.field(step), b.field(step)
        names = _quantities(one, other, quantities)
        found += list(_differences(step, one, other, names))
        notes |= dict.fromkeys(_notes(one, other, names))
    return Comparison(a.label, b.label, changes_of(a.settings, b.settings), tuple(found), tuple(notes))


def _steps(a: Side, b: Side, selected: Sequence[str]) -> tuple[str, ...]:
    if not (a.steps and b.steps):
        known = a.steps or b.steps or tuple(selected) or ("",)
        chosen = tuple(selected) or known[-1:]
    else:
        known = tuple(step for step in a.steps if step in b.steps)
        chosen = tuple(selected) or known
    if not chosen:
        raise ConfigurationError(
            f"no step has the same name in both: {a.label} has {_listed(a.steps)}, {b.label} has {_listed(b.steps)}; "
            "compare measurements of the same photographs"
        )
    for step in chosen:
        if step not in known:
            raise ConfigurationError(f"no step '{step}'{nearest(step, known)} in both; both have {_listed(known)}")
    return chosen


def _quantities(a: Field, b: Field, selected: Sequence[str]) -> tuple[str, ...]:
    """Those in both, in one unit."""
    common = [name for name in a.values if name in b.values and _one_unit(a, b, name)]
    for name in selected:
        if name not in common:
            raise ConfigurationError(
                f"no quantity '{name}'{nearest(name, common)} in both; both have {_listed(common)}"
            )
    chosen = tuple(selected) or tuple(name for name in BASIC if name in common)
    if not chosen:
        raise ConfigurationError(
            f"nothing can be compared: one has {_listed(tuple(a.values))}, the other {_listed(tuple(b.values))}, "
            "and none of it in one unit; compare two measurements in mm, or two in px"
        )
    return chosen


def _differences(step: str, a: Field, b: Field, names: Sequence[str]) -> Iterator[Difference]:
    import numpy as np

    from dicflow.core.uncertainty.agreement import agreement

    places, ours, theirs = _together(a, b, names)
    count = len(names)
    variances = np.nan_to_num(ours[..., count:]) ** 2 + np.nan_to_num(theirs[..., count:]) ** 2
    sigmas = np.where(variances > 0.0, np.sqrt(variances), np.nan)
    known = np.isfinite(ours[..., :count]) | np.isfinite(theirs[..., :count])
    for index, name in enumerate(names):
        values, is_known = ours[..., index] - theirs[..., index], known[..., index]
        title, unit = a.titles.get(name) or b.titles.get(name) or name, a.units.get(name) or b.units.get(name, "")
        statistics = agreement(values[is_known], sigmas[..., index][is_known])
        yield Difference(step, name, title, unit, places, values, statistics)


def _together(a: Field, b: Field, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, and the values of both there followed by their σ: (..., 2 × quantities)."""
    import numpy as np

    from dicflow.core.uncertainty.agreement import resampled

    (one, other), (ours, theirs) = (a.places, b.places), (_stacked(a, names), _stacked(b, names))
    if one.shape == other.shape:
        apart = np.abs(one - other)
        if np.isfinite(apart).any() and np.nanmax(apart) < _SAME_PLACE_PX:
            return np.where(np.isfinite(one), one, other), ours, theirs
    if _points(one) <= _points(other):
        return one, ours, resampled(other.reshape(-1, 2), theirs.reshape(-1, theirs.shape[-1]), one)
    return other, resampled(one.reshape(-1, 2), ours.reshape(-1, ours.shape[-1]), other), theirs


def _stacked(field: Field, names: Sequence[str]) -> np.ndarray:
    import numpy as np

    unknown = np.full(field.places.shape[:-1], np.nan)
    return np.stack([*(field.values[name] for name in names), *(field.sigmas.get(name, unknown) for name in names)], -1)


def _points(places: np.ndarray) -> int:
    import numpy as np

    return int(np.isfinite(places).all(axis=-1).sum())


def _one_unit(a: Field, b: Field, name: str) -> bool:
    """Whether the known units agree."""
    units = {_plain(side.units[name]) for side in (a, b) if name in side.units}
    return len(units) <= 1


def _plain(unit: str) -> str:
    return "1" if unit in ("", "-", "–", "1") else unit


def _notes(a: Field, b: Field, names: Sequence[str]) -> Iterator[str]:
    for name in names:
        titles = [side.titles.get(name) for side in (a, b)]
        if titles[0] != titles[1] and all(titles):
            yield f"{name}: A is {titles[0]}, B is {titles[1]}."
    if strains := [name for name in names if name not in "UVW" and not (name in a.titles and name in b.titles)]:
        yield f"A table does not say which measure its {', '.join(strains)} are of; a difference may come from that."
    if plain := [name for name in names if name in "UVW" and not (name in a.units and name in b.units)]:
        yield f"A table does not say the unit of its {', '.join(plain)}; that of the other side is assumed."
    have_sigma = [any(name in side.sigmas for name in names) for side in (a, b)]
    if any(have_sigma) and not all(have_sigma):
        yield f"Only {'A' if have_sigma[0] else 'B'} has a σ; the share outside uses that one alone."


def changes_of(
    a: Mapping[str, Any] | None, b: Mapping[str, Any] | None, names: tuple[str, str] = ("A", "B")
) -> tuple[Change, ...] | None:
    """Differences of the settings; a stage that only one side has is one entry. names : of the sides"""
    if a is None or b is None:
        return None
    alone = [
        Change("stage", f"stage {name} ({side[name]['stage']}) only in {owner}")
        for owner, side, other in ((names[0], a, b), (names[1], b, a))
        for name in side
        if name not in other
    ]
    common = [name for name in a if name in b]
    nothing: dict[str, Any] = {"stage": "", "impl_version": 0, "inputs": {}, "files": {}}
    old, new = ({**nothing, "parameters": {name: side[name] for name in common}} for side in (a, b))
    return (*alone, *differences(old, new))


def _finite(found: Agreement) -> dict[str, Any]:
    """Statistics as JSON values: NaN is null."""
    import math

    values = {**found._asdict(), "percentiles": list(found.percentiles)}
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in values.items()}


def _listed(names: Sequence[str]) -> str:
    return (", ".join(names) if len(names) <= 12 else f"{', '.join(names[:5])} … {names[-1]}") or "none"
