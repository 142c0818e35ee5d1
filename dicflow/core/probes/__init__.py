"""Probes: extensometers, points, lines and areas on a measured field."""
