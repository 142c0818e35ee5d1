"""HEIC and raw files: with a decoder that is installed, damaged, or missing."""

import sys
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from dicflow.errors import InputError
from dicflow.io.images import probe, read_photograph, time_taken
from tests.io.photograph_files import tiff

PHOTOGRAPHS = Path(__file__).parent / "photographs"
HEIC = bytes([0, 0, 0, 24]) + b"ftypheic" + bytes(40)
LEVELS = np.random.default_rng(1).integers(0, 255, (6, 9, 3), dtype=np.uint8)
GREY = np.round(LEVELS @ [0.299, 0.587, 0.114])


def raw_file(folder):
    path = folder / "a.dng"
    path.write_bytes(tiff([LEVELS[..., 0]], more=[{50706: 1}]))
    return path


def heic_file(folder):
    path = folder / "a.heic"
    path.write_bytes(HEIC)
    return path


@pytest.mark.parametrize(
    ("file", "module", "command"),
    [(heic_file, "pi_heif", "pip install pi-heif"), (raw_file, "rawpy", "pip install rawpy")],
)
def test_a_missing_decoder_is_named_with_its_command(tmp_path, monkeypatch, file, module, command):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"a\.\w+: .*{command}"):
        probe(file(tmp_path))
    assert time_taken(file(tmp_path)) is None


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_a_heic_photograph_lies_as_the_sensor_did(tmp_path, monkeypatch, orientation):
    """The decoder turns the picture as its tag says; the pixels of the sensor come back."""
    shown = np.rot90(LEVELS, {1: 0, 3: 2, 6: 3, 8: 1}[orientation])

    exif = Image.Exif()
    exif[274] = orientation

    class Opened(SimpleNamespace):
        def __array__(self, dtype=None, copy=None):
            return np.ascontiguousarray(shown)

    decoder = ModuleType("pi_heif")
    decoder.open_heif = lambda file, **options: Opened(info={"exif": exif.tobytes()})
    monkeypatch.setitem(sys.modules, "pi_heif", decoder)
    found = read_photograph(heic_file(tmp_path))
    assert found.orientation == orientation
    np.testing.assert_allclose(found.grey, GREY, atol=1)


@pytest.mark.parametrize(("flip", "orientation"), [(0, 1), (3, 3), (5, 8), (6, 6)])
def test_a_raw_file_keeps_its_16_bits_in_proportion_to_the_light(tmp_path, monkeypatch, flip, orientation):
    class Opened(SimpleNamespace):
        sizes = SimpleNamespace(flip=flip)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            return None

        def postprocess(self, **options):
            assert options["gamma"] == (1, 1)
            assert options["user_flip"] == 0
            return LEVELS.astype(np.uint16) * 257

    decoder = ModuleType("rawpy")
    decoder.imread = lambda file: Opened()
    decoder.ColorSpace = SimpleNamespace(raw=0)
    monkeypatch.setitem(sys.modules, "rawpy", decoder)
    found = read_photograph(raw_file(tmp_path))
    assert found.orientation == orientation
    assert found.grey.dtype == np.uint16
    np.testing.assert_allclose(found.grey, GREY * 257.0, atol=257)


def test_heic_photographs_of_an_encoder(tmp_path):
    """One that is turned as a viewer shows it, and says so; bright to the left as the sensor lies."""
    pytest.importorskip("pi_heif")
    for name, orientation in (("as_taken.heic", 1), ("turned.heic", 6)):
        found = read_photograph(PHOTOGRAPHS / name)
        assert found.orientation == orientation
        assert found.grey.shape == (64, 96)
        assert [int(found.grey[y, x]) for y, x in ((8, 8), (40, 20), (40, 80))] == pytest.approx([100, 200, 0], abs=4)
    assert time_taken(PHOTOGRAPHS / "turned.heic") == datetime(2026, 3, 1, 12, 0, 5, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(("file", "module"), [(heic_file, "pi_heif"), (raw_file, "rawpy")])
def test_damaged_files_are_named_by_the_real_decoders(tmp_path, file, module):
    pytest.importorskip(module)
    with pytest.raises(InputError, match=r"a\.\w+: .*its decoder cannot read"):
        probe(file(tmp_path))
    assert time_taken(file(tmp_path)) is None
