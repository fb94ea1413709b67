"""Parts of a study as processes do them: what they leave, raise, or die of."""

import os
import signal
import time
import warnings


def leave(folder, name, compute, progress):
    """A file with the options and the process, half way and at the end."""
    progress(0.5)
    (folder / name).write_text(f"{compute['threads']} {os.environ['OMP_NUM_THREADS']} {os.getpid()}")
    return name


class Wordy(ValueError):
    """Cannot be unpickled: it is built of other things than it tells."""

    def __init__(self, field, why):
        super().__init__(f"{field}: {why}")


def warn(folder, compute, progress):
    """Something that users may want to know."""
    warnings.warn("kite: it has\nno tail", stacklevel=1)


def refuse(folder, compute, progress):
    """Bad input that shows late."""
    _until_another_waits(folder)
    raise ValueError("kite: it does not fly")


def stumble(folder, compute, progress):
    """An error that does not travel."""
    _until_another_waits(folder)
    raise Wordy("kite", "it fell")


class Panic(BaseException):
    """No failure as handlers of these know it."""


def panic(folder, compute, progress):
    """As a library in Rust may."""
    _until_another_waits(folder)
    raise Panic("it fell")


def interrupt(folder, compute, progress):
    """As Ctrl-C does, of which a process is spared."""
    _until_another_waits(folder)
    raise KeyboardInterrupt


def die(folder, compute, progress):
    """As the kernel ends what takes too much memory."""
    _until_another_waits(folder)
    os.kill(os.getpid(), signal.SIGKILL)


def _until_another_waits(folder):
    while not any(folder.iterdir()):
        time.sleep(0.01)


def wait(folder, compute, progress):
    """For longer than any test."""
    (folder / str(os.getpid())).touch()
    time.sleep(600)
