"""Stages, one file each: a node with its parameters, what it takes, what it gives, and ``run``.

A module ``name.py`` here defines the stage ``name`` as the first public class it lists in ``__all__``;
nothing else names it. Another package adds a stage as an entry point of the group ``dicflow.stages``.
"""
