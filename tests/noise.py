"""Errors of points as overlapping subsets make them: a kernel over white noise on the photograph's pixels."""

from __future__ import annotations

import numpy as np


def subset_kernel(size, shape_function="affine", normalised=True):
    """Weights (size, size) by which a subset's centre averages the errors of its pixels; for variance 1 or sum 1."""
    x = np.arange(size) - (size - 1) / 2
    xx, yy = np.meshgrid(x, x)
    terms = np.stack([np.ones_like(xx), xx, yy, xx**2, xx * yy, yy**2][: 3 if shape_function == "affine" else 6])
    design = terms.reshape(len(terms), -1).T
    kernel = np.linalg.pinv(design)[0].reshape(size, size)
    return kernel / np.sqrt((kernel**2).sum()) if normalised else kernel


def point_errors(rng, shape, covariance, subset_size, step_size, shape_function="affine"):
    """One realisation of errors (row, col, d) with a covariance (d, d) at every point."""
    from scipy.signal import fftconvolve

    pixels = [(n - 1) * step_size + subset_size for n in shape]
    kernel = subset_kernel(subset_size, shape_function)
    root = np.linalg.cholesky(covariance + 1e-30 * np.eye(len(covariance)))
    fields = [
        fftconvolve(rng.normal(size=pixels), kernel, mode="valid")[::step_size, ::step_size] for _ in range(len(root))
    ]
    return np.stack(fields, axis=-1) @ root.T
