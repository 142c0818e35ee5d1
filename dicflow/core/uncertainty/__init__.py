"""Covariances: of points, of overlapping subsets, and how well two measurements agree."""
