"""Matching without subsets: features, transforms, semi-global disparity."""
