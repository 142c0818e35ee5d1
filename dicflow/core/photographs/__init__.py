"""Photographs: grey levels, texture, noise, splines between pixels, regions."""
