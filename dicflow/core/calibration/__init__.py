"""Calibration: targets in photographs, both cameras by bundle adjustment, and how far the result can be trusted."""
