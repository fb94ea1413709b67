"""Parts of a study as processes do them: what they leave, raise, or die of."""

import os
import signal
import time
import warnings

from hill import Hill
from worker_checks import wait_for

from optim.studies.beyond.gait_hunt.study import _search
from robots.inflatable import gaits


def leave(folder, name, where, progress):
    """A file with the options and the process, half way and at the end."""
    progress(0.5)
    (folder / name).write_text(f"{where['threads']} {os.environ['OMP_NUM_THREADS']} {os.getpid()}")
    return name


class Wordy(ValueError):
    """Cannot be unpickled: it is built of other things than it tells."""

    def __init__(self, field, why):
        super().__init__(f"{field}: {why}")


def warn(folder, where, progress):
    """Something that users may want to know."""
    warnings.warn("kite: it has\nno tail", stacklevel=1)


def refuse(folder, where, progress):
    """Bad input that shows late."""
    _until_another_waits(folder)
    raise ValueError("kite: it does not fly")


def stumble(folder, where, progress):
    """An error that does not travel."""
    _until_another_waits(folder)
    raise Wordy("kite", "it fell")


def die(folder, where, progress):
    """As the kernel ends what takes too much memory."""
    _until_another_waits(folder)
    os.kill(os.getpid(), signal.SIGKILL)


def _until_another_waits(folder):
    wait_for(lambda: any(folder.iterdir()))


def wait(folder, where, progress):
    """For longer than any test."""
    (folder / str(os.getpid())).touch()
    time.sleep(600)


def search(folder, hunt, name, seed, where, progress):
    """A run of the hunt, with the stand-in for the simulator in whatever process it is; a file tells which."""
    before, gaits.simulate = gaits.simulate, Hill()
    try:
        found = _search(folder, hunt, name, seed, where, progress)
    finally:
        gaits.simulate = before
    (folder / "runs" / f"{name}-{seed}" / str(os.getpid())).touch()
    return found
