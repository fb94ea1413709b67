"""Signals end what they meet, whatever swallows them at first."""

import contextlib
import os
import signal
import sys
import threading
import time

import pytest

import morpholab as ml
from optim import interrupts
from optim.interrupts import EndedBySignals, HungUp, Interrupted, Terminated, stopped_by

KINDS = [(signal.SIGINT, Interrupted), (signal.SIGTERM, Terminated), (signal.SIGHUP, HungUp)]


@pytest.fixture(autouse=True)
def handlers(monkeypatch):
    """The handlers of a process in the foreground, whatever the tests run in; they have to be there afterwards."""
    monkeypatch.setattr(interrupts, "REPEATED_AFTER", 0.02)
    usual = {number: signal.SIG_DFL for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGALRM)}
    usual[signal.SIGINT] = signal.default_int_handler
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    after = {number: signal.getsignal(number) for number in usual}
    timer = signal.setitimer(signal.ITIMER_REAL, 0.0)
    for number, handler in before.items():
        signal.signal(number, handler)
    assert (after, timer) == (usual, (0.0, 0.0))


def wait():
    """Wait for what comes, a second at most."""
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        pass


@pytest.mark.parametrize(("number", "kind"), KINDS)
def test_what_swallows_an_interrupt_only_delays_it(number, kind):
    reached = []
    with pytest.raises(kind), EndedBySignals():
        try:
            os.kill(os.getpid(), number)
            wait()
        except:  # noqa: E722  as the reader of kernels' sources has it
            reached.append("swallowed")
        wait()
        reached.append("too far")
    assert reached == ["swallowed"]


def test_what_makes_another_error_of_it_does_not_hide_it():
    with pytest.raises(Terminated) as ended, EndedBySignals():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            wait()
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None
    assert isinstance(ended.value.__cause__, ImportError)


def test_a_failure_on_the_way_out_is_told_in_its_place():
    """Such as lines that could not be vented."""
    with pytest.raises(OSError, match="vent"), EndedBySignals():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            wait()
        except KeyboardInterrupt:
            raise OSError("cannot vent") from None


def test_a_failure_after_it_was_heeded_is_told():
    with pytest.raises(ImportError), EndedBySignals():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            wait()
        except KeyboardInterrupt as interrupt:
            stopped_by(interrupt)
        raise ImportError


def test_what_is_swallowed_last_is_not_lost(monkeypatch):
    monkeypatch.setattr(interrupts, "REPEATED_AFTER", 100.0)
    with pytest.raises(Terminated), EndedBySignals():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            wait()
        except KeyboardInterrupt:
            pass


def test_an_alarm_of_the_caller_stays():
    rung = []
    before = signal.signal(signal.SIGALRM, lambda *_: rung.append("inside"))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with EndedBySignals():
            wait()
        assert rung == ["inside"]
        signal.setitimer(signal.ITIMER_REAL, 60.0)
        with pytest.raises(Interrupted), EndedBySignals():
            os.kill(os.getpid(), signal.SIGINT)
            wait()
        assert 50.0 < signal.setitimer(signal.ITIMER_REAL, 0.0)[0] <= 60.0
    finally:
        signal.signal(signal.SIGALRM, before)


def test_what_ends_the_work_is_not_cut_short():
    """Neither in ``finally``, nor in what a context or generator does there, nor where another error follows."""
    done = []

    def ending():
        try:
            yield
        finally:
            wait()
            done.append("generator")

    with pytest.raises(Interrupted), EndedBySignals():
        try:
            try:
                for _ in ending():
                    os.kill(os.getpid(), signal.SIGINT)
                    wait()
            except KeyboardInterrupt:
                with pytest.raises(ValueError, match="invalid literal"):
                    int("x")
                wait()
                done.append("except")
                raise
        finally:
            wait()
            done.append("finally")
    assert done == ["generator", "except", "finally"]


def test_what_is_heeded_does_not_come_back():
    with EndedBySignals():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            wait()
        except KeyboardInterrupt as interrupt:
            assert stopped_by(interrupt) == 143
        wait()
    assert stopped_by(KeyboardInterrupt()) == 130


def test_a_second_signal_ends_what_takes_long_to_end():
    with pytest.raises(Terminated), EndedBySignals():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            wait()
        finally:
            os.kill(os.getpid(), signal.SIGTERM)
            wait()


def test_what_a_process_ignores_or_handles_itself_stays():
    before, own = signal.signal(signal.SIGHUP, signal.SIG_IGN), []
    handled = signal.signal(signal.SIGINT, lambda *_: own.append("mine"))
    try:
        with EndedBySignals():
            os.kill(os.getpid(), signal.SIGHUP)
            os.kill(os.getpid(), signal.SIGINT)
            wait()
    finally:
        signal.signal(signal.SIGHUP, before)
        signal.signal(signal.SIGINT, handled)
    assert own == ["mine"]


def test_signals_are_left_to_the_main_thread():
    failed = []

    def enter():
        try:
            with EndedBySignals():
                pass
        except Exception as error:
            failed.append(error)

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert failed == [] and sys.exception() is None


@pytest.mark.parametrize("call", [ml.simulate, ml.differentiate])
def test_calls_from_python_end_though_something_swallows_ctrl_c(monkeypatch, call):
    def swallowing(*_, **__):
        with contextlib.suppress(BaseException):
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL  # which is the session's own
        time.sleep(10.0)

    monkeypatch.setattr("optim.lab._recorded", swallowing)
    monkeypatch.setattr("robots.abstract.Robot.differentiate", swallowing)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        call("vehicle")
    assert time.monotonic() - began < 5.0 and signal.getsignal(signal.SIGINT) is signal.default_int_handler
