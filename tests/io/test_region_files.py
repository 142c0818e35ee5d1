import json
import os

import numpy as np
import pytest
from PIL import Image

from dicflow.core.photographs.region import area
from dicflow.errors import InputError
from dicflow.io.region import geojson_text, is_geojson, read_geojson, read_mask, write_geojson

pytestmark = pytest.mark.slow

SQUARE = [[0, 0], [10, 0], [10, 8], [0, 8], [0, 0]]
HOLE = [[2, 2], [4, 2], [4, 4], [2, 4], [2, 2]]
POLYGON = {"type": "Polygon", "coordinates": [SQUARE, HOLE]}


def written(path, value):
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (POLYGON, 76),
        ({"type": "Feature", "properties": {}, "geometry": POLYGON}, 76),
        ({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": POLYGON}] * 2}, 152),
        ({"type": "MultiPolygon", "coordinates": [[SQUARE], [SQUARE, HOLE]]}, 156),
        ({"type": "GeometryCollection", "geometries": [POLYGON]}, 76),
    ],
)
def test_every_nesting_of_polygons(tmp_path, value, expected):
    assert area(read_geojson(written(tmp_path / "r.geojson", value)).polygons) == expected


def test_lines_beside_polygons_are_cuts(tmp_path):
    lines = [[[1, 2], [3, 4], [5, 4]], [[0, 0, 9], [1, 1, 9]], [[7, 7], [8, 8]]]
    shapes = [
        {"type": "LineString", "coordinates": lines[0]},
        POLYGON,
        {"type": "MultiLineString", "coordinates": lines[1:]},
    ]
    path = written(tmp_path / "r.geojson", {"type": "GeometryCollection", "geometries": shapes})
    polygons, (first, second, third) = read_geojson(path)
    assert area(polygons) == 76
    np.testing.assert_array_equal(first, lines[0])
    np.testing.assert_array_equal(second, [[0, 0], [1, 1]])
    np.testing.assert_array_equal(third, lines[2])
    assert read_geojson(written(tmp_path / "none.json", POLYGON)).cuts == []
    for line in ([[1, 2]], [[1, 2], [3, "4"]], 5):
        short = {"type": "GeometryCollection", "geometries": [POLYGON, {"type": "LineString", "coordinates": line}]}
        with pytest.raises(InputError, match=r"r\.geojson: a line must be at least two points"):
            read_geojson(written(path, short))


def test_closing_points_and_heights_are_dropped(tmp_path):
    ring = [[*corner, 5.0] for corner in SQUARE]
    (polygon,) = read_geojson(written(tmp_path / "r.json", {"type": "Polygon", "coordinates": [ring]})).polygons
    np.testing.assert_array_equal(polygon.exterior, SQUARE[:-1])


def test_what_is_written_is_read(tmp_path):
    polygons = read_geojson(written(tmp_path / "a.json", POLYGON)).polygons
    write_geojson(tmp_path / "b.json", polygons)
    (again,) = read_geojson(tmp_path / "b.json").polygons
    for one, two in zip(polygons[0].rings, again.rings, strict=True):
        np.testing.assert_array_equal(one, two)


def test_cuts_are_written_beside_the_polygons(tmp_path):
    path = tmp_path / "region.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [9, 0.1], [9, 9]]]}))
    polygons, cuts = read_geojson(path).polygons, [np.array([[1.25, 2.0], [3.0, 4.5]])]
    path.write_text(geojson_text(polygons, cuts))
    drawing = read_geojson(path)
    assert (drawing.polygons[0].exterior == polygons[0].exterior).all()
    assert [cut.tolist() for cut in drawing.cuts] == [[[1.25, 2.0], [3.0, 4.5]]]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("{", "not valid JSON"),
        ({"type": "Point", "coordinates": [1, 2]}, "found Point"),
        ([1, 2], "found list"),
        ({"type": "FeatureCollection", "features": []}, "no polygon"),
        ({"type": "Polygon", "coordinates": []}, "no coordinates"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [0, 0]]]}, "at least three"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, "a"], [2, 2]]]}, "at least three"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1, NaN], [2, 2]]]}', "finite"),
    ],
)
def test_what_is_no_region_is_refused_by_name(tmp_path, value, message):
    path = written(tmp_path / "bad.geojson", value)
    with pytest.raises(InputError, match=rf"bad\.geojson(:\d+:\d+)?: .*{message}"):
        read_geojson(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.json"):
        read_geojson(tmp_path / "none.json")


@pytest.mark.parametrize("white", [1, 255])
def test_mask_is_the_bright_part(tmp_path, white):
    mask = np.zeros((20, 30), dtype=np.uint8)
    mask[5:10, 3:17] = white
    Image.fromarray(mask).save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png"), mask > 0)


def test_a_black_mask_is_refused(tmp_path):
    Image.fromarray(np.zeros((5, 5), dtype=np.uint8)).save(tmp_path / "m.png")
    with pytest.raises(InputError, match=r"m\.png: the mask is black"):
        read_mask(tmp_path / "m.png")


@pytest.mark.parametrize(("name", "expected"), [("a.json", True), ("a.GeoJSON", True), ("a.png", False)])
def test_the_name_tells_the_kind(tmp_path, name, expected):
    assert is_geojson(tmp_path / name) is expected


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_files_of_windows_are_read(tmp_path, encoding):
    (tmp_path / "r.geojson").write_bytes(json.dumps(POLYGON, indent=1).replace("\n", "\r\n").encode(encoding))
    assert area(read_geojson(tmp_path / "r.geojson").polygons) == 76


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"type": "Polygon", "coordinates": [[[0, 0], [1e308, 0], [2, 2]]]}, "a corner lies at 1e.308 px"),
        ({"type": "Polygon", "coordinates": [[[0, 0], ["5", 0], [2, 2]]]}, "at least three points"),
        ({"type": "MultiPolygon", "coordinates": [[SQUARE]] * 30_000}, "150,000 corners, at most 100,000"),
        ({"type": ["Polygon"], "coordinates": []}, "found"),
        ({"type": "Feature", "geometry": None}, "found NoneType"),
    ],
)
def test_regions_have_limits(tmp_path, value, message):
    with pytest.raises(InputError, match=message):
        read_geojson(written(tmp_path / "r.geojson", value))


def test_collections_inside_each_other_are_read_in_order(tmp_path):
    inner = {"type": "MultiPolygon", "coordinates": [[SQUARE], [HOLE]]}
    for _ in range(200):
        inner = {"type": "GeometryCollection", "geometries": [inner]}
    first, second = read_geojson(written(tmp_path / "r.geojson", inner)).polygons
    assert (area([first]), area([second])) == (80, 4)


def test_a_pipe_in_the_place_of_a_mask_does_not_wait(tmp_path):
    os.mkfifo(tmp_path / "m.png")
    with pytest.raises(InputError, match=r"m\.png: not a regular file; name a photograph"):
        read_mask(tmp_path / "m.png")
