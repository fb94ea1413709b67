"""Rehearsals of a resume: whether a search method goes on from its own checkpoints as if nothing had happened."""

from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation
from optim.search.method import Method, next_request
from taichi_sim.base.arrays import Arrays, Floats

REHEARSED = 3  # generations of a run: what a method must keep changes in the first ones
TOLERANCE = 1e-9  # relative: what is forgotten shows in more than last bits


class Rehearsal:
    """A second instance of a method that is restored from each of a run's first checkpoints, and must do the same.

    Without it, a state that a method of a package does not give, or cannot take back, is noticed after a kill at the
    earliest. All is done on copies, so the method itself gives the same bits.
    """

    def __init__(self, name: str, method: Method) -> None:
        """For a method, by its name, that is not yet used."""
        self._name, self._fresh = name, _copied(method)
        self._restored: Method | None = None

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Tell the instance restored from the checkpoint before, if there is one, what the method is told next."""
        if self._restored is not None:
            self._restored.tell(*deepcopy((points, evaluation)))

    def check(self, method: Method, state: Arrays) -> None:
        """Compare a method and its state at the end of a generation, and restore another instance from that.

        Raises:
            ValueError: if what is restored from a checkpoint does otherwise.
        """
        running, restored = _copied(method), deepcopy(self._fresh)
        if running is None or restored is None:
            return
        if self._restored is not None:  # some of what is forgotten matters only to how a method takes what it is told
            told = self._restored.state()
            for name in state:
                if name not in told or not _alike(state[name], told[name]):
                    raise self._refusal(f"{name} becomes another one", method, self._restored)
        try:
            restored.restore({name: np.array(values) for name, values in state.items()})
        except (KeyError, ValueError, IndexError) as error:
            raise ValueError(f"method: {self._name} cannot be restored from its own checkpoint: {error}") from error
        one, other = next_request(running), next_request(restored)
        ways = [(each.wants, each.sharpness, each.minibatch) for each in (one, other)]
        if ways[0] != ways[1] or not _alike(one.points, other.points):
            raise self._refusal("it asks for other points", method, restored)
        self._restored = restored

    def _refusal(self, what: str, method: Method, restored: Method) -> ValueError:
        """Says what differs, and which numbers and arrays of the method were not restored."""
        unlike = [
            name
            for name, value in vars(method).items()
            if _has_numbers(value) and not _alike(value, getattr(restored, name, None))
        ]
        hint = f"{' and '.join(unlike)} of it must" if unlike else "all that changes must"
        return ValueError(f"method: {self._name} does not go on alike from its checkpoint: {what}; {hint} be in arrays")


def _copied(method: Method) -> Method | None:
    """A copy; None of a method that holds what cannot be copied, such as a lock."""
    try:
        return deepcopy(method)
    except TypeError:
        return None


def _has_numbers(value: object) -> bool:
    return isinstance(value, bool | int | float | list | np.ndarray | np.generic)


def _alike(one: ArrayLike, other: Any) -> bool:
    """Whether numbers or arrays are the same but for last bits; NaN is like NaN."""
    try:
        first, second = np.asarray(one), np.asarray(other)
    except ValueError:  # lists of several lengths
        return one == other
    if first.shape != second.shape or not {first.dtype.kind, second.dtype.kind} <= set("biuf"):
        return np.array_equal(first, second)
    size = np.max(np.abs(first), initial=0.0, where=np.isfinite(first))
    return np.allclose(first, second, rtol=TOLERANCE, atol=TOLERANCE * float(size), equal_nan=True)
