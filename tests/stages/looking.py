"""Stages that look at each step, run as the engine runs them."""

from dicflow.engine.looks import with_looks


def ran(stage, **inputs):
    """The product of a stage, from products of all steps."""
    return stage.run(**with_looks(stage, inputs))
