"""Robots side by side, each in an episode: what environments of one robot and of many share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import choice, whole_number

if TYPE_CHECKING:
    from robots.view.motion import Motion

Observation = Floats
Gain = str | Callable[[dict[str, Any]], Any]  # a name, or a function of a user's own

SEEDS = 2**31  # of noise where an episode begins
FAILED_RETURN = -1.0  # of an episode in which the simulation diverges, whatever it gained before


class Batch(ABC):
    """B robots of one kind side by side, each in an episode; what one does depends on no other.

    A subclass tells how episodes begin, what actions do, and what ``info`` has.

    Attributes:
        count: B.
        observed: what one robot observes.
        acted: what it is told.
        seconds: that a step takes, of robots for which it is not always the same the usual ones.
        choices: an episode begins in one of so many ways; 0 if there is one way only.
        option: of ``reset`` that names the way, which is drawn without it; None if it is always drawn.
        together: whether all robots must begin their episodes at once.
    """

    choices = 0
    option: str | None = None
    together = True

    def __init__(self, count: int, observed: gymnasium.spaces.Box, acted: gymnasium.Space[Any], seconds: float) -> None:
        """Take the number of robots, the spaces of one, and the length of a step [s]."""
        self.count = whole_number("num_envs", count, 1)
        self.observed, self.acted, self.seconds = observed, acted, seconds

    @abstractmethod
    def begin(self, which: Ints, ways: Ints) -> Observation:
        """Begin episodes of some robots, in a way each; their first observations, shape (len(which), O)."""

    @abstractmethod
    def advance(self, actions: Floats) -> tuple[Observation, Floats, Bools, Bools]:
        """Apply an action each: observations, rewards, which reached their aim, and which diverged."""

    @abstractmethod
    def info(self) -> dict[str, Any]:
        """What people may want to know, arrays over the robots."""

    @abstractmethod
    def motion(self, robot: int) -> "Motion":
        """A motion of one frame: where a robot is, or was last when its numbers were finite."""

    @property
    def left(self) -> int | None:
        """Steps until episodes are cut off; None if they never are."""
        return None

    def way(self, options: dict[str, Any], generator: np.random.Generator) -> int:
        """The way in which an episode begins.

        Raises:
            ValueError: for an unknown option, or a number that is not allowed.
        """
        rest = [name for name in options if name != self.option]
        if rest:
            known = "there are none" if self.option is None else f"give {self.option}"
            raise ValueError(f"options: {rest[0]!r} is unknown; {known}")
        if not self.choices:
            return 0
        chosen = None if self.option is None else options.get(self.option)
        if chosen is None:
            return int(generator.integers(self.choices))
        if isinstance(chosen, bool) or not isinstance(chosen, int | np.integer) or not 0 <= chosen < self.choices:
            allowed = f"give a whole number from 0 to {self.choices - 1}"
            raise ValueError(f"{self.option}: {chosen!r} is not allowed; {allowed}")
        return int(chosen)


class Account:
    """What the robots of a batch observed and gained in their episodes.

    A robot that diverges keeps its last finite observation and loses all that it has gained, so that it never wins.

    Attributes:
        observed: last observations, within their bounds, shape (B, O).
        gained: since episodes began, shape (B,).
        ended: which reached their aim or diverged, shape (B,).
        failed: which diverged, shape (B,).
    """

    def __init__(self, batch: Batch) -> None:
        """Take the robots."""
        self._batch, self._space, count = batch, batch.observed, batch.count
        self.observed: Observation = np.tile(self._space.low, (count, 1))
        self.gained: Floats = np.zeros(count)
        self.ended, self.failed = np.zeros(count, bool), np.zeros(count, bool)

    def begin(self, which: Ints, observed: Observation) -> None:
        """Note the first observations of episodes that begin."""
        self.observed[which] = np.clip(observed, self._space.low, self._space.high)
        self.gained[which], self.ended[which], self.failed[which] = 0.0, False, False

    def book(self, observed: Observation, gained: Floats, reached: Bools, failed: Bools) -> Floats:
        """Note what a step brought; the rewards, shape (B,). Episodes that have ended bring nothing."""
        failed = failed & ~self.ended
        reward = np.where(self.ended, 0.0, np.where(failed, FAILED_RETURN - self.gained, gained))
        kept = (self.ended | failed)[:, None]
        self.observed = np.where(kept, self.observed, np.clip(observed, self._space.low, self._space.high))
        self.gained, self.failed = self.gained + reward, self.failed | failed
        self.ended = self.ended | failed | reached
        return reward

    def info(self) -> dict[str, Any]:
        """What the batch tells, and which robots diverged, arrays over the robots."""
        return {**self._batch.info(), "diverged": self.failed.copy()}


def checked_gain(gain: Any, names: Sequence[str]) -> Gain:
    """What rewards count: a name, or a function of ``info`` that says what B robots have gained so far, shape (B,).

    Raises:
        ValueError: for anything else.
    """
    return gain if callable(gain) else choice("gain", gain, names)


def gained_by(gain: Callable[[dict[str, Any]], Any], info: dict[str, Any], lost: Bools) -> Floats:
    """What a user's function says that robots have gained, shape (B,); whatever it says of those that are lost.

    Raises:
        ValueError: if it does not give a number for each robot.
    """
    given = {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in info.items()}
    try:
        found = np.asarray(gain(given), float)
    except KeyError as error:
        raise ValueError(f"gain: the function asks for {error}, which info does not have; {', '.join(info)}") from None
    if found.shape != lost.shape:
        raise ValueError(f"gain: the function gives shape {found.shape}; give a number for each robot, {lost.shape}")
    if not np.isfinite(found[~lost]).all():
        raise ValueError("gain: the function gives a number that is not finite; give what robots have gained so far")
    return found


def checked_actions(space: gymnasium.Space[Any], actions: Any) -> Floats:
    """Actions as numbers.

    Raises:
        ValueError: for actions that are not in the space.
    """
    given = np.asarray(actions)
    if given.dtype.kind in "biuf":
        given = _in_type_of(space, given)
    if not space.contains(given):
        text = np.array2string(given, threshold=12)
        raise ValueError(f"action: {text!r} is not allowed; give one of {space}")
    found: Floats = given.astype(np.float64)
    return found


def _in_type_of(space: gymnasium.Space[Any], given: np.ndarray) -> np.ndarray:
    """Numbers in the type of a space; as they are where that is of whole numbers and would make others of them."""
    with np.errstate(invalid="ignore"):  # numbers beyond the range of the type
        cast = given.astype(space.dtype or float)
    return cast if cast.dtype.kind == "f" or np.array_equal(cast, given) else given
