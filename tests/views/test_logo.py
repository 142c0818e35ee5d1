"""A logo: reduced, without metadata, and never from outside of the pipeline file's folder."""

import io

import pytest
from PIL import Image

from dicflow.errors import InputError
from dicflow.views import logo
from dicflow.views.logo import logo_png


def saved(path, size=(900, 300), colour=(10, 200, 30), **options):
    Image.new("RGB", size, colour).save(path, **options)
    return path.name


@pytest.mark.parametrize(("suffix", "tolerance"), [(".png", 0), (".jpg", 3)])
def test_a_logo_is_reduced_with_its_sides_and_colour(tmp_path, suffix, tolerance):
    content = logo_png(tmp_path, saved(tmp_path / f"logo{suffix}"))
    with Image.open(io.BytesIO(content)) as picture:
        assert (picture.format, picture.size) == ("PNG", (432, 144))
        pixel = picture.convert("RGB").getpixel((200, 70))
    assert max(abs(value - expected) for value, expected in zip(pixel, (10, 200, 30), strict=True)) <= tolerance


def test_a_small_logo_is_not_enlarged(tmp_path):
    with Image.open(io.BytesIO(logo_png(tmp_path, saved(tmp_path / "logo.png", (30, 20))))) as picture:
        assert picture.size == (30, 20)


def test_metadata_stay_behind(tmp_path):
    name = saved(tmp_path / "logo.jpg", comment=b"made at the secret place")
    assert b"secret" in (tmp_path / name).read_bytes()
    assert b"secret" not in logo_png(tmp_path, name)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "does not exist"),
        (b"<svg xmlns='http://www.w3.org/2000/svg'/>", "neither PNG nor JPEG"),
        (b"\x89PNG\r\n\x1a\n", "neither PNG nor JPEG"),
    ],
)
def test_what_is_no_picture_is_named_with_the_remedy(tmp_path, content, words):
    if content is not None:
        (tmp_path / "logo.png").write_bytes(content)
    with pytest.raises(InputError, match=rf"report\.logo: logo\.png: .*{words}.*; name a PNG or JPEG"):
        logo_png(tmp_path, "logo.png")


def test_a_picture_that_is_cut_short_is_refused(tmp_path):
    saved(tmp_path / "logo.png", (300, 300))
    whole = (tmp_path / "logo.png").read_bytes()
    (tmp_path / "logo.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="cannot be read"):
        logo_png(tmp_path, "logo.png")


def test_large_files_and_pictures_are_refused(tmp_path, monkeypatch):
    name = saved(tmp_path / "logo.png")
    monkeypatch.setattr(logo, "_MOST_PIXELS", 900 * 300 - 1)
    with pytest.raises(InputError, match="900 × 300 px"):
        logo_png(tmp_path, name)
    monkeypatch.setattr(logo, "_LARGEST_FILE", 100)
    with pytest.raises(InputError, match="at most 5 MB"):
        logo_png(tmp_path, name)


def test_a_link_never_leads_outside_of_the_folder(tmp_path):
    saved(tmp_path / "logo.png")
    folder = tmp_path / "test"
    folder.mkdir()
    (folder / "logo.png").symlink_to(tmp_path / "logo.png")
    with pytest.raises(InputError, match="outside the pipeline file's folder; copy it"):
        logo_png(folder, "logo.png")
