import pytest

from dicflow.errors import InputError
from dicflow.report.pieces import Pieces


@pytest.fixture
def calls():
    return []


def maker(calls, content):
    def make():
        calls.append(content)
        return content

    return make


def test_a_piece_is_made_once(tmp_path, calls):
    for _ in range(2):
        pieces = Pieces(tmp_path / ".report", "code")
        assert pieces.get(["map", "sha256:a"], maker(calls, b"first")) == b"first"
        assert pieces.get(["map", "sha256:b"], maker(calls, b"second")) == b"second"
    assert calls == [b"first", b"second"]


@pytest.mark.parametrize("damage", [b"", b"12345678first", b"\0" * 13])
def test_a_damaged_piece_is_made_again(tmp_path, calls, damage):
    Pieces(tmp_path, "code").get(["a"], maker(calls, b"first"))
    (path,) = tmp_path.iterdir()
    path.write_bytes(damage)
    assert Pieces(tmp_path, "code").get(["a"], maker(calls, b"second")) == b"second"
    assert Pieces(tmp_path, "code").get(["a"], maker(calls, b"third")) == b"second"


@pytest.mark.parametrize(("code", "sources"), [("other", ["a", "b"]), ("code", ["ab"]), ("code", ["b", "a"])])
def test_other_code_or_sources_are_another_piece(tmp_path, calls, code, sources):
    Pieces(tmp_path, "code").get(["a", "b"], maker(calls, b"1"))
    assert Pieces(tmp_path, code).get(sources, maker(calls, b"2")) == b"2"


def test_pieces_that_were_not_read_are_deleted_and_other_files_stay(tmp_path, calls):
    (tmp_path / "note.txt").write_text("mine")
    before = Pieces(tmp_path, "code")
    for name in ("a", "b"):
        before.get([name], maker(calls, name.encode()))
    now = Pieces(tmp_path, "code")
    now.get(["b"], maker(calls, b"b"))
    now.drop_unused()
    assert len(list(tmp_path.iterdir())) == 2
    assert (tmp_path / "note.txt").read_text() == "mine"
    assert now.get(["b"], maker(calls, b"again")) == b"b"


def test_a_piece_that_cannot_be_made_leaves_nothing(tmp_path):
    def fail():
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        Pieces(tmp_path / "new", "code").get(["a"], fail)
    Pieces(tmp_path / "new", "code").drop_unused()
    assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="a file stands where a folder should be"):
        Pieces(tmp_path / "file", "code").get(["a"], lambda: b"")
