"""Strain of a surface: deformation gradient, measures, and the calibration's share in their errors.

The **reference state** is the one that deformation is measured from; the **step** is the deformed one.
"""
