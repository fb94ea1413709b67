"""Switching between gaits by what is sensed: scores of grounds, and hysteresis that keeps from switching to and fro."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base import checks
from taichi_sim.base.arrays import Bools, Floats, Ints

RIDGE_PENALTY = 1e-2  # of the squared weights of features that vary by 1, against the mean squared error


@dataclass(frozen=True, eq=False)
class Switching:
    """When a machine changes its gait: it guesses on which of T grounds it is, and plays the gait for that ground.

    A score of every ground is linear in features of what was sensed in the last looks, see :func:`features`; there are
    weights for each of the G gaits that it may be playing, as gaits feel different on the same ground.

    Attributes:
        weights: shape (G, T, F + 1), by the gait that is played, the ground and the feature; the last is added.
        answers: the gait for each ground, T whole numbers below G.
        window: how many looks the features are of.
        margin: by how much the score of another gait's ground must exceed the best one of the gait that is played.
        stay: looks for which a gait is kept at least.

    Raises:
        ValueError: one line that names the field, the value and what is allowed.
    """

    weights: Floats
    answers: tuple[int, ...]
    window: Annotated[int, partial(checks.whole_number, low=1)] = 16
    margin: Annotated[float, partial(checks.number, low=0.0)] = 0.0
    stay: Annotated[int, partial(checks.whole_number, low=0)] = 0

    def __post_init__(self) -> None:
        checks.check_fields(self)
        weights = np.array(self.weights, float)
        if weights.ndim != 3 or not np.isfinite(weights).all():
            raise ValueError(
                f"weights: shape {weights.shape} is not allowed; give finite numbers, (gaits, grounds, F + 1)"
            )
        weights.setflags(write=False)
        object.__setattr__(self, "weights", weights)
        answers = tuple(checks.whole_number("answers", gait, 0) for gait in self.answers)
        object.__setattr__(self, "answers", answers)
        if len(answers) != weights.shape[1] or max(answers) >= len(weights):
            allowed = f"{weights.shape[1]} numbers below {len(weights)}"
            raise ValueError(f"answers: {answers} is not allowed; give {allowed}, a gait for each ground")

    def scores(self, gaits: Ints, felt: Floats) -> Floats:
        """Scores of the grounds, shape (B, T), for machines that play gaits (B,) and have features (B, F)."""
        weights = self.weights[gaits]
        found: Floats = (weights[..., :-1] * felt[:, None, :]).sum(axis=2) + weights[..., -1]
        return found

    def chosen(self, gaits: Ints, since: Ints, felt: Floats) -> Ints:
        """The gaits to play next, shape (B,).

        Args:
            gaits: that are played, shape (B,).
            since: looks since each began, shape (B,).
            felt: features, shape (B, F).
        """
        scores, answers = self.scores(gaits, felt), np.array(self.answers)
        kept = np.where(answers[None, :] == gaits[:, None], scores, -np.inf).max(axis=1)
        best = scores.argmax(axis=1)
        change = (since >= self.stay) & (scores.max(axis=1) > kept + self.margin)
        return np.where(change, answers[best], gaits)


def features(looks: Floats) -> Floats:
    """Means and standard deviations of readings over some looks, shape (B, W, S): shape (B, 2 S)."""
    return np.concatenate([looks.mean(axis=1), looks.std(axis=1)], axis=1)


def fitted(felt: Floats, gaits: Ints, grounds: Ints, shape: tuple[int, int]) -> Floats:
    """Weights of scores by ridge regression of 1 on the true ground and 0 elsewhere, each ground counting alike.

    Args:
        felt: features of N looks, shape (N, F).
        gaits: that were played, shape (N,).
        grounds: where, shape (N,).
        shape: G and T.

    Returns:
        Shape (G, T, F + 1). A ground that a gait has not met scores 0 while it is played; a gait that was never played
        has the weights of all looks together.
    """
    found = np.zeros((shape[0], shape[1], felt.shape[1] + 1))
    for gait in range(shape[0]):
        which = gaits == gait if (gaits == gait).any() else np.ones(len(gaits), bool)
        found[gait] = _ridge(felt[which], grounds[which], shape[1])
    return found


def _ridge(felt: Floats, grounds: Ints, count: int) -> Floats:
    """Weights of the scores of so many grounds, shape (count, F + 1)."""
    middle, spread = felt.mean(axis=0), np.maximum(felt.std(axis=0), 1e-9)
    inputs = np.column_stack([(felt - middle) / spread, np.ones(len(felt))])
    each = np.bincount(grounds, minlength=count)
    weight = (1.0 / np.maximum(each, 1))[grounds] / max((each > 0).sum(), 1)
    penalty = RIDGE_PENALTY * np.append(np.ones(felt.shape[1]), 0.0)
    normal = (inputs * weight[:, None]).T @ inputs + np.diag(penalty)
    solved = np.linalg.solve(normal, (inputs * weight[:, None]).T @ np.eye(count)[grounds])
    scaled = solved[:-1] / spread[:, None]
    return np.vstack([scaled, solved[-1] - middle @ scaled]).T


class Switcher:
    """B machines that switch, one look after the other.

    Attributes:
        gaits: that they play, shape (B,).
    """

    def __init__(self, switching: Switching, gaits: ArrayLike) -> None:
        """Start machines that play some gaits, shape (B,)."""
        self.switching, self.gaits = switching, np.array(gaits, int)
        self._since, self._looks = np.zeros(len(self.gaits), int), list[Floats]()

    def look(self, felt: Floats) -> Ints:
        """Take a reading, shape (B, S); the gaits to play now. None changes until a window is full."""
        self._looks = [*self._looks, felt][-self.switching.window :]
        self._since += 1
        if len(self._looks) == self.switching.window:
            chosen = self.switching.chosen(self.gaits, self._since, features(np.stack(self._looks, axis=1)))
            self._since[chosen != self.gaits] = 0
            self.gaits = chosen
        return self.gaits.copy()


def steady(labels: Sequence[ArrayLike] | Ints, window: int) -> Bools:
    """Whether labels have been the same for a window up to each look, shape (B, L), whatever came before."""
    given = np.asarray(labels)
    found = np.zeros(given.shape, bool)
    for look in range(window - 1, given.shape[1]):
        found[:, look] = (given[:, look - window + 1 : look + 1] == given[:, look, None]).all(axis=1)
    return found
