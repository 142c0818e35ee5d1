"""Values of known points, the status of points after a fit, and what its codes mean."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

__all__ = ["STATUS_NAME", "fitted_status", "known_or_nan", "status_attributes", "status_legend"]

STATUS_NAME = "status"
"""Name of the arrays that hold the status of points."""


def status_attributes() -> dict[str, Any]:
    """``flag_values`` and ``flag_meanings`` of a status, as the conventions for climate and forecast data have them."""
    import numpy as np

    from dicflow.core.status import Status

    meanings = " ".join(code.label.replace(" ", "_") for code in Status)
    return {"flag_values": np.array([*Status], dtype=np.uint8), "flag_meanings": meanings}


def status_legend() -> str:
    """The codes in words: ``0 valid, 1 filled, …``."""
    from dicflow.core.status import Status

    return ", ".join(f"{code:d} {code.label}" for code in Status)


def known_or_nan(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The values where they are known, NaN elsewhere.

    known : (row, col) bool; values : (row, col, …)
    """
    import numpy as np

    return np.where(known.reshape(known.shape + (1,) * (values.ndim - 2)), values, np.nan)


def fitted_status(
    measured: np.ndarray, fitted: np.ndarray, status: np.ndarray, window: tuple[int, int], degree: int
) -> np.ndarray:
    """Status of the points after a fit of local polynomials.

    measured, fitted : (row, col) bool — points with a value, and points whose window holds enough of them
    status : (row, col) — before the fit
    Raises StageError where no measured point could be fitted.
    """
    import numpy as np

    from dicflow.core.status import Status

    if measured.any() and not (measured & fitted).any():
        raise StageError(
            f"no window of {window[0]} × {window[1]} points holds enough measured points for degree {degree}; "
            "widen the window or lower the degree"
        )
    return np.where(measured & ~fitted, np.uint8(Status.TOO_FEW_NEIGHBOURS), status)
