"""Resolution and noise of correlated subsets on stars, and how well they trade: `make accuracy`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.photographs.interpolate import spline
from tests.bars import Figure
from tests.data_folder import SHARED
from tests.figures import WORK
from tests.stars import (
    AMPLITUDE_PX,
    COARSE,
    NOISE,
    STRAIN,
    WIDTH,
    Images,
    Setting,
    columns,
    gradient_noise,
    middle_row,
    middle_strain,
    regenerated,
    resolution,
    theoretical_transfer,
    transfer_of_pattern,
)

PATTERNS = 10
STRAIN_PATTERNS = 4
COARSE_PATTERNS = 6
SUBSETS = [Setting("affine", size) for size in (9, 13, 17, 21, 25, 29, 33)]
SUBSETS += [Setting("quadratic", size) for size in (17, 21, 25, 29, 33)]
GAUGES = [Setting("affine", size) for size in (17, 25, 33)] + [Setting("quadratic", 25)]
GAUGES += [Setting("affine", 17, 5), Setting("quadratic", 17, 3, 2), Setting("quadratic", 17, 5)]
GAUGES += [Setting("quadratic", 25, 3, 3), Setting("quadratic", 33, 3), Setting("quadratic", 41, 3)]
GAUGES += [Setting("quadratic", 17, 5, 6, 3), Setting("quadratic", 21, 5, 8, 3)]
GAUGES += [Setting("quadratic", size, 7, step, 5) for size, step in ((13, 6), (17, 8), (21, 8))]
CHALLENGE_MARGIN = 10
"""Columns beside the challenge's region of interest [px]."""
LARGE = 17
"""Side of subsets that always hold a few speckles, as the formula with Σg² alone takes for granted [px]."""
LISTED_L10 = {17: 21.8, 25: 32.2, 33: 42.6}
"""Of quadratic subsets, by size [px]."""
MARKS = {("affine", 1): ("o", "tab:blue"), ("quadratic", 1): ("o", "tab:red")}
MARKS |= {("quadratic", 3): ("s", "tab:orange"), ("quadratic", 5): ("D", "tab:green")}
PUBLISHED = {"displacement": {"best": 0.3555, "median": 0.553}, "strain": {"best": 1.271, "median": 4.34}}
"""Of the entries to the second challenge, on images of another contrast and noise."""


class Trade(NamedTuple):
    """What one setting resolves and how much noise it makes; l10 [px], n [px or strain].

    hessian_noise : √(2 σ² H⁻¹); gradient_noise : √2 σ/√Σg² times the norm of the subset's kernel
    """

    setting: Setting
    l10: float
    l10_scatter: float
    noise: float
    theory_l10: float = np.nan
    hessian_noise: float = np.nan
    gradient_noise: float = np.nan

    def efficiency(self, power: int) -> float:
        return self.noise * self.l10**power


class Row(NamedTuple):
    """l10 of one row [px]: measured, of the theory, of the theory for the slopes of its pattern; and measured beyond
    the region, to the ends of the photograph."""

    measured: float
    theory: float
    pattern: float
    whole: float


def stars() -> Iterator[Figure]:
    """Both kinds of stars on patterns of our own, and the challenge's first star."""
    patterns = [regenerated(seed) for seed in range(PATTERNS)]
    trades = [displacement_trade(setting, patterns) for setting in SUBSETS]
    grey = np.stack([images.reference for images in patterns]).astype(float)
    slope = np.sqrt(np.mean(np.gradient(grey, axis=2) ** 2))
    print(f"\nStars: {PATTERNS} patterns, contrast {grey.std():.1f} grey levels, slope {slope:.1f} grey levels/px rms,")
    print(f"noise {NOISE:g} grey levels and rounding to 8 bits; ± is the scatter of one row from pattern to pattern")
    print_displacement(trades)
    yield from bars(trades)
    strains = [strain_trade(setting, patterns[:STRAIN_PATTERNS]) for setting in GAUGES]
    print_strain(strains)
    yield Figure("stars: least displacement MEI (published best 0.3555)", min(t.efficiency(1) for t in trades))
    yield Figure("stars: least strain MEI (published best 1.271)", min(t.efficiency(2) for t in strains))
    draw(trades, strains, slope)
    yield from coarse_speckles()
    if SHARED.is_dir():
        yield from challenge_star({trade.setting: trade for trade in trades})


