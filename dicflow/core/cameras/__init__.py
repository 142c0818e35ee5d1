"""Cameras and space: projection, epipolar geometry, rectification, triangulation, frames and rigid motions."""
