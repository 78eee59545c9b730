"""No thread of a session outlives it: one inside zenoh would break the interpreter's end."""

import threading

import pytest

from schemas.topics import TOPICS

pytestmark = pytest.mark.integration


def test_a_closed_session_leaves_no_thread_of_ours(open_bus):
    before = set(threading.enumerate())
    bus = open_bus("test")
    for topic in TOPICS:
        bus.every(topic)
    bus.presence.watch("camera", lambda *_: None)
    ours = set(threading.enumerate()) - before
    assert len(ours) >= len(TOPICS) + 1
    bus.close()
    assert not {thread for thread in ours if thread.is_alive() and thread.daemon}
