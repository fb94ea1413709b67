"""Service that runs in every worker, in a process or on a cluster."""

import contextlib
import os
import pickle
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from optim.problem import Evaluation, Problem, Request, evaluate_request
from taichi_sim.base.foreign import blaming_package, class_and_message

# Variables from which NumPy's linear algebra and other libraries read their number of threads when they are loaded.
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)


@dataclass(frozen=True)
class Raised:
    """Answer that carries an exception."""

    error: BaseException

    @classmethod
    def by_users_code(cls, raised: BaseException) -> "Raised":
        """What users' code has raised in a worker. Workers ignore Ctrl-C: the code raised interrupts, too."""
        if isinstance(raised, KeyboardInterrupt):
            return cls(KeyboardInterrupt())
        return cls(portable(blaming_package(raised)))


Answer = Evaluation | Raised | None


def thread_environment(threads: int) -> dict[str, str]:
    """Environment variables that limit a process to a number of threads."""
    return dict.fromkeys(THREAD_VARIABLES, str(threads))


@contextlib.contextmanager
def environment_set(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables inside the context; processes started there have them before loading anything."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def pickled(problem: Problem, dumps: Callable[[Problem], bytes]) -> bytes:
    """Pickle a problem, to send it to workers.

    Raises:
        ValueError: if it cannot be pickled.
    """
    try:
        return dumps(problem)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise ValueError(f"problem: it cannot be sent to workers ({error})") from None


class Service:
    """Holds a problem, and answers requests to evaluate its points."""

    _problem: Problem

    def load(self, content: bytes) -> Answer:
        """Load a pickled problem; return None, or the exception."""
        try:
            self._problem = pickle.loads(content)
        except KeyboardInterrupt as interrupt:
            return Raised.by_users_code(interrupt)
        except BaseException as error:
            return Raised(RuntimeError(f"workers: the problem cannot be loaded in one ({class_and_message(error)})"))
        return None

    def evaluate(self, request: Request) -> Answer:
        """Evaluate a request; return the evaluation, or the exception."""
        try:
            return evaluate_request(self._problem, request)
        except BaseException as raised:
            return Raised.by_users_code(raised)


def portable(error: Exception) -> Exception:
    """Make an exception that can be pickled, with a note about where it was raised."""
    where = "".join(traceback.format_exception(error)).rstrip()
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        notes = getattr(error, "__notes__", [])
        error = RuntimeError(class_and_message(error))
        for note in notes:
            error.add_note(note)
    error.add_note(f"in a worker:\n{where}")
    return error
