"""Work shared among threads."""

import threading

import pytest

from dicflow.core.threads import at_once, over


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_values_come_in_the_order_of_the_items(threads):
    assert over(threads, lambda item: item * item, range(20)) == [item * item for item in range(20)]
    assert at_once(threads, lambda: "a", lambda: 2) == ["a", 2]


@pytest.mark.parametrize("threads", [1, 3])
def test_the_first_call_that_fails_is_told(threads):
    def fail(text):
        raise ValueError(text)

    with pytest.raises(ValueError, match="first"):
        at_once(threads, lambda: 1, lambda: fail("first"), lambda: fail("second"))


def test_calls_run_at_once():
    both = threading.Barrier(2, timeout=60.0)
    assert sorted(at_once(2, both.wait, both.wait)) == [0, 1]
