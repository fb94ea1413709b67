"""Workers that are actors on a Ray cluster, which may be started for them on this machine."""

import contextlib
import logging
import os
import re
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from optim.problem import Problem, Request
from optim.runs.environment import cpu_model, other_version, versions
from optim.runs.plug_ins import packages_of
from optim.runs.workers.pool import Died
from optim.runs.workers.service import Answer, Service, environment_set, pickled, thread_environment
from taichi_sim.base.compiler import VARIABLE, compiler
from taichi_sim.base.compute import available_threads
from taichi_sim.base.foreign import needing

NOTE_AFTER = 30.0  # seconds within which the cluster should have started the actors
GIVE_UP_AFTER = 120.0
_REACH_TIMEOUT = 5.0  # seconds for a TCP connection
_ADDRESS = re.compile(r"(?:ray://)?(?:\[(?P<ipv6>[0-9a-fA-F:]+)\]|(?P<host>[\w.-]+)):(?P<port>[0-9]{1,5})")
# Read by Ray when it is imported. The errors and notes of this module replace its own messages.
_QUIET = {"RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0", "RAY_SCHEDULER_EVENTS": "0"}
# Ray then soon gives up on an address where no cluster answers, instead of after a quarter of an hour.
_CONNECTING = {"RAY_NUM_REDIS_GET_RETRIES": "1", "RAY_py_gcs_connect_timeout_s": "5"}
_NO_TOKEN = re.compile("AuthenticationError|InvalidAuthToken|Unauthenticated|authentication token", re.IGNORECASE)


class RemoteService(Service):
    """The service that runs in an actor."""

    def about(self, added: Sequence[str]) -> dict[str, Any]:
        """Describe the actor's machine: host, CPU and versions, including those of users' packages."""
        return {"host": socket.gethostname(), "cpu": cpu_model(), "versions": versions(added)}


@dataclass(eq=False)
class RayWorker:
    """A worker that is an actor, with its pending answers.

    Attributes:
        ray: the module ``ray``.
        actor: handle of a ``RemoteService``.
        about: reference to the description of its machine.
        owed: reference to its next answer.
        check: raises ValueError if its machine is not suitable.
        started: when it was requested [s].
        checked: whether the machine has been checked.
    """

    ray: Any
    actor: Any
    about: Any
    owed: Any
    check: Callable[[dict[str, Any]], None]
    started: float
    checked: bool = False

    def submit(self, request: Request) -> None:
        """Send a request to the actor."""
        self.owed = self.actor.evaluate.remote(request)

    def answer(self) -> Answer:
        """Receive the answer; the first time, check the actor's machine first."""
        owed, self.owed = self.owed, None
        errors = self.ray.exceptions
        try:
            if not self.checked:
                self.check(self.ray.get(self.about))
                self.checked = True
            return self.ray.get(owed)
        except errors.RayTaskError as error:
            raise RuntimeError(f"ray: {_last_line(error)}") from None
        except errors.RayError as error:  # the actor, its node, or the answer on it is lost
            raise Died(_last_line(error)) from None

    def kill(self) -> None:
        """End the actor by force."""
        self.ray.kill(self.actor, no_restart=True)

    @property
    def runs(self) -> bool:
        """Whether the cluster has started the actor."""
        return self.checked or bool(self.ray.wait([self.about], timeout=0)[0])


class RayCluster:
    """Starts actors on the cluster that this process is connected to.

    Args:
        ray: the module ``ray``.
        problem: problem that they evaluate; it may be defined in a script or notebook.
        threads: threads of an actor, which reserves as many CPUs of the cluster.
        variables: environment variables of an actor.
        note: called with a line about other CPU models, and about actors that the cluster cannot start.
    """

    def __init__(
        self, ray: Any, problem: Problem, threads: int, variables: dict[str, str], note: Callable[[str], None]
    ) -> None:
        self._ray = ray
        self._actor = ray.remote(num_cpus=threads, max_restarts=0, runtime_env={"env_vars": variables})(RemoteService)
        self._pickled = pickled(problem, ray.cloudpickle.dumps)
        self._added = packages_of(problem.describe())
        self._note = note
        self._noted: set[str] = set()  # hosts with other CPUs, and "places" once some were missing

    @property
    def cores(self) -> int:
        """CPU cores of all machines of the cluster."""
        return int(self._ray.cluster_resources().get("CPU", 1))

    def start(self) -> RayWorker:
        """Request an actor, the description of its machine, and whether it can load the problem."""
        actor = self._actor.remote()
        owed = actor.about.remote(self._added), actor.load.remote(self._pickled)
        return RayWorker(self._ray, actor, *owed, self._check, time.monotonic())

    def ready(self, workers: Sequence[RayWorker], wait: bool) -> list[RayWorker]:
        """List the workers that have an answer or are dead."""
        by_reference = {worker.owed: worker for worker in workers if worker.owed is not None}
        while by_reference:
            timeout = min(1.0, NOTE_AFTER) if wait else 0
            found, _ = self._ray.wait(list(by_reference), timeout=timeout)
            if found or not wait:
                return [by_reference[reference] for reference in found]
            self._look_for_places(workers)
        return []

    def _look_for_places(self, workers: Sequence[RayWorker]) -> None:
        """Note if some actors have waited for free CPUs for ``NOTE_AFTER`` seconds.

        Raises:
            RuntimeError: if all of them have waited for ``GIVE_UP_AFTER`` seconds.
        """
        now = time.monotonic()
        waits = [now - worker.started for worker in workers if not worker.runs]
        if len(waits) == len(workers) and min(waits) > GIVE_UP_AFTER:
            raise RuntimeError(
                f"ray: none of {len(workers)} workers could be started in {GIVE_UP_AFTER:g} s; "
                "the cluster has too few free CPUs"
            )
        if waits and max(waits) > NOTE_AFTER and "places" not in self._noted:
            self._noted.add("places")
            self._note(
                f"ray: {len(workers) - len(waits)} of {len(workers)} workers run; "
                "the others wait for free CPUs of the cluster"
            )

    @cached_property
    def _here(self) -> dict[str, str | None]:
        """Versions on this machine; cached, as the files of users' packages are read for them."""
        return versions(self._added)

    def _check(self, about: dict[str, Any]) -> None:
        """Check the description of an actor's machine, and note a different CPU.

        Raises:
            ValueError: for different versions.
        """
        here, there, host = self._here, about["versions"], about["host"]
        if other := other_version(here, there):
            name, ours, theirs = other
            raise ValueError(f"ray: {host} has {name} {theirs}, this machine {ours}; install the same there")
        if about["cpu"] != cpu_model() and host not in self._noted:
            self._noted.add(host)
            self._note(
                f"ray: {host} has another CPU ({about['cpu']}) than this machine ({cpu_model()}); "
                "results may differ in their last bits"
            )


