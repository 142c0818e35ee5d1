"""A small sample of what ``make faults`` tries hundreds of times."""

import pytest

from tests.faults import damage, kills, limits


def good(tally):
    return tally.ok, tally.notes


@pytest.mark.slow
def test_a_flipped_bit_in_each_sort_of_file(tmp_path):
    tallies = list(damage.flips(tmp_path, 1))
    assert [good(tally) for tally in tallies] == [(True, [])] * len(damage.FILES)


@pytest.mark.slow
def test_many_files_lost_at_once(tmp_path):
    assert good(damage.power_failures(tmp_path, 6)) == (True, [])


@pytest.mark.slow
@pytest.mark.parametrize("killed", [kills.run_kills, kills.gc_kills, kills.verify_kills])
def test_kills(tmp_path, killed):
    assert good(killed(tmp_path, 2)) == (True, [])


@pytest.mark.slow
def test_two_writers_while_others_delete_and_verify(tmp_path):
    assert good(limits.at_once(tmp_path, 1, 1.0)) == (True, [])
