"""Uncertainty: covariance of points, correlation by overlapping subsets, and agreement of two measurements."""