def displacement_trade(setting: Setting, patterns: list[Images]) -> Trade:
    x = columns(setting)
    stars = [middle_row(images.reference, spline(images.star), images.middle, setting) for images in patterns]
    noise = [middle_row(images.noisy[0], spline(images.noisy[1]), images.middle, setting) for images in patterns]
    transfers = [row.v / AMPLITUDE_PX for row in stars]
    return Trade(
        setting,
        resolution(x, np.nanmean(transfers, axis=0)),
        float(np.std([resolution(x, transfer) for transfer in transfers])),
        root_mean([row.v**2 for row in noise]),
        resolution(x, theoretical_transfer(setting)),
        NOISE * root_mean([row.variance for row in noise]),
        root_mean([gradient_noise(images.reference, images.middle, setting) ** 2 for images in patterns]),
    )


def root_mean(squares: list) -> float:
    return float(np.sqrt(np.nanmean(squares)))


def strain_trade(setting: Setting, patterns: list[Images]) -> Trade:
    x = columns(setting, setting.step)
    transfers = [
        middle_strain(images.reference, spline(images.strain_star), images.middle, setting) / STRAIN
        for images in patterns
    ]
    noise = [middle_strain(images.noisy[0], spline(images.noisy[1]), images.middle, setting) for images in patterns]
    scatter = float(np.std([resolution(x, transfer) for transfer in transfers]))
    return Trade(setting, resolution(x, np.nanmean(transfers, axis=0)), scatter, float(np.nanstd(noise)))


def coarse_speckles() -> Iterator[Figure]:
    """Small subsets on dots a third larger, of which they hold too few for the theory of an even pattern."""
    patterns = [regenerated(seed, COARSE) for seed in range(COARSE_PATTERNS)]
    for trade in (displacement_trade(Setting("affine", size), patterns) for size in (9, 13, 17)):
        name = f"stars of coarser speckles, affine {trade.setting.size}"
        yield Figure(f"{name}: l10 below theory", 100.0 * (1.0 - trade.l10 / trade.theory_l10), unit="%")
        yield Figure(f"{name}: n over √(2 σ² H⁻¹)", trade.noise / trade.hessian_noise)
        yield Figure(f"{name}: n over √2 σ/√Σg²", trade.noise / trade.gradient_noise)


def bars(trades: list[Trade]) -> Iterator[Figure]:
    """The largest deviations of l10 and n from theory."""
    for shape in ("affine", "quadratic"):
        off = [100.0 * abs(t.l10 / t.theory_l10 - 1.0) for t in trades if t.setting.shape_function == shape]
        yield Figure(f"stars: l10 of {shape} subsets against theory fitted alike, largest", max(off), 5.0, unit="%")
    yield from against_list("stars", {trade.setting: trade.l10 for trade in trades})
    yield Figure("stars: n over √(2 σ² H⁻¹), largest", max(t.noise / t.hessian_noise for t in trades), 1.1)
    every = max(t.noise / t.gradient_noise for t in trades)
    yield Figure("stars: n over √2 σ/√Σg², all subsets, largest", every)
    large = [t.noise / t.gradient_noise for t in trades if t.setting.size >= LARGE]
    yield Figure(f"stars: n over √2 σ/√Σg², subsets of {LARGE} px and more, largest", max(large), 1.1)


def against_list(name: str, measured: dict[Setting, float]) -> Iterator[Figure]:
    """Against 3.99 h of affine subsets of h px, and the listed resolution of quadratic ones."""
    off: dict[str, list[float]] = {"affine": [], "quadratic": []}
    for (shape, size, *_), l10 in measured.items():
        if listed := 3.99 * size if shape == "affine" else LISTED_L10.get(size):
            off[shape].append(100.0 * abs(l10 / listed - 1.0))
    for shape, words in (("affine", "3.99 × their size"), ("quadratic", "the listed")):
        yield Figure(f"{name}: l10 of {shape} subsets against {words}, largest", max(off[shape]), 5.0, unit="%")


