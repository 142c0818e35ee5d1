"""Calibration: targets in photographs, both cameras by bundle adjustment, and the uncertainty of the result."""
