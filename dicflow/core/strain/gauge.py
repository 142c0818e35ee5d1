"""The virtual strain gauge: the part of a photograph that enters one strain value."""

__all__ = ["vsg_px"]


def vsg_px(window_points: int, step_size: float, subset_size: float) -> float:
    """Side of the virtual strain gauge: the square of the photograph that enters one strain value [px].

    (window_points − 1) · step_size + subset_size, after the Good Practices Guide of the iDICs (2018).

    >>> vsg_px(5, 7.0, 21)
    49.0
    """
    return (window_points - 1) * step_size + subset_size
