import os

import pytest

from dicflow.engine.journal import Event, Journal, find_run


@pytest.fixture
def journal(store):
    made = Journal(store, "toys", None)
    yield made
    made.close({}, {})


def texts(store):
    return [event.text for event in find_run(store).events()]


def test_events_come_back_in_order(store, journal):
    for text in ("first", "größer → kleiner", "two\u2028lines"):
        journal.write(Event("warning", text=text))
    assert texts(store) == ["first", "größer → kleiner", "two\u2028lines"]


def test_a_line_cut_inside_a_character_is_left_out(store, journal):
    journal.write(Event("warning", text="whole"))
    journal.write(Event("warning", text="ä"))
    path = journal.folder / "journal.jsonl"
    os.truncate(path, path.read_bytes().index("ä".encode()) + 1)
    assert texts(store) == ["whole"]


class FullDisk:
    """A file that takes so many bytes of its next line, then all there are."""

    def __init__(self, file, takes):
        self.file, self.takes = file, takes

    def write(self, line):
        count = self.file.write(line[: self.takes])
        if self.takes == 0:
            self.takes = None
            raise OSError("No space left on device")
        self.takes = None
        return count

    def close(self):
        self.file.close()


@pytest.mark.parametrize("takes", [0, 20])
def test_after_a_line_that_did_not_fit_the_next_one_is_whole(store, journal, takes):
    journal._file = FullDisk(journal._file, takes)
    for text in ("lost", "kept", "kept too"):
        journal.write(Event("warning", text=text))
    assert texts(store) == ["kept", "kept too"]


def test_a_text_that_is_no_unicode_stops_no_run(store, journal):
    text = os.fsdecode(b"caf\xe9")
    journal.write(Event("warning", text=text))
    assert texts(store) == [text]
