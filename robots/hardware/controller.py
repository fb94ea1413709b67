"""Plays a stream in real time on the line to a rig's controller: a serial device, a file or standard output."""

import contextlib
import fcntl
import io
import os
import select
import stat
import sys
import termios
import time
import tty
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from robots.hardware.stream import Format, Sample, Stream
from taichi_sim.base.disk_faults import told_as

HEARTBEAT = 0.5  # of silence at most [s]
STUCK = 5.0  # for which a line may take nothing [s]
_LOOKED_AT = 1000  # samples, to know how long lines are
_BITS = 10  # of a character on a serial line, with start and stop
BAUDS = tuple(sorted(int(name[1:]) for name in dir(termios) if name[:1] == "B" and name[1:].isdigit() and name != "B0"))


class PlayFailed(RuntimeError):
    """The controller did not answer, asked to stop, or could not be reached; lines were vented as far as possible."""


class Link:
    """An open line to a controller."""

    def __init__(self, descriptor: int, name: str) -> None:
        """Talk by an open file descriptor."""
        self.name = name
        self._descriptor = descriptor
        self._received = b""
        self._whole = True  # no line was left half written

    def send(self, line: str) -> None:
        """Write a line whole; one that an interruption cut before is marked by a question mark first.

        Raises:
            PlayFailed: if the line takes nothing for ``STUCK`` seconds, or is closed.
        """
        rest = (line if self._whole else f"?\n{line}").encode() + b"\n"
        self._whole = False
        while rest:
            try:
                if not select.select([], [self._descriptor], [], STUCK)[1]:
                    raise PlayFailed(f"{self.name}: takes nothing for {STUCK:g} s; is the controller reading?")
                rest = rest[os.write(self._descriptor, rest[: select.PIPE_BUF]) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise PlayFailed(f"{self.name}: cannot be written ({error.strerror})") from None
        self._whole = True

    def answer(self, until: float) -> str | None:
        """The next line that the controller sends before a moment of the monotonic clock; None if there is none."""
        while b"\n" not in self._received:
            left = max(0.0, until - time.monotonic())
            try:
                if not select.select([self._descriptor], [], [], left)[0]:
                    return None
                got = os.read(self._descriptor, 4096)
            except BlockingIOError:
                continue
            except OSError as error:
                raise PlayFailed(f"{self.name}: cannot be read ({error.strerror})") from None
            if not got:
                raise PlayFailed(f"{self.name}: was closed by the controller")
            self._received += got
        line, _, self._received = self._received.partition(b"\n")
        return line.decode(errors="replace").strip()


@contextlib.contextmanager
def serial_link(path: str, baud: int, ready: float = 0.0) -> Iterator[Link]:
    """A serial device for this process alone, at a speed: eight bits, no parity, one stop bit, no flow control.

    Its settings come back at the end.

    Args:
        path: of the device.
        baud: its speed, one of ``BAUDS``.
        ready: how long the controller takes to start after the device was opened [s].

    Raises:
        ValueError: if it cannot be opened, is no serial device, or another player has it.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        raise ValueError(f"port: {path} cannot be opened ({error.strerror})") from None
    try:
        if not os.isatty(descriptor):
            raise ValueError(f"port: {path} is no serial device; give --to for a file")
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the system frees it when the process ends
        except OSError:
            raise ValueError(f"port: {path} is in use by another player; two would mix their lines") from None
        before = termios.tcgetattr(descriptor)
        tty.setraw(descriptor)
        settings = termios.tcgetattr(descriptor)
        settings[4] = settings[5] = getattr(termios, f"B{baud}")
        settings[2] &= ~(termios.CSTOPB | termios.CRTSCTS | termios.PARODD)  # whatever used the port before
        settings[2] |= termios.CLOCAL | termios.CREAD
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        try:
            time.sleep(ready)
            yield Link(descriptor, path)
        finally:
            with contextlib.suppress(termios.error, OSError):
                _drain(descriptor)  # or the last line would go out at another speed
                termios.tcsetattr(descriptor, termios.TCSANOW, before)
    finally:
        os.close(descriptor)


def _drain(descriptor: int) -> None:
    """Wait until the device has sent all, but no longer than ``STUCK``."""
    until = time.monotonic() + STUCK
    while time.monotonic() < until:
        waiting = fcntl.ioctl(descriptor, termios.TIOCOUTQ, b"\0" * 4)
        if int.from_bytes(waiting, sys.byteorder) == 0:
            return
        time.sleep(0.01)


@contextlib.contextmanager
def file_link(path: str, live: bool = False) -> Iterator[Link]:
    """A new or empty file, a named pipe or a device to write, or standard output for ``-``.

    A new file is removed if sending fails, so that the same can be tried again; after an interruption it stays. A pipe
    that is ``live`` holds few lines: whoever reads slowly makes samples late, and hears at once when lines vent.

    Raises:
        ValueError: if it cannot be opened, or has content.
        RuntimeError: if the disk is full or broken.
    """
    if path == "-":
        sys.stdout.flush()
        try:
            descriptor = sys.stdout.fileno()
        except io.UnsupportedOperation:  # of a notebook, or of who calls the command as a function
            raise ValueError("to: - is not allowed, as standard output is no file here; name a file") from None
        with _short_pipe(descriptor) if live else contextlib.nullcontext():
            yield Link(descriptor, "standard output")
        return
    check_takes_lines(path)
    new = not os.path.exists(path)
    with told_as(f"to: {path} cannot be opened", begun=False):
        # Exclusive, so that a file which another process makes meanwhile is not written over; a link may be dangling.
        exclusive = os.O_CREAT | os.O_EXCL if new and not os.path.islink(path) else os.O_CREAT
        descriptor = os.open(path, os.O_WRONLY | exclusive, 0o644)
    try:
        with _short_pipe(descriptor) if live else contextlib.nullcontext():
            yield Link(descriptor, path)
    except Exception:
        if new:  # who has opened it reads on, also the lines that vent
            with contextlib.suppress(OSError):
                os.unlink(os.path.realpath(path))
        raise
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def _short_pipe(descriptor: int) -> Iterator[None]:
    """Let a pipe hold as little as it can for a while; by default it holds a minute of lines that nobody has read."""
    before = None
    with contextlib.suppress(AttributeError, OSError):  # a system without such pipes, no pipe, or one that is full
        before = fcntl.fcntl(descriptor, fcntl.F_GETPIPE_SZ)
        fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, select.PIPE_BUF)
    try:
        yield
    finally:
        if before is not None:
            with contextlib.suppress(OSError):
                fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, before)


def check_takes_lines(path: str) -> None:
    """Refuse a folder, or a file that has content already, which lines of a stream would replace.

    Raises:
        ValueError: if it is one, or cannot be looked at.
        RuntimeError: if the disk is broken.
    """
    with told_as(f"to: {path} cannot be opened", begun=False):
        try:
            found = os.stat(path)
        except FileNotFoundError:
            return
    if stat.S_ISDIR(found.st_mode):
        raise ValueError(f"to: {path} is a folder; name a file")
    if stat.S_ISREG(found.st_mode) and found.st_size:
        raise ValueError(f"to: {path} exists; name a new file")


def check_baud(stream: Stream, form: Format, baud: int) -> None:
    """Refuse a speed that serial devices do not have, or a rate whose lines it cannot carry."""
    if baud not in BAUDS:
        raise ValueError(f"baud: {baud} is not allowed; give one of {', '.join(map(str, BAUDS))}")
    some = range(0, stream.samples, max(1, stream.samples // _LOOKED_AT))
    longest = max(len(form.sample(stream.sample(number))) + 1 for number in some)
    needed = longest * _BITS * stream.rate
    if needed > baud:
        raise ValueError(
            f"rate: {stream.rate:g} Hz is not allowed, as lines of {longest} characters need {needed:.0f} baud of "
            f"{baud}; give a lower --rate, --format csv or a higher --baud"
        )


@dataclass(frozen=True)
class Played:
    """What became of a stream.

    Attributes:
        samples: that were sent, all in order.
        seconds: that it took [s].
        latest: by how much the latest sample was late [s].
    """

    samples: int
    seconds: float
    latest: float


@dataclass(frozen=True)
class Pace:
    """How a stream is paced.

    Attributes:
        wait: False sends all at once, for files.
        ack: how long to wait for the answer to a sample [s]; None does not wait.
        late: by how much a sample may be late [s] before the lines are vented.
    """

    wait: bool = True
    ack: float | None = None
    late: float = 0.5


def play(stream: Stream, form: Format, link: Link, pace: Pace) -> Played:
    """Send a stream in real time, no sample left out, and stop at the end; vent the lines whatever happens.

    Raises:
        PlayFailed: if the link or the controller fails, or samples become too late.
        KeyboardInterrupt: again, after an interruption, once lines are vented.
    """
    player = _Player(stream, form, link, pace)
    try:
        link.send(form.header(stream))
        player.send_all(stream)
        link.send(form.stop("end"))
    except KeyboardInterrupt:
        player.vent("interrupted")
        raise
    except BaseException:
        with contextlib.suppress(PlayFailed):  # the first failure is what to tell
            player.vent("failed")
        raise
    return player.played()


class _Player:
    """Sends samples when they are due."""

    def __init__(self, stream: Stream, form: Format, link: Link, pace: Pace) -> None:
        self.stream, self.form, self.link, self.pace = stream, form, link, pace
        self.start = time.monotonic()
        self.last: Sample | None = None
        self.sent, self.latest = 0, 0.0

    def send_all(self, samples: Iterable[Sample], pace: Pace | None = None) -> None:
        """Send samples when they are due, with answers if they are asked for."""
        pace = pace or self.pace
        for sample in samples:
            if pace.wait:
                self._wait(sample)
                self._check_late(sample, pace)
            self.last = sample  # before it is sent, as it may arrive although sending is interrupted
            self.link.send(self.form.sample(sample))
            self.sent += 1
            if pace.ack is not None:
                self._await_answer(sample, pace.ack)

    def vent(self, why: str) -> None:
        """Let the pressure out from where it is, then stop; a second interruption stops at once."""
        try:
            if self.last is not None:
                self.start = time.monotonic() - self.last.time_s
                self.send_all(self.stream.venting(self.last), Pace(self.pace.wait, None, float("inf")))
        finally:
            self.link.send(self.form.stop(why))

    def played(self) -> Played:
        """What was sent until now."""
        return Played(self.sent, time.monotonic() - self.start, self.latest)

    def _wait(self, sample: Sample) -> None:
        while (left := self.start + sample.time_s - time.monotonic()) > 0:
            time.sleep(min(left, HEARTBEAT))
            if left > HEARTBEAT:
                self.link.send(self.form.heartbeat(sample.number))

    def _check_late(self, sample: Sample, pace: Pace) -> None:
        late = time.monotonic() - self.start - sample.time_s
        if late > pace.late:
            raise PlayFailed(
                f"sample {sample.number}: {late:.3f} s late, more than --late {pace.late:g}; "
                "give a lower --rate, or a faster line"
            )
        self.latest = max(self.latest, late)

    def _await_answer(self, sample: Sample, timeout: float) -> None:
        until = time.monotonic() + timeout
        while (line := self.link.answer(until)) is not None:
            if line.lower().startswith("stop"):
                raise PlayFailed(f"{self.link.name}: the controller asked to stop at sample {sample.number}")
            if line.split() == ["ok", str(sample.number)]:
                return
        raise PlayFailed(f"{self.link.name}: no answer 'ok {sample.number}' within {timeout:g} s")
