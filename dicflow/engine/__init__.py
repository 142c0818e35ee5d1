"""Nodes, keys, store and scheduling. Knows nothing of images."""
