"""Stages, one file each: a node with its parameters, what it takes, what it gives, and ``run``.

A module ``name.py`` here defines the stage ``name`` as the one public class it lists in ``__all__``;
nothing else needs to be told of it.
"""
