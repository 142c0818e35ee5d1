"""Subset correlation: shape functions, ZNSSD, Gauss-Newton, start values, and points followed from step to step."""
