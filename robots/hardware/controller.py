"""Play a stream in real time to a rig's controller through a serial device, a file or standard output."""

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

HEARTBEAT = 0.5  # longest time between lines [s]
STUCK = 5.0  # longest time for which the link may accept no data [s]
_LOOKED_AT = 1000  # samples from which the length of lines is estimated
_BITS = 10  # per character on a serial line, with start and stop bits
BAUDS = tuple(sorted(int(name[1:]) for name in dir(termios) if name[:1] == "B" and name[1:].isdigit() and name != "B0"))


class PlayFailed(RuntimeError):
    """The controller did not answer, asked to stop, or could not be reached; lines were vented as far as possible."""


class Link:
    """An open connection to a controller."""

    def __init__(self, descriptor: int, name: str) -> None:
        """Use an open file descriptor; ``name`` is for messages."""
        self.name = name
        self._descriptor = descriptor
        self._received = b""
        self._whole = True  # no line was left half written

    def send(self, line: str) -> None:
        """Write a whole line; if an interruption cut the previous one, that is ended with a question mark first.

        Raises:
            PlayFailed: if the link accepts no data for ``STUCK`` seconds, or is closed.
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
        """Next line that the controller sends before a time of the monotonic clock [s]; None if there is none.

        Raises:
            PlayFailed: if the link cannot be read, or the controller closed it.
        """
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
    """Open a serial device exclusively: eight bits, no parity, one stop bit, no flow control.

    Its previous settings are restored at the end of the context.

    Args:
        path: path of the device.
        baud: speed, one of ``BAUDS`` [baud].
        ready: time that the controller takes to start after the device is opened [s].

    Raises:
        ValueError: if it cannot be opened, is not a serial device, or is in use by another player.
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
        settings[2] &= ~(termios.CSTOPB | termios.CRTSCTS | termios.PARODD)  # maybe set by its last user
        settings[2] |= termios.CLOCAL | termios.CREAD
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        try:
            time.sleep(ready)
            yield Link(descriptor, path)
        finally:
            with contextlib.suppress(termios.error, OSError):
                _drain(descriptor)  # otherwise the last line might be sent at another speed
                termios.tcsetattr(descriptor, termios.TCSANOW, before)
    finally:
        os.close(descriptor)


def _drain(descriptor: int) -> None:
    """Wait until the device has sent all data, but at most ``STUCK`` seconds."""
    until = time.monotonic() + STUCK
    while time.monotonic() < until:
        waiting = fcntl.ioctl(descriptor, termios.TIOCOUTQ, b"\0" * 4)
        if int.from_bytes(waiting, sys.byteorder) == 0:
            return
        time.sleep(0.01)


@contextlib.contextmanager
def file_link(path: str, live: bool = False) -> Iterator[Link]:
    """Open a new or empty file, a named pipe or a device for writing; ``-`` is standard output.

    A new file is removed if sending fails, so that the command can be repeated; after an interruption it stays. If
    ``live``, a pipe buffers only few lines, so that a slow reader makes samples late rather than reading old ones, and
    receives venting at once.

    Raises:
        ValueError: if it cannot be opened, or has content.
        RuntimeError: if the disk is full or broken.
    """
    if path == "-":
        sys.stdout.flush()
        try:
            descriptor = sys.stdout.fileno()
        except io.UnsupportedOperation:  # in a notebook, or where the command is called as a function
            raise ValueError("to: - is not allowed, as standard output is no file here; name a file") from None
        with _short_pipe(descriptor) if live else contextlib.nullcontext():
            yield Link(descriptor, "standard output")
        return
    check_takes_lines(path)
    new = not os.path.exists(path)
    with told_as(f"to: {path} cannot be opened", begun=False):
        # Exclusive, so that a file that another process has just made is not overwritten; a link may be dangling.
        exclusive = os.O_CREAT | os.O_EXCL if new and not os.path.islink(path) else os.O_CREAT
        descriptor = os.open(path, os.O_WRONLY | exclusive, 0o644)
    try:
        with _short_pipe(descriptor) if live else contextlib.nullcontext():
            yield Link(descriptor, path)
    except Exception:
        if new:  # a reader that has opened it can still read all lines, including those that vent
            with contextlib.suppress(OSError):
                os.unlink(os.path.realpath(path))
        raise
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def _short_pipe(descriptor: int) -> Iterator[None]:
    """Reduce the buffer of a pipe to its minimum inside the context; by default it holds about a minute of lines."""
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
    """Check that a path can be written: it is neither a folder nor a file with content.

    Raises:
        ValueError: if it is one of these, or cannot be accessed.
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
    """Raise ValueError if serial devices do not support a speed, or it is too low for the stream's rate of lines."""
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
    """Result of playing a stream.

    Attributes:
        samples: number of samples sent, all in order.
        seconds: duration [s].
        latest: largest delay of a sample [s].
    """

    samples: int
    seconds: float
    latest: float


@dataclass(frozen=True)
class Pace:
    """Timing of a stream.

    Attributes:
        wait: whether samples are sent in real time; False sends all at once, for files.
        ack: longest wait for the controller's answer to a sample [s]; None for no answers.
        late: largest delay of a sample, beyond which the lines are vented [s].
    """

    wait: bool = True
    ack: float | None = None
    late: float = 0.5


def play(stream: Stream, form: Format, link: Link, pace: Pace) -> Played:
    """Send all samples of a stream in real time, then stop; on any failure or interruption vent the lines first.

    Raises:
        PlayFailed: if the link or the controller fails, or a sample is too late.
        KeyboardInterrupt: after an interruption, once the lines are vented.
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
        with contextlib.suppress(PlayFailed):  # the first failure is reported
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
        """Send samples when they are due, and wait for answers if the pace requires them."""
        pace = pace or self.pace
        for sample in samples:
            if pace.wait:
                self._wait(sample)
                self._check_late(sample, pace)
            self.last = sample  # set before sending, as a sample may arrive although sending is interrupted
            self.link.send(self.form.sample(sample))
            self.sent += 1
            if pace.ack is not None:
                self._await_answer(sample, pace.ack)

    def vent(self, why: str) -> None:
        """Vent the lines from their last pressures, then stop; a second interruption stops at once."""
        try:
            if self.last is not None:
                self.start = time.monotonic() - self.last.time_s
                self.send_all(self.stream.venting(self.last), Pace(self.pace.wait, None, float("inf")))
        finally:
            self.link.send(self.form.stop(why))

    def played(self) -> Played:
        """Result of playing so far."""
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
