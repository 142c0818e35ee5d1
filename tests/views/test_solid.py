"""The surface in space: its mesh, and the message without pyvista."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from dicflow.engine.product import Product, Variable
from dicflow.errors import ConfigurationError, StageError
from dicflow.views.colours import look
from dicflow.views.solid import surface, surface_mesh

LOOK = look("eyy", "strain along y", "1", 0.0, 1.0)


def total(lost=()):
    row, col = np.mgrid[0.0:4.0, 0.0:5.0]
    xyz, eyy = np.stack([col, row, 400 + row], axis=-1), row / 3
    for place in lost:
        eyy[place] = np.nan
    fields = {"eyy": Variable(("row", "col"), eyy, "1"), "xyz": Variable(("row", "col", "component"), xyz, "mm")}
    return Product("total", fields, attrs={"unit": "mm"})


def test_the_mesh_has_all_points_and_quads():
    places, faces, values = surface_mesh(total(), "eyy")
    assert (len(places), len(faces)) == (20, 12)
    np.testing.assert_allclose(places[:, 1] / 3, values)
    np.testing.assert_array_equal(places[faces[0]], [[0, 0, 400], [1, 0, 400], [1, 1, 401], [0, 1, 401]])


def test_what_is_not_measured_is_a_hole():
    places, faces, values = surface_mesh(total([(1, 1)]), "eyy")
    assert (len(places), len(faces)) == (19, 8)
    assert np.isfinite(values).all()
    assert not (places[faces][..., :2] == [1, 1]).all(axis=-1).any()


def test_a_field_without_values():
    with pytest.raises(StageError, match="no point has a value of eyy"):
        surface_mesh(total([slice(None)]), "eyy")


def test_without_pyvista_the_message_has_the_command_that_installs_it(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(ConfigurationError, match=r"needs pyvista: pip install 'dicflow\[solid\]'"):
        surface(total(), LOOK, tmp_path / "surface.png")
    assert not list(tmp_path.iterdir())


def test_a_picture_is_drawn(tmp_path):
    pytest.importorskip("pyvista")
    surface(total(), LOOK, tmp_path / "surface.png")
    assert (tmp_path / "surface.png").read_bytes().startswith(b"\x89PNG")
