"""What tests of a material say, and what they cannot say, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from dicflow.kinds.material import FittedCurve, FittedModel

if TYPE_CHECKING:
    from dicflow.core.material.fit import Curve
    from dicflow.core.material.prediction import Guess, Spread

__all__ = ["guesses_of", "not_excluded", "simplest", "verdict"]

_LEVEL = 0.95
"""Share of tests in which a model that is right is not excluded."""
_WIDE = 0.1
"""Half the range of predictions of models that are not excluded, relative to their mean, from which it matters."""
_UNCERTAIN = 0.3
"""Half an interval of 95 %, relative to the constant, from which a constant counts as uncertain."""
_DISCUSSED = 3
"""Models whose constants are discussed."""
_CLOSE = 0.1
"""Residuals, relative to the stress, up to which an unstable model is named."""
_BADLY = 0.15
"""Error of a prediction, relative to the stress, from which the tests contradict one another."""
_MODES = {
    "uniaxial": "uniaxial tension",
    "planar": "planar tension (pure shear)",
    "equibiaxial": "equibiaxial tension",
    "biaxial": "biaxial tension",
}
_MISSING = {
    "planar": "a wide specimen between long grips, such as 60 × 60 mm or wider than high",
    "uniaxial": "a narrow strip, such as 60 × 20 mm",
    "equibiaxial": "an equibiaxial test, such as a balloon",
}


def verdict(
    fitted: Sequence[FittedModel],
    curves: Sequence[FittedCurve],
    refused: Mapping[str, str],
    points: Sequence[Curve],
) -> tuple[list[str], list[str]]:
    """Sentences about the best model and about what the tests cannot tell, and those of them that warn.

    fitted : the best first
    """
    best, alike = fitted[0], not_excluded(fitted)
    found = [(_best(best, curves), False)]
    found += [(text, True) for text in _unstable(fitted, best)]
    found += [(text, True) for text in _ambiguous_modes(alike, curves, points)]
    found += [(text, best is model) for model in alike[:_DISCUSSED] for text in _ambiguous_constants(model)]
    found += _predictions(fitted, curves)
    found += [(text, True) for text in _misfit(best)]
    found += [(text, False) for text in _common(curves)]
    found += [(f"{name} was not fitted: {reason}.", True) for name, reason in refused.items()]
    return [text for text, _ in found], [text.rstrip(".") for text, warns in found if warns]


def simplest(refused: Mapping[str, str]) -> str:
    """Why the model with the fewest constants was not fitted. refused : name of a model → why it was not"""
    from dicflow.core.material.models import MODELS

    name = min(refused, key=lambda one: len(MODELS[one].constants))
    return f"not even {name}: {refused[name]}" if len(refused) > 1 else f"{name}: {refused[name]}"


def not_excluded(fitted: Sequence[FittedModel]) -> list[FittedModel]:
    """The best model, and those stable ones whose residuals do not exclude them (5 % level).

    Residuals may be as large as the uncertainty of the points explains (χ²). Where that is unknown, or explains those
    of no model, they may be as large as the scatter about the model with the least variance explains (F).
    """
    from scipy.stats import chi2, f

    variances = _variances(fitted)
    least = min(range(len(fitted)), key=variances.__getitem__)
    found = []
    for model, variance in zip(fitted, variances, strict=True):
        most = variances[least] * float(f.ppf(_LEVEL, model.freedom, fitted[least].freedom))
        if _is_known(fitted):
            most = max(most, float(chi2.ppf(_LEVEL, model.freedom)) / model.freedom)
        if model is fitted[0] or (variance <= most and not model.unstable):
            found.append(model)
    return found


def _is_known(fitted: Sequence[FittedModel]) -> bool:
    """Whether the uncertainty of the points is known."""
    return all(model.misfit_ratio is not None for model in fitted)


def _variances(fitted: Sequence[FittedModel]) -> list[float]:
    """Mean square of the residuals per degree of freedom: in units of u², or else of the squared stress."""
    if _is_known(fitted):
        return [float(model.misfit_ratio or 0.0) for model in fitted]
    return [model.rms_all**2 * (1.0 + len(model.constants) / model.freedom) for model in fitted]


def _best(best: FittedModel, curves: Sequence[FittedCurve]) -> str:
    names = ", ".join(f"{curve.name} ({curve.mode}, {curve.points} points)" for curve in curves)
    modulus, half = best.shear_modulus
    return (
        f"{best.title} describes {names} best: residuals of {_percent(best.rms_all)} (rms), initial shear modulus "
        f"{modulus:.4g} ± {half:.2g} MPa."
    )


def _unstable(fitted: Sequence[FittedModel], best: FittedModel) -> Iterator[str]:
    for model in fitted:
        if model.unstable and (model is best or model.rms_all <= _CLOSE):
            where = ", ".join(f"{_MODES[mode]} from stretch {stretch:.2f}" for mode, stretch in model.unstable.items())
            yield f"{model.title} with these constants is unstable in {where}; do not compute with it there."


def _ambiguous_modes(
    alike: Sequence[FittedModel], curves: Sequence[FittedCurve], points: Sequence[Curve]
) -> Iterator[str]:
    """How far models that are not excluded differ by mode, and the tests that would tell."""
    from dicflow.core.material.prediction import spread_of

    measured, spreads = {curve.mode for curve in curves}, spread_of(guesses_of(alike), points)
    wide = [one for one in spreads if one.percent > 100.0 * _WIDE]
    names = ", ".join(model.title for model in alike)
    if wide:
        where = " and ".join(_spread(one) for one in wide)
        missing = [_MISSING[one.mode] for one in wide if one.mode not in measured]
        advice = f"; add {' or '.join(missing)}" if missing else ""
        which = f"Models that fit alike ({names})" if len(alike) > 1 else f"Constants of {names} that fit alike"
        yield f"{which} predict stresses that differ by {where}: these tests cannot tell which holds there{advice}."
    elif len(measured) == 1 and "biaxial" not in measured:
        mode = next(iter(measured))
        other = "planar" if mode != "planar" else "uniaxial"
        yield (
            f"All tests are in {_MODES[mode]}: no prediction of another mode could be checked; add {_MISSING[other]}."
        )
    elif len(curves) == 1:
        yield f"There is one test, {curves[0].name}: no prediction could be checked; add a specimen of another shape."


def _spread(one: Spread) -> str:
    return f"±{_percent(one.percent / 100.0)} in {_MODES[one.mode]} at {one.stretch:.2f}"


def guesses_of(models: Sequence[FittedModel]) -> list[Guess]:
    """All constants of some models that fit, those of the best minimum with their covariance."""
    import numpy as np

    from dicflow.core.material.models import MODELS
    from dicflow.core.material.prediction import Guess

    found = []
    for model in models:
        zero = np.zeros((len(model.constants),) * 2)
        found.append(Guess(MODELS[model.name], np.array(model.values), np.array(model.covariance)))
        found += [Guess(MODELS[model.name], np.array(c), zero) for c in model.others]
    return found


def _ambiguous_constants(model: FittedModel) -> Iterator[str]:
    """Constants that the tests do not determine."""
    uncertain = {one.name for one in model.constants if one.half_width > _UNCERTAIN * abs(one.value)}
    if pairs := [pair for pair in model.unsure if uncertain & set(pair[:2])]:
        one, other, rho = pairs[0]
        correlation = f"{rho:+.2f}".replace("-", "−")
        yield f"{model.title}: these tests cannot tell {one} from {other} (correlation {correlation})."
    if limits := [one.name for one in model.constants if one.at_limit]:
        yield f"{model.title}: the tests do not need {', '.join(limits)}, which stopped at a limit of the search."
    if unsure := [one.name for one in model.constants if not one.at_limit and not one.is_certain]:
        yield f"{model.title}: the interval of 95 % of {' and '.join(unsure)} contains 0."
    if model.others:
        count = len(model.others)
        fit = "1 other set of constants fits" if count == 1 else f"{count} other sets of constants fit"
        yield f"{model.title}: {fit} as well within the scatter."


def _predictions(fitted: Sequence[FittedModel], curves: Sequence[FittedCurve]) -> Iterator[tuple[str, bool]]:
    """How well each test is predicted by the others, and whether it contradicts them."""
    for index, curve in enumerate(curves):
        known = [(error, model.title) for model in fitted if (error := model.left_out[index]) is not None]
        if not known:
            continue
        (error, title), (worst, bad) = min(known), max(known)
        text = f"Left out, {curve.name} ({curve.mode}) is predicted"
        if error >= _BADLY:
            reason = "look at its mode, section, first length and slack"
            yield f"{text} badly by every model, within {_percent(error)} at best ({title}): {reason}.", True
        else:
            others = f", and within {_percent(worst)} by {bad}" if bad != title else ""
            yield f"{text} within {_percent(error)} by {title}{others}.", False


def _misfit(best: FittedModel) -> Iterator[str]:
    if best.misfit_ratio is not None and best.scatter:
        yield (
            f"Points scatter about {best.title} by {_percent(best.scatter)} of the stress beyond their uncertainty: "
            "the specimens differ, or the material is not such a model; the intervals contain this scatter."
        )


def _common(curves: Sequence[FittedCurve]) -> Iterator[str]:
    if largest := max(curve.common for curve in curves):
        yield (
            f"Up to {_percent(largest)} of every stress is a common uncertainty of section and load (68 %): it scales "
            "the constants in MPa and is part of their intervals, but not of the scatter about the curve."
        )


def _percent(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.1f} %" if percent < 10.0 else f"{percent:.0f} %" if percent < 1000.0 else "more than 1000 %"