def challenge_star(regenerated_trades: dict[Setting, Trade]) -> Iterator[Figure]:
    """The challenge's first star: one pattern, one row."""
    folder = SHARED / "challenge_2d" / "star1"
    reference, deformed = (
        cv2.imread(str(folder / f"DIC_Challenge_Wave_{kind}_NoiseFree.tif"), cv2.IMREAD_UNCHANGED)
        for kind in ("Reference", "Deformed")
    )
    target, rows = spline(deformed), {}
    print(
        "\nstar1, one row: l10 [px] measured in its region, in theory, in theory of this pattern's slopes, measured to"
    )
    print("the ends of the photograph; all fitted alike; deviation in scatters from pattern to pattern")
    for setting, trade in regenerated_trades.items():
        x, margin = columns(setting), CHALLENGE_MARGIN + setting.size // 2
        inside = (x >= margin) & (x < WIDTH - margin)
        few, transfer = x[inside][::2], middle_row(reference, target, 250, setting).v / AMPLITUDE_PX
        rows[setting] = Row(
            resolution(x[inside], transfer[inside]),
            resolution(x[inside], theoretical_transfer(setting)[inside]),
            resolution(few, transfer_of_pattern(reference, 250, setting, few)),
            resolution(x, transfer),
        )
        scatters = (rows[setting].measured - rows[setting].theory) / trade.l10_scatter
        numbers = "".join(f"{l10:9.2f}" for l10 in rows[setting])
        print(f"  {setting.shape_function:<9} {setting.size:>3}{numbers}{scatters:+7.1f}")
    yield from against_list("star1", {setting: row.measured for setting, row in rows.items()})
    for figure in against_list("star1 to the ends of the photograph", {k: row.whole for k, row in rows.items()}):
        yield figure._replace(bar=None)
    off = [100.0 * abs(row.measured / row.theory - 1.0) for row in rows.values()]
    yield Figure("star1: l10 against theory fitted alike, largest", max(off), unit="%")
    yield Figure(f"star1: settings of {len(off)} within 5 % of theory fitted alike", sum(one <= 5.0 for one in off))


def print_displacement(trades: list[Trade]) -> None:
    print(f"{'subset':<14}{'l10 px':>8}{'±':>6}{'theory':>8}{'n px':>10}{'by H⁻¹':>10}{'by Σg²':>10}{'MEI':>8}")
    for t in trades:
        name = f"{t.setting.shape_function} {t.setting.size}"
        noise = f"{t.noise:>10.5f}{t.hessian_noise:>10.5f}{t.gradient_noise:>10.5f}"
        print(f"{name:<14}{t.l10:>8.2f}{t.l10_scatter:>6.2f}{t.theory_l10:>8.2f}{noise}{t.efficiency(1):>8.4f}")
    print("  published MEI: best 0.3555, good quadratic 0.364 to 0.368, typical affine 0.54 to 0.65, median 0.553")


def print_strain(trades: list[Trade]) -> None:
    print(f"\n{'subset, points, degree':<25}{'VSG px':>7}{'l10 px':>8}{'±':>6}{'n 1e-6':>9}{'MEI':>8}")
    for t in trades:
        name = f"{t.setting.shape_function} {t.setting.size}, {t.setting.window}×{t.setting.window}, {t.setting.degree}"
        gauge = f"{name:<25}{t.setting.gauge_px:>7}"
        print(f"{gauge}{t.l10:>8.2f}{t.l10_scatter:>6.2f}{1e6 * t.noise:>9.1f}{t.efficiency(2):>8.3f}")
    print("  published MEI: best 1.271, median 4.34")


def draw(displacement: list[Trade], strain: list[Trade], slope: float) -> None:
    """Noise over resolution; lines of equal efficiency are straight on logarithmic axes."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for ax, trades, power, kind in zip(axes, (displacement, strain), (1, 2), PUBLISHED, strict=True):
        l10 = np.array([t.l10 for t in trades])
        for (shape, degree), (mark, colour) in MARKS.items():
            own = [t for t in trades if (t.setting.shape_function, t.setting.degree) == (shape, degree)]
            if own:
                label = shape + f", strain of degree {degree}" * (degree > 1)
                ax.loglog([t.l10 for t in own], [t.noise for t in own], mark, color=colour, label=label)
            for t in own:
                note = f"{t.setting.size}" + (f", {t.setting.window}²" if t.setting.window > 1 else "")
                ax.annotate(note, (t.l10, t.noise), (5, 3), textcoords="offset points", fontsize=8)
        span = np.array([0.85 * l10.min(), 1.25 * l10.max()])
        for (word, mei), style in zip(PUBLISHED[kind].items(), ("--", ":"), strict=True):
            ax.loglog(span, mei / span**power, style, color="grey", label=f"published {word}, MEI {mei}")
        ax.set(xlabel="resolution l10 [px]", ylabel=f"noise n [{'px' if power == 1 else '-'}]", title=kind)
        ax.set_xticks(ticks := [20, 30, 50, 70, 100], labels=map(str, ticks))
        ax.xaxis.set_minor_formatter("")
        ax.legend(fontsize=8)
    figure.suptitle(f"stars, noise {NOISE:g} grey levels, slope {slope:.1f} grey levels/px rms", fontsize=10)
    path = WORK / "mei.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
    print(f"  drawn in {path}")
