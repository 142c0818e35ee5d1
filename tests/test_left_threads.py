"""Threads that go on behind a test are waited for, and named where they do not end."""

import threading

import pytest

from dicflow.engine.share import in_free_threads
from tests.threads import wait_for_threads


@pytest.fixture
def other():
    """A thread that is in a function of dicflow until it may end."""
    begun, may_end = threading.Event(), threading.Event()
    thread = threading.Thread(
        target=in_free_threads, args=(lambda _: begun.set() or may_end.wait(), [None]), name="other"
    )
    thread.start()
    begun.wait()
    yield thread, may_end
    may_end.set()
    thread.join()


def test_a_thread_that_does_not_end_is_named(other):
    with pytest.raises(AssertionError, match=r"go on behind their test: other at .*share\.py:\d+"):
        wait_for_threads(0.0)


def test_a_thread_that_ends_is_waited_for(other):
    thread, may_end = other
    threading.Timer(0.05, may_end.set).start()
    wait_for_threads(60.0)
    thread.join(60.0)
    assert not thread.is_alive()
