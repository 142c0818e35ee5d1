"""Files that patterns name."""

import unicodedata

import pytest

from dicflow.errors import InputError
from dicflow.io.images import search, search_start
from dicflow.io.images.search import find_files
from dicflow.stages.images import Images


def found(folder, pattern):
    return sorted(str(path.relative_to(folder)) for path in find_files(*search_start(folder, pattern)))


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


@pytest.mark.parametrize(
    "folder",
    ["photos [test 1]", "test #3", "{a,b}", "50 % load", "what?", "a*b", "ends in a blank ", "[!x]", "Prüfung 试验"],
)
def test_a_folder_that_exists_is_no_wildcard(tmp_path, folder):
    touch(tmp_path, f"{folder}/s_0.png", f"{folder}/s_1.png", "a/b/s_2.png", "t/s_3.png")
    assert found(tmp_path, f"{folder}/*.png") == [f"{folder}/s_0.png", f"{folder}/s_1.png"]
    assert list(Images(left=f"{folder}/*.png").steps(tmp_path)) == ["s_0", "s_1"]
    assert found(tmp_path, f"**/{folder}/s_1.png") == [f"{folder}/s_1.png"]


def test_wildcards_find_what_they_found_in_folders_without_signs(tmp_path):
    touch(tmp_path, "l/1.png", "l/10.png", "l/deep/2.png", "l/n.txt", "r/1.png")
    assert found(tmp_path, "l/*.png") == ["l/1.png", "l/10.png"]
    assert found(tmp_path, "l/?.png") == ["l/1.png"]
    assert found(tmp_path, "[lr]/1.png") == ["l/1.png", "r/1.png"]
    assert found(tmp_path, "**/*.png") == ["l/1.png", "l/10.png", "l/deep/2.png", "r/1.png"]
    assert found(tmp_path, "l/**") == ["l/1.png", "l/10.png", "l/deep/2.png", "l/n.txt"]
    assert found(tmp_path, "none/*.png") == []


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_both_unicode_forms_of_a_name_are_one(tmp_path, form):
    other = {"NFC": "NFD", "NFD": "NFC"}[form]
    touch(tmp_path, unicodedata.normalize(form, "Prüfkörper/Größe 1.png"))
    assert len(found(tmp_path, unicodedata.normalize(other, "Prüfkörper/Größe*.png"))) == 1
    assert search_start(tmp_path, unicodedata.normalize(other, "Prüfkörper/Größe 1.png"))[0].exists()


def test_suffixes_count_in_upper_and_lower_case(tmp_path):
    touch(tmp_path, "a.PNG", "b.png", "c.Tif")
    assert found(tmp_path, "*.png") == found(tmp_path, "*.PNG") == ["a.PNG", "b.png"]
    assert found(tmp_path, "[ac].*") == ["a.PNG", "c.Tif"]


def test_a_back_slash_parts_folders_unless_a_name_has_one(tmp_path):
    touch(tmp_path, "photos/a.PNG", "photos/b [1]/c.png")
    assert found(tmp_path, r"photos\*.PNG") == ["photos/a.PNG"]
    assert found(tmp_path, "photos\\b [1]\\*.png") == ["photos/b [1]/c.png"]
    touch(tmp_path, "odd\\name/d.png")
    assert found(tmp_path, "odd\\name/*.png") == ["odd\\name/d.png"]


def test_hidden_files_match_only_a_pattern_with_a_dot(tmp_path):
    touch(tmp_path, "._s_0.png", "s_0.png", ".dicflow/x.png")
    assert found(tmp_path, "*.png") == found(tmp_path, "**/*.png") == ["s_0.png"]
    assert found(tmp_path, ".dicflow/*.png") == [".dicflow/x.png"]


def test_links_are_entered_by_name_only(tmp_path):
    touch(tmp_path, "a/1.png", "secret/2.png")
    (tmp_path / "a" / "circle").symlink_to(tmp_path / "a")
    (tmp_path / "a" / "out").symlink_to(tmp_path / "secret")
    assert found(tmp_path, "a/**/*.png") == ["a/1.png"]
    assert found(tmp_path, "a/*/*.png") == []
    assert found(tmp_path, "a/out/*.png") == ["a/out/2.png"]


def test_a_search_ends_after_a_number_of_files(tmp_path, monkeypatch):
    touch(tmp_path, *(f"d/{k}.txt" for k in range(30)))
    monkeypatch.setattr(search, "MOST_ENTRIES", 20)
    with pytest.raises(InputError, match="more than 20 files and folders to look through"):
        found(tmp_path, "**/*.png")


@pytest.mark.parametrize("pattern", ["*/../x/*.png", "a\0b/*.png"])
def test_patterns_that_nothing_should_match(tmp_path, pattern):
    with pytest.raises(InputError):
        found(tmp_path, pattern)


def test_the_folder_of_a_search_is_known_before_it(tmp_path, monkeypatch):
    touch(tmp_path, "l [1]/a.png")
    monkeypatch.setattr(search, "find_files", None)
    node = Images(left="l [1]/*.png", right=["../r/*.png", "/**/*.png"])
    assert node.searches(tmp_path) == (tmp_path / "l [1]", tmp_path / ".." / "r", tmp_path.__class__("/"))


def test_photographs_in_another_format_are_named(tmp_path):
    touch(tmp_path, "IMG_1.webp", "IMG_2.webp")
    with pytest.raises(
        InputError, match=r"left: '\*' matches IMG_[12]\.webp and 1 more, but no PNG, TIFF, JPEG or BMP"
    ):
        Images(left="*").steps(tmp_path)
