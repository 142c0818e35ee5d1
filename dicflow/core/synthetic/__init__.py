"""Photographs of surfaces whose every point is known in closed form.

:mod:`deformation` puts material points into space, :mod:`speckle` and :mod:`checkerboard` say how dark each material
point is, :mod:`render` photographs them through a camera, and :mod:`planar` and :mod:`motion` without one. No image is
ever interpolated: each pixel looks up the material it sees.
"""
