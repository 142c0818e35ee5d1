"""Fields of errors at several steps: how much of them is common to the steps, and how much to neighbouring points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array

__all__ = ["common_share", "half_width", "smooth_part", "without_outliers"]

_DEGREE = 5
_MIDDLE = (15.865, 84.135)
"""Percentiles within one standard deviation of a Gaussian distribution."""
_OUTLIER = 4.0


def half_width(values: ArrayLike) -> float:
    """Half the width of the middle 68 % of values (...): their standard deviation if they are Gaussian."""
    low, high = np.percentile(np.asarray(values, dtype=np.float64), _MIDDLE)
    return float(high - low) / 2.0


def without_outliers(fields: ArrayLike) -> Array:
    """Fields (step, point) about the median of each step, cut off at four times their half width."""
    values = np.asarray(fields, dtype=np.float64)
    centred = values - np.median(values, axis=1, keepdims=True)
    limits = np.array([[_OUTLIER * half_width(one)] for one in values])
    return np.clip(centred, -limits, limits)


def common_share(fields: ArrayLike) -> float:
    """Share of the variance over the points that is one field for all steps, from the covariances between steps.

    fields : (step, point), two steps or more
    Noise of the first photographs alone, which every displacement contains, gives about a half.
    """
    covariance = np.cov(np.asarray(fields, dtype=np.float64), bias=True)
    between = covariance[~np.eye(len(covariance), dtype=bool)]
    return float(between.mean() / np.diagonal(covariance).mean())


def smooth_part(fields: ArrayLike, places: ArrayLike) -> Array:
    """The part (step, point) of fields that changes slowly over the points: a polynomial of degree 5.

    fields : (step, point); places : (point, 2), in any unit
    """
    centred = np.asarray(places, dtype=np.float64)
    centred = centred - centred.mean(axis=0)
    x, y = (centred / np.abs(centred).max(axis=0).clip(1e-12)).T
    design = np.stack([x**i * y**j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)], axis=-1)
    values = np.asarray(fields, dtype=np.float64)
    return np.asarray((design @ np.linalg.lstsq(design, values.T, rcond=None)[0]).T)
