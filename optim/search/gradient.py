"""Gradient ascent from many starts, with binary variables relaxed to numbers from 0 to 1."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from optim.problem import Evaluation
from optim.search import method
from optim.search.base import number, positive, whole
from optim.search.independent import IndependentSearches, best_of_each
from optim.search.step_rules import LBFGS, Adam, StepRule, free_variables
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Bools, Floats

PROGRESS = 1e-4  # of the best value of an ascent: a smaller gain is none
MOST = 1e12  # that a setting may be
ENOUGH = 1e-4  # of the gain that the gradient promised, for a monotone rule (Armijo)


@dataclass(eq=False, kw_only=True)
class GradientAscent(IndependentSearches):
    """Search by gradient ascent: C climbers follow the gradient and restart at random when they get nowhere.

    Where variables are binary, generations alternate: an even one evaluates the true points next to where the
    climbers are (the starts in generation 0), an odd one evaluates the relaxed points themselves with their
    gradients, and moves them. Elsewhere every generation does all of it. ``sharpness`` doubles from 1 to
    ``sharpest``, which makes values between 0 and 1 ever less useful (continuation, as in topology optimisation:
    Wang, Lazarov & Sigmund, Struct. Multidisc. Optim. 43, 2011).

    A point that failed, or whose gradient did, is taken back half way to the last that did not. The gradient of a
    landscape of cliffs and plateaus says nothing: ``gradient="smoothed"`` climbs its mean under normal deviates,
    with antithetic pairs (evolution strategies: Salimans et al., arXiv:1703.03864, sec. 2.1).

    Attributes:
        start: values by name with which every climber starts, again and again; the others are random.
        rule: step rule, ``"adam"`` or ``"l-bfgs"``.
        learning_rate: typical step of Adam and first step of L-BFGS [ranges of the variables].
        clip: length to which Adam shortens longer gradients [objective per range].
        gradient: ``"exact"`` from the problem; ``"smoothed"`` estimated here, by ``2 * samples`` evaluations.
        samples: antithetic pairs of a smoothed gradient.
        smoothing: standard deviation of these pairs [ranges].
        sharpest: largest sharpness.
        stage: moves between two doublings of the sharpness.
        patience: moves without progress before a climber restarts.
        candidates: random points of which a climber starts at the best, judged in a generation of their own
            unless it is a single one.
        verify: evaluate true points in their own generations even if no variable is binary, for a problem
            that judges relaxed points differently.
    """

    through_mixtures = True
    takes_gradients = True

    points_of_climbers: ClassVar[tuple[str, ...]] = ("here", "anchor", "slope", "step")
    arrays: ClassVar[tuple[str, ...]] = (*points_of_climbers, "value", "scale", "record", "stalled", "seeking")

    rule: Literal["adam", "l-bfgs"] = "adam"
    learning_rate: float = positive(0.05, MOST)
    clip: float = positive(1.0, MOST)
    gradient: Literal["exact", "smoothed"] = "exact"
    samples: int = whole(8, 1, method.MOST_POINTS)
    smoothing: float = positive(0.05, MOST)
    sharpest: float = number(8.0, 1.0, MOST)
    stage: int = whole(20, 1)
    patience: int = whole(20, 1)
    candidates: int = whole(1, 1, method.MOST_POINTS)
    verify: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self.relaxed = self.space.relaxed()
        method.refuse_integers(self.space)
        self.exact = self.gradient == "exact"
        if not self.exact:
            checks.integer("samples", self.samples, 1, method.MOST_POINTS // (2 * self.climbers))
        checks.integer("candidates", self.candidates, 1, method.MOST_POINTS // self.climbers)
        if self.rule == "l-bfgs" and not self.exact:
            raise ValueError("rule: 'l-bfgs' is not allowed with smoothed gradients, which are noisy; choose adam")
        self.binary = self.space.mixes
        self.alternates = self.verify or self.binary
        climbers, rate = self.climbers, self.learning_rate
        shape = (climbers, self.space.size)
        self.steps: StepRule = LBFGS(*shape, rate) if self.rule == "l-bfgs" else Adam(*shape, rate, self.clip)
        self.here = np.empty(shape)  # what is evaluated
        # The last point that did not fail, its slope [objective per range] and the step from there; its value, how
        # much of the step to go, the best value, and the number of moves since it rose.
        self.anchor, self.slope, self.step = np.empty((3, *shape))
        self.value, self.scale, self.record, self.stalled = np.empty((4, climbers))
        self.seeking = np.zeros(climbers, bool)  # whose starts are to be chosen
        self._restart(np.ones(climbers, bool))

    @property
    def wants(self) -> method.Wants:
        """Points of the space and relaxed points in turns; always relaxed points where both are the same."""
        if self.seeking.any():
            return "relaxed"
        if self.alternates and self.generation % 2 == 0:
            return "points"
        return "gradients" if self.exact else "relaxed"

    @property
    def sharpness(self) -> float:
        """Sharpness of relaxed points, which doubles every ``stage`` moves; 0 if no variable is binary."""
        doublings = (self.generation // 2) // self.stage
        return min(2.0 ** min(doublings, 1000), self.sharpest) if self.binary else 0.0

    def ask(self) -> Floats:
        """Return a point per climber, shape (C, D); samples of smoothed gradients, (C * 2 * samples, D); or starts."""
        if self.seeking.any():
            return self._starts()
        if self.wants == "points":
            return self.space.round(self.here)
        if self.exact:
            return self.here.copy()
        away = self.smoothing * self._deviates() * self.space.span
        centres = self.here[:, None]
        points = np.stack([centres + away, centres - away], axis=1)
        return self.relaxed.bound(points).reshape(-1, self.space.size)

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Keep true points that are better; move the climbers after relaxed points, unless these are starts."""
        scores = method.single_objective(evaluation, len(points))
        if self.seeking.any():
            self._choose(points, scores)
            return
        if self.wants == "points":
            self.stalled[self._keep(points, scores)] = 0
            self._advance()
            return
        if not self.alternates:
            self._keep(*best_of_each(points, scores, self.climbers))
        if self.exact:
            values, slopes = scores, method.slopes_per_range(evaluation, self.space, self.climbers)
        else:
            values, slopes = self._smoothed(scores)
        self._advance()  # the streams of restarts are those of the generation to come
        self._move(values, slopes)

    def _starts(self) -> Floats:
        """Random points, ``candidates`` for each climber that seeks a start."""
        return self._random_starts(self.relaxed, np.flatnonzero(self.seeking).tolist(), self.candidates, 2)

    def _choose(self, points: Floats, scores: Floats) -> None:
        """Let each climber that seeks a start have its best; the generation goes on with these."""
        best = np.full(self.climbers, np.nan)
        self.here[self.seeking], best[self.seeking] = best_of_each(points, scores, int(self.seeking.sum()))
        if not self.alternates:
            self._keep(self.here, best)
        self.seeking = np.zeros(self.climbers, bool)

    def _advance(self) -> None:
        """Start the next generation; where its sharpness is new, drop values, which cannot be compared any more."""
        before = self.sharpness
        self.generation += 1
        if self.sharpness != before:
            self.value[:] = self.record[:] = -np.inf
            self.stalled[:] = 0
            self.steps.forget(np.ones(self.climbers, bool))

    def _smoothed(self, scores: Floats) -> tuple[Floats, Floats]:
        """Values and slopes of the mean under normal deviates, from the pairs that did not fail; else NaN."""
        up, down = np.moveaxis(scores.reshape(self.climbers, 2, self.samples), 1, 0)
        valid = (abs(up) < method.LARGEST) & (abs(down) < method.LARGEST)
        count = np.where(valid.any(axis=1), valid.sum(axis=1), np.nan)
        up, down = np.where(valid, up, 0.0), np.where(valid, down, 0.0)
        values = (up + down).sum(axis=1) / (2 * count)
        rises = (up - down)[..., None] * self._deviates()
        return values, rises.sum(axis=1) / (2 * self.smoothing * count[:, None])

    def _deviates(self) -> Floats:
        """Standard normal, shape (C, samples, D), the same as often as asked in a generation."""
        rngs = [method.generator(self.seed, self.generation, climber, 1) for climber in range(self.climbers)]
        return np.stack([rng.standard_normal((self.samples, self.space.size)) for rng in rngs])

    def _move(self, values: Floats, slopes: Floats) -> None:
        """Go on from the points just judged, or half way back; restart what is lost or stalled."""
        valid = method.sound(values, slopes)
        values, slopes = np.where(valid, values, -np.inf), np.where(valid[:, None], slopes, 0.0)
        moved = self.relaxed.offset(self.here, self.anchor)
        accepted = valid
        if self.steps.monotone:
            promised = np.nansum(self.slope * moved, axis=1)
            accepted = valid & ~(values < self.value + ENOUGH * promised)
        self.steps.learn(accepted & np.isfinite(self.value), moved, slopes - self.slope)
        self.anchor = np.where(accepted[:, None], self.here, self.anchor)
        self.value = np.where(accepted, values, self.value)
        self.slope = np.where(accepted[:, None], slopes, self.slope)
        steps = self.steps.steps(accepted, self.slope, free_variables(self.space, self.anchor, self.slope))
        self.step = np.where(accepted[:, None], steps, self.step)
        self.scale = np.where(accepted, np.minimum(1.0, 2 * self.scale), self.scale / 2)
        self.here = self.relaxed.bound(self.anchor + self.scale[:, None] * self.step * self.space.span)

        known = np.isfinite(self.record)
        hurdle = np.where(known, self.record + PROGRESS * np.where(known, abs(self.record), 0.0), -np.inf)
        self.stalled = np.where(values > hurdle, 0.0, self.stalled + 1)
        self.record = np.maximum(self.record, values)
        lost = ~valid & np.isnan(self.anchor).any(axis=1)  # its start failed
        flat = accepted & (self.step == 0).all(axis=1)  # a plateau, or a summit
        self._restart(lost | flat | (self.stalled >= self.patience))

    def _restart(self, climbers: Bools) -> None:
        """Let some climbers begin anew, at a random point of the relaxed space."""
        self.seeking = climbers & (self.candidates > 1)
        self.here[climbers] = self._random_starts(self.relaxed, np.flatnonzero(climbers).tolist())
        self.anchor[climbers], self.scale[climbers] = np.nan, 1.0
        self.value[climbers] = self.record[climbers] = -np.inf
        self.slope[climbers] = self.step[climbers] = 0.0
        self.stalled[climbers] = 0.0
        self.steps.forget(climbers)

    def _groups(self) -> Mapping[str, Arrays]:
        return {"rule": self.steps.arrays}
