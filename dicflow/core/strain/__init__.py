"""Strain of a surface: deformation gradient, measures, and the calibration's share in their errors."""
