"""Rehearsals of a resume: check that a search method continues from its own checkpoints as if uninterrupted."""

import contextlib
from collections.abc import Iterator
from copy import deepcopy
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation
from optim.search.method import Method, next_request
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.foreign import lacks_memory, said_by

Thing = TypeVar("Thing")

REHEARSED = 3  # first generations of a run that are checked; all of a method's state changes within them
TOLERANCE = 1e-9  # relative; state that is lost makes larger differences than rounding


class Rehearsal:
    """Restores a second instance of a method from each of a run's first checkpoints and compares the two.

    Otherwise a user's method with an incomplete state would be noticed only when a run is resumed. The checks use
    copies, so the method itself gives the same bits.
    """

    def __init__(self, name: str, method: Method) -> None:
        """Prepare to check a method that has not been used yet; ``name`` is for messages."""
        self._name, self._fresh = name, _copied(method)
        self._restored: Method | None = None
        self._next: tuple[Floats, Evaluation] | None = None

    def keep(self, points: Floats, evaluation: Evaluation) -> None:
        """Keep a copy of the points and evaluation that the method receives next, for the restored instance."""
        self._next = _copied((points, evaluation))

    def check(self, method: Method, state: Arrays) -> None:
        """Compare a method with the instance restored before, then restore another from its present state.

        Raises:
            ValueError: if a restored instance behaves differently.
        """
        before, self._restored = self._restored, None
        if before is not None and self._next is not None:
            self._compare_told(method, state, before, self._next)
        running, restored = _copied(method), _copied(self._fresh)
        if running is None or restored is None:
            return
        with self._resuming("restore"):
            restored.restore({name: np.array(values) for name, values in state.items()})
        try:
            one = next_request(running)
        except Exception:  # the run may have ended, so that the method has nothing left to ask for
            return
        with self._resuming("ask"):
            other = next_request(restored)
            ways = [(each.wants, each.sharpness, each.minibatch) for each in (one, other)]
            same = ways[0] == ways[1] and _alike(one.points, other.points)
        if not same:
            raise self._refusal("it asks for other points", method, restored)
        self._restored = restored

    def _compare_told(self, method: Method, state: Arrays, restored: Method, told: tuple[Floats, Evaluation]) -> None:
        """Compare states after both have received the same evaluation; some lost state shows only then."""
        with self._resuming("tell"):
            restored.tell(*told)
        with self._resuming("state"):
            after = restored.state()
            unlike = [name for name in state if name not in after or not _alike(state[name], after[name])]
        if unlike:
            raise self._refusal(f"{unlike[0]} becomes another one", method, restored)

    @contextlib.contextmanager
    def _resuming(self, call: str) -> Iterator[None]:
        """Context for calls of a restored instance; an error means a faulty state, as the method itself raised none."""
        try:
            yield
        except Exception as error:
            if lacks_memory(error):
                raise
            said = said_by(error)
            if call == "restore" and isinstance(error, ValueError):  # its message says what is wrong
                raise ValueError(f"method: {self._name} cannot be restored from its own checkpoint: {said}") from error
            raise ValueError(
                f"method: {self._name} does not go on alike from its checkpoint: its {call} fails "
                f"({type(error).__name__}: {said}); all that changes must be in arrays"
            ) from error

    def _refusal(self, what: str, method: Method, restored: Method) -> ValueError:
        """Make the error that says what differs, and which numbers and arrays of the method were not restored."""
        unlike = [
            name
            for name, value in getattr(method, "__dict__", {}).items()
            if _has_numbers(value) and not _alike(value, getattr(restored, name, None))
        ]
        hint = f"{' and '.join(unlike)} of it must" if unlike else "all that changes must"
        return ValueError(f"method: {self._name} does not go on alike from its checkpoint: {what}; {hint} be in arrays")


def _copied(thing: Thing) -> Thing | None:
    """Return a deep copy; None if something in it cannot be copied, such as a lock."""
    try:
        return deepcopy(thing)
    except Exception:  # types differ: ValueError for a C pointer, RuntimeError for a Torch tensor
        return None


def _has_numbers(value: object) -> bool:
    return isinstance(value, bool | int | float | list | np.ndarray | np.generic)


def _alike(one: ArrayLike, other: Any) -> bool:
    """Whether numbers or arrays are equal, floats within ``TOLERANCE``; NaN equals NaN."""
    try:
        first, second = np.asarray(one), np.asarray(other)
    except ValueError:  # lists of several lengths
        if not isinstance(one, list) or not isinstance(other, list):
            return False
        return len(one) == len(other) and all(map(_alike, one, other))
    kinds = {first.dtype.kind, second.dtype.kind}
    if first.shape != second.shape or not kinds <= set("biufc") or kinds.isdisjoint("fc"):
        return np.array_equal(first, second)
    size = np.max(np.abs(first), initial=0.0, where=np.isfinite(first))
    return np.allclose(first, second, rtol=TOLERANCE, atol=TOLERANCE * float(size), equal_nan=True)