def _last_line(error: Exception) -> str:
    """Short form of an error of Ray: the last of its many lines, without advice."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    text = (lines or [type(error).__name__])[-1].rpartition("Worker exit detail: ")[2]
    return re.split(r"\.? (?:Some common causes|There are some)", text)[0][:300]


@contextlib.contextmanager
def open_cluster(
    problem: Problem, count: int | None, threads: int, address: str | None, note: Callable[[str], None]
) -> Iterator[RayCluster]:
    """Connect to a cluster, or start one on this machine that ends with the context.

    Raises:
        ValueError: if Ray is not installed, the address is not allowed, or no cluster answers there.
    """
    here = address in (None, "local")
    if not here and address != "auto":
        _reach(str(address))
    quiet = _QUIET if here else _QUIET | _CONNECTING
    with environment_set(quiet):
        ray = _import_ray()
    variables = {**thread_environment(threads), VARIABLE: compiler()}
    if here:  # what can be imported here can be imported there
        variables["PYTHONPATH"] = os.pathsep.join(path or os.getcwd() for path in sys.path)
    handler = signal.getsignal(signal.SIGTERM)
    try:
        with environment_set(quiet):
            _connect(ray, None if here else address, max((count or 1) * threads, available_threads()))
        yield RayCluster(ray, problem, threads, variables, note)
    finally:
        ray.shutdown()
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)  # Ray has set its own


def _import_ray() -> Any:
    with needing("ray", "it", "ray"):
        import ray
        import ray.exceptions
    if ray.is_initialized():
        raise ValueError("ray: this process is connected to a cluster already; call ray.shutdown() first")
    # The only way to silence its messages on stdout about every worker that dies.
    ray._private.worker._worker_logs_enabled = False
    return ray


def _connect(ray: Any, address: str | None, cpus: int) -> None:
    """Start a cluster, or connect to one; long errors of Ray are shortened."""
    quiet = {"log_to_driver": False, "logging_level": logging.CRITICAL}
    if address is None:
        try:
            ray.init("local", num_cpus=cpus, include_dashboard=False, **quiet)
        except Exception as error:
            raise RuntimeError(f"ray: no cluster could be started here ({_last_line(error)})") from None
        return
    said: list[str] = []
    try:
        with _stderr_kept(said):
            ray.init(address, **quiet)
    except Exception as error:
        if _NO_TOKEN.search(f"{type(error).__name__} {error} {' '.join(said)}"):
            raise ValueError(
                f"ray: the cluster at {address} asks for a token, and this machine's is missing or another; copy "
                "~/.ray/auth_token from its head (or set RAY_AUTH_TOKEN_PATH), and set RAY_AUTH_MODE=token"
            ) from None
        raise _no_cluster(address, _last_line(error)) from None


@contextlib.contextmanager
def _stderr_kept(said: list[str]) -> Iterator[None]:
    """Append what is written to stderr inside the context to ``said``; only there Ray reports a refused token."""
    sys.stderr.flush()
    stderr = os.dup(2)
    with tempfile.TemporaryFile() as kept:
        os.dup2(kept.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            kept.seek(0)
            said.append(kept.read().decode(errors="replace"))


def _reach(address: str) -> None:
    """Check that an address accepts TCP connections, because Ray itself would try for long.

    Raises:
        ValueError: if it does not answer.
    """
    match = _ADDRESS.fullmatch(address)
    if not match or not 1 <= int(match["port"]) <= 65535:
        raise ValueError(
            f"ray: {address!r} is not an address; give HOST:PORT, ray://HOST:PORT, auto, or local for one here"
        )
    try:
        socket.create_connection((match["ipv6"] or match["host"], int(match["port"])), _REACH_TIMEOUT).close()
    except OSError as error:
        raise _no_cluster(address, error.strerror or str(error)) from None


def _no_cluster(address: str, why: str) -> ValueError:
    return ValueError(
        f"ray: no cluster answers at {address} ({why}); start one by 'ray start --head', or give local for one here"
    )
