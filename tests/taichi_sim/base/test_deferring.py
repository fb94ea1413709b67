"""Ctrl-C that waits for the end of what must not be cut in two."""

import signal
import threading

import pytest

from taichi_sim.base.deferring import ctrl_c_afterwards


@pytest.fixture(autouse=True)
def handler():
    """Python's own handler, which tests under ``nohup`` lack."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield signal.default_int_handler
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_acts_when_all_is_done(handler):
    done = []
    with pytest.raises(KeyboardInterrupt), ctrl_c_afterwards():
        signal.raise_signal(signal.SIGINT)
        done.append("whole")
    assert done == ["whole"] and signal.getsignal(signal.SIGINT) is handler


def test_without_ctrl_c_nothing_happens(handler):
    with ctrl_c_afterwards():
        assert signal.getsignal(signal.SIGINT) is not handler
    assert signal.getsignal(signal.SIGINT) is handler


def test_what_is_ignored_stays_so_and_other_threads_touch_nothing(handler):
    seen = []

    def work():
        with ctrl_c_afterwards():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with ctrl_c_afterwards():
        signal.raise_signal(signal.SIGINT)
        seen.append(signal.getsignal(signal.SIGINT))
    assert seen == [handler, signal.SIG_IGN]
