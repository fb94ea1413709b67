"""Objectives by name: which measures a search maximises or minimises, with which weights, and over which worlds.

A goal is written ``NAME``, ``WEIGHT*NAME``, ``minimise:NAME`` or ``minimise:WEIGHT*NAME``. Its name is a measure of the
robot, or an objective that an installed package adds. The words ``mean``, ``each`` and ``worst`` among goals say how
worlds are combined, each goal by itself. Limits among them, such as ``mass <= 0.1``, cost score where they are broken,
see ``optim.problems.limits``.

Searches maximise all that they are told, so a goal that is minimised is told negated: as ``minus energy``.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optim.problem import Objective
from optim.problems.limits import Limit, Missing
from optim.problems.objectives import OBJECTIVES, RobotObjective
from robots.robot import Measure, Outcome, World
from robots.tasks import Success, is_bound
from robots.uncertainty import Score
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import nearest, shown
from taichi_sim.base.short_text import shortest

MINIMISE = "minimise:"
WORDS = tuple(OBJECTIVES.builtin)  # how worlds are combined
WAYS = ("objectives", "values", "gradients", "named", "combined", "combined_slopes")  # to combine worlds
Names = str | tuple[str, ...]  # one objective of the registry, or how worlds are combined and then the goals


@dataclass(frozen=True)
class Goal:
    """A number that a search maximises, or minimises, with a weight.

    Attributes:
        name: of a measure, or of an objective in ``OBJECTIVES``.
        weight: of it in a sum, above 0; an objective by itself has its weight, too.
        minimised: whether less is better.
    """

    name: str
    weight: float = 1.0
    minimised: bool = False

    @classmethod
    def of(cls, text: str) -> "Goal":
        """Parse a goal from text.

        Raises:
            ValueError: for a weight that is not allowed.
        """
        rest = text.removeprefix(MINIMISE)
        weight, star, name = rest.rpartition("*")
        try:
            number = float(weight) if star else 1.0
        except ValueError:
            number = math.nan
        if not (0 < number < math.inf) or not name or ":" in name:
            hint = "; what shall be low is minimise:NAME" if number < 0 else ""
            raise ValueError(
                f"objective: {text!r} is not allowed; give NAME, WEIGHT*NAME, minimise:NAME or minimise:WEIGHT*NAME "
                f"with a finite weight above 0{hint}"
            )
        return cls(name, number, rest != text)

    @property
    def text(self) -> str:
        """The goal as text, always the same for the same goal."""
        return (MINIMISE if self.minimised else "") + self.weighted(self.name)

    @property
    def factor(self) -> float:
        """Factor that turns a score into a value to maximise: the weight, negative if minimised."""
        return -self.weight if self.minimised else self.weight

    def weighted(self, name: str) -> str:
        """Prefix a name with the weight, unless the weight is 1."""
        return name if self.weight == 1 else f"{shortest(self.weight)}*{name}"

    def renamed(self, one: Objective) -> Objective:
        """The name by which searches call an objective with the weight and the sign of this goal."""
        return Objective(("minus " if self.minimised else "") + self.weighted(one.name), one.unit)


def named(given: Sequence[str] | str, usual: str = "mean") -> Names:
    """Normalise the setting ``objective``: the name of one objective, or how worlds are combined, then the goals.

    Args:
        given: words and goals, in any order.
        usual: how worlds are combined unless a word says so.

    Raises:
        ValueError: for two words, a goal given twice, a text that is no goal, and limits of nothing.
    """
    texts = [given] if isinstance(given, str) else list(given) if isinstance(given, Iterable) else [given]
    if not all(isinstance(text, str) for text in texts):
        raise ValueError(
            f"objective: {shown(given)} is not allowed; give names; one of your own gets its by an entry point"
        )
    if len(texts) == 1 and texts[0] in OBJECTIVES:
        return texts[0]
    words = [text for text in texts if text in WORDS]
    if len(words) > 1:
        raise ValueError(f"objective: {words[0]} and {words[1]} both say how worlds are combined; give one of them")
    limits = list(dict.fromkeys(Limit.of(text).text for text in texts if is_bound(text)))
    goals = [Goal.of(text) for text in goals_in(texts)]
    if limits and not goals:
        raise ValueError(f"objective: {limits[0]} is a limit; name what is raised or minimised within it, too")
    for number, goal in enumerate(goals):
        if goal.name in WORDS:
            raise ValueError(f"objective: {goal.text!r} is not allowed; {goal.name} says how worlds are combined")
        if goal.name in (other.name for other in goals[:number]):
            raise ValueError(f"objective: {goal.name} is given twice; name each once")
    word = words[0] if words else usual
    return (word, *(goal.text for goal in goals), *limits) if goals else word


def goals_in(texts: Sequence[str]) -> list[str]:
    """The texts that are goals: neither limits nor words that say how worlds are combined."""
    return [text for text in texts if text not in WORDS and not is_bound(text)]


def objective_of(names: Names, measures: Sequence[Measure], summed: bool) -> RobotObjective:
    """Build the objective of robots from a name in the registry, or from goals after a name for how worlds combine.

    Args:
        names: see :func:`named`.
        measures: that the robot offers.
        summed: whether goals add up to one objective; else each is one.

    Raises:
        ValueError: for a name that is unknown or of two things, or goals that cannot be combined so.
    """
    known = {measure.name: measure for measure in measures}
    if isinstance(names, str):
        _check_apart(names, known)
        return OBJECTIVES.find(names)()
    parts = []
    for goal in map(Goal.of, goals_in(names)):
        _check_apart(goal.name, known)
        if goal.name not in OBJECTIVES and goal.name not in known:
            raise _unknown(goal.name, known, [name for name in OBJECTIVES if name not in WORDS])
        scored = OBJECTIVES[goal.name]() if goal.name in OBJECTIVES else RobotObjective()
        parts.append(Part(goal, scored, None if goal.name in OBJECTIVES else known[goal.name], names[0]))
    limits, over = [], "worst" if names[0] == "worst" else "mean"
    for limit in map(Limit.of, filter(is_bound, names)):
        if limit.bound.measure not in known:
            raise _unknown(limit.bound.measure, known, [])
        lost = Goal(limit.bound.measure, limit.loss, minimised=True)
        limits.append(Part(lost, Missing(limit.bound), known[limit.bound.measure], over))
    return Goals(tuple(parts), names[0], summed, tuple(limits))


def _unknown(name: str, known: Collection[str], others: Sequence[str]) -> ValueError:
    """What is said of a name that is neither one of the measures nor one of the other objectives."""
    hint = nearest(name, [*known, *others, *(WORDS if others else ())]).removeprefix("; ")
    return ValueError(
        f"objective: {name!r} is unknown; {hint + ' all' if hint else 'choose one of the'} measures: "
        f"{', '.join(known)}{'; objectives: ' if others else ''}{', '.join(others)}"
    )


def _check_apart(name: str, known: Collection[str]) -> None:
    """Refuse an objective of a package that is called as a measure of the robot, as it would be taken for that."""
    if name in known and name in OBJECTIVES and name not in OBJECTIVES.builtin:
        raise ValueError(
            f"objective: {name!r} is both a measure of the robot and an objective of an installed package; give "
            "another one, or have the package rename its own"
        )


@dataclass(frozen=True)
class Part:
    """A goal, with the objective that combines its scores in several worlds.

    Attributes:
        goal: with weight and sign.
        scored: tells the score in one world; one that combines worlds in a way of its own does that, too.
        measure: that it is about; None for the one that the problem names.
        word: how worlds are combined.

    Raises:
        ValueError: if two ways to combine worlds are asked for.
    """

    goal: Goal
    scored: RobotObjective
    measure: Measure | None
    word: str

    def __post_init__(self) -> None:
        if self.combines and self.word != "mean":
            raise ValueError(
                f"objective: {self.goal.name} combines worlds in its own way; give mean instead of {self.word}"
            )

    @property
    def combines(self) -> bool:
        """Whether an objective from another package combines the worlds in its own way."""
        return not self.scored.own.isdisjoint(WAYS)

    @cached_property
    def over(self) -> RobotObjective:
        """The objective that combines the worlds."""
        return self.scored if self.combines else OBJECTIVES[self.word]()

    def measure_for(self, usual: Measure) -> Measure:
        """The measure of the goal: its own, or the usual one if it names none."""
        return self.measure or usual

    def objectives(self, usual: Measure, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """Names and units of the maximised objectives."""
        measure = self.measure_for(usual)
        if self.combines:
            return tuple(map(self.goal.renamed, self.scored.objectives(measure, worlds)))
        return tuple(map(self.goal.renamed, self.over.named(self.scored.objective(measure), worlds)))

    def values(self, outcomes: Sequence[Outcome], usual: Measure) -> Floats:
        """Compute the values to maximise, shape (N, K)."""
        if self.combines:
            return self.goal.factor * self.scored.values(outcomes, self.measure_for(usual))
        return self.over.combined(self.scores(outcomes, usual))

    def gradients(self, outcomes: Sequence[Outcome], usual: Measure) -> Floats:
        """Compute derivatives of the maximised value by the parameters, shape (N, P)."""
        measure = self.measure_for(usual)
        if self.combines:
            return self.goal.factor * self.scored.gradients(outcomes, measure)
        slopes = self.goal.factor * self.scored.slopes_in(outcomes, measure)
        return self.over.combined_slopes(self.scores(outcomes, usual), slopes)

    def scores(self, outcomes: Sequence[Outcome], usual: Measure) -> Floats:
        """Scores with weight and sign, shape (W, N): the worst of what is minimised is the largest."""
        return self.goal.factor * self.scored.scores_in(outcomes, self.measure_for(usual))


@dataclass(frozen=True)
class Goals(RobotObjective):
    """Several goals, each an objective or one for each world, or all of them one objective, their weighted sum.

    Attributes:
        parts: the goals.
        word: how worlds are combined.
        summed: whether they add up.
        limits: what each objective loses where limits are not kept.

    Raises:
        ValueError: if a sum is asked for each world by itself.
    """

    parts: tuple[Part, ...]
    word: str
    summed: bool
    limits: tuple[Part, ...] = ()

    def __post_init__(self) -> None:
        if self.summed and self.word == "each":
            raise ValueError("objective: each needs a method for several objectives; choose mean or worst")

    @property
    def measures(self) -> tuple[Measure, ...]:
        """The measures of the goals that name one."""
        return tuple(part.measure for part in self.parts if part.measure)

    @property
    def names_all(self) -> bool:
        """Whether every goal is a measure."""
        return len(self.measures) == len(self.parts)

    def spoken(self, measure: Measure) -> str:
        """Description of the maximised and minimised measures, for people."""
        text = ""
        for part in self.parts:
            one = Objective(part.measure.spoken, part.measure.unit) if part.measure else part.scored.objective(measure)
            told = part.goal.weighted(one.name).replace("*", " × ", 1) + (f" ({one.unit})" if one.unit else "")
            minimised = part.goal.minimised
            if self.summed and text:
                text += (" minus " if minimised else " plus ") + told
            else:
                text += ("; " if text else "") + ("minimised: " if minimised else "") + told
        return text + self._where

    def differentiated(self, measure: Measure) -> tuple[str, ...]:
        """Names of the measures of all goals."""
        if self.word == "each" or (len(self.parts) > 1 and not self.summed):
            raise ValueError("objective: several have no single gradient; choose a method for one objective")
        needed = [name for part in self.terms for name in part.scored.differentiated(part.measure_for(measure))]
        return tuple(dict.fromkeys(needed))

    def objectives(self, measure: Measure, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """The objectives of all goals in their order, or their sum; each name says ``where`` limits are kept."""
        each = tuple(one for part in self.parts for one in part.objectives(measure, worlds))
        if not self.summed:
            return tuple(Objective(one.name + self._where, one.unit) for one in each)
        if len(each) > len(self.parts):
            names = ", ".join(one.name for one in each)
            raise ValueError(f"objective: {names} have no sum; choose a method for several objectives")
        return (self.sum_of(each),)

    def values(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """A column for each objective, or the sum; each less what limits cost."""
        each = np.concatenate([part.values(outcomes, measure) for part in self.parts], axis=1)
        found = each.sum(axis=1, keepdims=True) if self.summed else each
        return np.asarray(found - self.lost(outcomes, measure)[:, None] if self.limits else found)

    def lost(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """Loss of each objective to broken limits, shape (N,)."""
        return np.asarray(-np.sum([part.values(outcomes, measure)[:, 0] for part in self.limits], axis=0))

    def gradients(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """Derivatives of the sum of the goals by the parameters, shape (N, P)."""
        return np.asarray(np.sum([part.gradients(outcomes, measure) for part in self.terms], axis=0))

    def sum_of(self, each: Sequence[Objective]) -> Objective:
        """Name and unit of the sum of objectives, such as ``speed minus 0.1*energy where mass <= 0.1``."""
        units = {one.unit for one in each}
        name = " plus ".join(one.name for one in each).replace(" plus minus ", " minus ")
        return Objective(name + self._where, units.pop() if len(units) == 1 else "")

    @property
    def terms(self) -> tuple[Part, ...]:
        """Terms of the sum: the goals, and the loss to limits."""
        return *self.parts, *self.limits

    @property
    def bounds(self) -> tuple[Success, ...]:
        """Limits that the designs should keep."""
        return tuple(part.scored.bound for part in self.limits if isinstance(part.scored, Missing))

    @property
    def _where(self) -> str:
        """The part of an objective's name that says which limits are kept, such as ``where mass <= 0.1``."""
        return f" where {' and '.join(bound.text for bound in self.bounds)}" if self.limits else ""


def score_in_each(objective: RobotObjective, measure: Measure) -> Score | None:
    """Scores of an objective in each world by itself, with weight and sign.

    Args:
        objective: of a search.
        measure: that it is about where it names none.

    Returns:
        None for several goals that do not add up, and for a package's objective that combines worlds in its own way.
    """
    if not isinstance(objective, Goals):
        if type(objective) not in map(OBJECTIVES.get, WORDS) and not objective.own.isdisjoint(WAYS):
            return None
        told = objective.objective(measure)
        return Score(told.name, told.unit, lambda outcome: objective.scores_in([outcome], measure)[0])
    parts = objective.parts
    if any(part.combines for part in parts) or (len(parts) > 1 and not objective.summed):
        return None
    told = objective.sum_of([part.goal.renamed(part.scored.objective(part.measure_for(measure))) for part in parts])

    def summed(outcome: Outcome) -> Floats:
        return np.asarray(np.sum([part.scores([outcome], measure)[0] for part in objective.terms], axis=0))

    return Score(told.name, told.unit, summed)
