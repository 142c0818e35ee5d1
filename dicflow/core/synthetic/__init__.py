"""Synthetic photographs with exact truth: every point of the surface is known in closed form.

:mod:`deformation` gives the positions of material points in space, :mod:`speckle` and :mod:`checkerboard` their
darkness; :mod:`render` renders photographs through a camera, :mod:`planar` and :mod:`motion` flat images. Images are
never interpolated: each pixel integrates the pattern of the material that it shows.
"""
