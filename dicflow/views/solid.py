"""The measured surface in space, coloured by a field; needs the extra ``dicflow[solid]``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, StageError
from dicflow.kinds.total import Total
from dicflow.views.colours import Look
from dicflow.views.lettering import font_file

__all__ = ["surface", "surface_mesh"]

_SIZE_PX = (1200, 900)


def surface(total: Product, look: Look, path: Path) -> None:
    """Write a picture (.png) of the surface at a step, seen from the left camera's side and a little from above.

    Raises ConfigurationError where pyvista is not installed, and StageError where no point is measured.
    """
    try:
        import pyvista
    except ImportError as error:
        raise ConfigurationError("a picture of the surface needs pyvista: pip install 'dicflow[solid]'") from error
    places, faces, values = surface_mesh(total, look.quantity)
    cells = np.insert(faces, 0, 4, axis=1).ravel()
    mesh = pyvista.PolyData(places, cells)
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=_SIZE_PX)
    plotter.set_background("white")
    plotter.add_mesh(mesh, scalars=values, cmap=look.table, clim=look.range, lighting=False, show_scalar_bar=False)
    plotter.add_scalar_bar(color="black", width=0.8, position_x=0.1, position_y=0.03, height=0.07)
    text = f"{look.label}\n{_extent(places, Total.read(total).unit)}"
    plotter.add_text(text, color="black", font_size=11, font_file=font_file())
    plotter.add_axes(color="black", viewport=(0.0, 0.12, 0.18, 0.36))
    plotter.camera_position = _camera(places)
    plotter.screenshot(str(path))
    plotter.close()


def surface_mesh(total: Product, quantity: str) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Points (n, 3) of the surface, the quads (m, 4) between them, and the values (n,) of a field at the points.

    Only points with a place and a value are there, and quads of four such points. Raises StageError where none is.
    """
    places, values = np.asarray(total["xyz"], dtype=float), np.asarray(total[quantity], dtype=float)
    known = np.isfinite(places).all(axis=-1) & np.isfinite(values)
    if not known.any():
        raise StageError(f"no point has a value of {quantity} at this step; look at the tracking of this step")
    number = np.cumsum(known.ravel()).reshape(known.shape) - 1
    whole = known[:-1, :-1] & known[:-1, 1:] & known[1:, 1:] & known[1:, :-1]
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    return places[known], np.stack([corner[whole] for corner in corners], axis=-1), values[known]


def _extent(places: NDArray[np.float64], unit: str) -> str:
    """Least and largest coordinates of the surface."""
    ends = zip("XYZ", places.min(axis=0), places.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.4g} to {high:.4g} {unit}" for axis, low, high in ends)


def _camera(places: NDArray[np.float64]) -> list[tuple[float, float, float]]:
    """Position, focus and up direction of the camera: Y points down and Z away from the left camera."""
    middle = (places.min(axis=0) + places.max(axis=0)) / 2.0
    away = 2.2 * float(np.linalg.norm(np.ptp(places, axis=0)))
    direction = np.array([-0.45, -0.35, -1.0])
    stand = middle + away * direction / np.linalg.norm(direction)
    return [tuple(stand.tolist()), tuple(middle.tolist()), (0.0, -1.0, 0.0)]
