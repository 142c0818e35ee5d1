"""Surfaces and fields on grids: local polynomials, global fits, displacement, lengths."""
