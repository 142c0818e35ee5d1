"""What a sweep over settings found, as a picture and as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

from dicflow.tuning.caliper import Agreement
from dicflow.tuning.choice import pareto_front, strain_text
from dicflow.tuning.trials import Trial
from dicflow.tuning.tune import Tuning

__all__ = ["caliper_words", "setting_words", "shown_trials", "trial_columns", "trial_row", "tuning_figure"]

_COLOURS = {"auto": "#4d9a3a", "affine": "#3b82b5", "quadratic": "#d95f02"}
_MARKS: Mapping[str, Mapping[str, Any]] = {
    "present": {"marker": "D", "mec": "#1a1a1a", "ms": 9},
    "recommended": {"marker": "*", "mec": "#c2185b", "ms": 18},
}


def tuning_figure(tuning: Tuning) -> Figure:
    """Noise, and noise with bias, over the side of the virtual strain gauge, for all settings.

    The Pareto front of the noise is a line; the present and the recommended setting are marked.
    """
    figure = Figure(figsize=(9.6, 4.8), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    front = pareto_front(tuning.tried)
    sides, noise = _sides(front), 1e6 * np.array([trial.noise for trial in front])
    left.plot(sides, noise, color="0.35", lw=1, zorder=1, label="Pareto front")
    _marks(left, tuning, [trial.noise for trial in tuning.tried])
    _marks(right, tuning, [trial.error for trial in tuning.tried])
    for axes, title in ((left, "noise"), (right, "noise and bias together")):
        axes.set(xscale="log", yscale="log", title=title, xlabel="virtual strain gauge [px]")
        axes.grid(which="both", color="0.92")
        _plain_ticks(axes.xaxis, axes.get_xlim())
        _plain_ticks(axes.yaxis, axes.get_ylim())
        _millimetres(axes, tuning.tried)
    left.set_ylabel("εxx and εyy, root mean square [µε]")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    figure.suptitle(_title(tuning), fontsize=11)
    return figure


def _marks(axes: Axes, tuning: Tuning, heights: Sequence[float]) -> None:
    """A dot for each setting, the present and the recommended one marked. heights : strains [-]"""
    sides, values = _sides(tuning.tried), 1e6 * np.array(heights)
    for shape, colour in _COLOURS.items():
        own = np.array([trial.setting.shape_function == shape for trial in tuning.tried])
        if own.any():
            axes.plot(sides[own], values[own], "o", ms=4, alpha=0.65, mew=0, color=colour, label=f"{shape} subsets")
    for name, trial in (("present", tuning.present), ("recommended", tuning.choice.trial)):
        if trial is not None:
            place = tuning.tried.index(trial)
            label = f"{name} setting"
            axes.plot(
                sides[place], values[place], ls="none", mfc="none", mew=1.6, zorder=4, label=label, **_MARKS[name]
            )


def _sides(trials: Sequence[Trial]) -> NDArray[np.float64]:
    return np.array([trial.gauge.side_px for trial in trials])


def _plain_ticks(axis: Axis, limits: tuple[float, float]) -> None:
    """Numbers without powers of ten, at 1, 2 and 5."""
    decades = 10.0 ** np.arange(np.floor(np.log10(limits[0])), np.ceil(np.log10(limits[1])) + 1)
    ticks = np.outer(decades, [1, 2, 5]).ravel()
    axis.set_major_locator(FixedLocator([tick for tick in ticks if limits[0] <= tick <= limits[1]]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def _millimetres(axes: Axes, tried: Sequence[Trial]) -> None:
    """A second scale above, if the gauge is known in mm."""
    sizes = [trial.gauge.side_mm / trial.gauge.side_px for trial in tried if trial.gauge.side_mm is not None]
    if sizes:
        size = float(np.median(sizes))
        above = axes.secondary_xaxis("top", functions=(partial(np.multiply, size), partial(np.multiply, 1.0 / size)))
        low, high = axes.get_xlim()
        _plain_ticks(above.xaxis, (low * size, high * size))
        above.set_xlabel("[mm]", fontsize=8)
        above.tick_params(labelsize=8)


def _title(tuning: Tuning) -> str:
    kind = "predicted" if tuning.steps.still is None else f"measured at step {tuning.steps.still}"
    return f"{len(tuning.tried)} settings at step {tuning.steps.deformed}; noise {kind}"


def shown_trials(tuning: Tuning) -> list[tuple[str, Trial]]:
    """Mark and trial of those worth a line: the present setting, the Pareto front and the recommended one."""
    named = {id(tuning.present): "present", id(tuning.choice.trial): "recommended"}
    if tuning.present is not None and tuning.present is tuning.choice.trial:
        named[id(tuning.present)] = "present, recommended"
    shown = {id(trial): trial for trial in pareto_front(tuning.tried)}
    shown |= {id(trial): trial for trial in (tuning.present, tuning.choice.trial) if trial is not None}
    ordered = sorted(shown.values(), key=lambda trial: trial.gauge.side_px)
    return [(named.get(id(trial), ""), trial) for trial in ordered]


def trial_columns(tuning: Tuning) -> tuple[str, ...]:
    """Titles of a table of trials."""
    return tuple(_cells("", tuning.tried[0]))


def trial_row(mark: str, trial: Trial) -> tuple[object, ...]:
    """One trial under :func:`trial_columns`, strains in µε."""
    return tuple(_cells(mark, trial).values())


def _cells(mark: str, trial: Trial) -> dict[str, object]:
    setting = trial.setting
    return {
        "subset [px]": setting.subset_size,
        "step [px]": setting.step_size,
        "subsets": str(setting.shape_function),
        "window [px]": setting.window_points * setting.step_size,
        "VSG [px]": trial.gauge.side_px,
        **({} if trial.gauge.side_mm is None else {"VSG [mm]": trial.gauge.side_mm}),
        "predicted noise [µε]": 1e6 * trial.predicted,
        **({} if trial.measured is None else {"measured noise [µε]": 1e6 * trial.measured}),
        "bias [µε]": 1e6 * trial.bias,
        "error [µε]": 1e6 * trial.error,
        "points": trial.points,
        "mark": mark,
    }


def setting_words(trial: Trial) -> str:
    """``subset 21 px, step 5 px, affine, window 45 px``."""
    setting = trial.setting
    return (
        f"subset {setting.subset_size} px, step {setting.step_size} px, {setting.shape_function}, "
        f"window {setting.window_points * setting.step_size} px"
    )


def caliper_words(found: Agreement) -> str:
    """A line on whether the settings agree with the caliper."""
    caliper = f"{_percent(found.caliper.strain)} ± {strain_text(found.caliper.u)}"
    parts = [_against(found, name) for name in found.settings]
    return f"against the caliper, {caliper} at {found.step} ({found.what}): {'; '.join(parts) or 'nothing measured'}"


def _against(found: Agreement, name: str) -> str:
    one, off = found.settings[name], found.difference(name)
    error = f" ± {strain_text(one.u)}" if one.u else ""
    word = "agrees" if found.agrees(name) else "does not agree"
    sign = "+" if off >= 0.0 else "−"
    return f"{name} {_percent(one.strain)}{error}, {word} ({sign}{strain_text(abs(off))})"


def _percent(strain: float) -> str:
    return f"{100.0 * strain:.4g} %".replace("-", "−")
