"""Matching without subset correlation: features, plane transforms, cross-correlation, semi-global disparity."""
