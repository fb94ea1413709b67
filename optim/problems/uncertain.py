"""Design problems with uncertain quantities: their settings, scores over common draws, and held-out draws."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from robots.robot import OK, Outcome, Robot, Trial, World
from robots.uncertainty import JUDGED_DRAWS, Risk, Score, Uncertainty, judge_uncertain
from robots.world import terrain_of
from taichi_sim.base.arrays import Floats, Indices
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text

ROBUST_FILE = "robust.json"


MOST_DRAWS = 1000
DRAWS = 16  # of what is uncertain, in a search
NAMES = ("uncertain", "risk", "draws")  # fields of problems


def uncertain_settings(given: Mapping[str, Any], known: object = None) -> dict[str, Any]:
    """Fields of a problem of what a command was given; draws are by default those of the problem that continues."""
    found = {name: given[name] for name in NAMES if name in given}
    if "uncertain" in found:
        draws = getattr(known, "draws", 1)
        found = {"draws": DRAWS if draws == 1 else draws, **found, "uncertain": ",".join(found["uncertain"])}
    return found


def checked_uncertain(uncertain: str, risk: str, draws: int) -> str:
    """Normalise the text of the uncertain quantities; empty if nothing is uncertain.

    Raises:
        ValueError: for what is not allowed, a risk of nothing, and a single draw.
    """
    text = Uncertainty.parse(uncertain).text if uncertain else ""
    Risk.parse(risk)
    if not text and risk != "mean":
        raise ValueError(f"risk: {risk} is not allowed without uncertain; give what is uncertain")
    if text and draws == 1:
        raise ValueError(f"uncertain: {text} is not allowed with a single draw; give draws")
    return text


def check_drawn(robot: Robot, worlds: Sequence[World], uncertain: str, draws: int) -> None:
    """Refuse uncertain quantities that a robot or its worlds do not have.

    Raises:
        ValueError: that names it; and for draws of nothing.
    """
    whole_number("draws", draws, 1, MOST_DRAWS)
    if draws != 1 and not uncertain:
        raise ValueError(f"draws: {draws} is not allowed without uncertain; give what is uncertain")
    for world in worlds if uncertain else ():
        Uncertainty.parse(uncertain).check(robot, world)


def check_part(size: int, what: str, count: int, over: str) -> None:
    """Refuse minibatches of one of several, of which there is no worst; where there is only one it is all of them.

    Args:
        size: of a minibatch.
        what: ``"draws"`` or ``"worlds"``, of which it has some.
        count: how many there are.
        over: how scores in several become one.

    Raises:
        ValueError: for these.
    """
    if size == 1 < count and over not in ("mean", "each"):
        raise ValueError(
            f"minibatch_size: 1 is not allowed with {over} of several {what}; give at least 2, in commands by --set"
        )


@dataclass(frozen=True, eq=False)
class TrialWorlds:
    """Worlds in which a robot is simulated, each as it is in K draws if something is uncertain.

    Attributes:
        worlds: W of them for each draw, draw by draw.
        variants: of the robot, one for each of those; empty if nothing is uncertain.
        count: W.
    """

    worlds: Sequence[World]
    variants: Sequence[Robot]
    count: int

    @classmethod
    def of(cls, robot: Robot, worlds: Sequence[World], uncertain: str, draws: int) -> Self:
        """Trials of a robot in some worlds, in each of ``draws`` draws of what is uncertain."""
        if not uncertain:
            return cls(worlds, (), len(worlds))
        drawn = Uncertainty.parse(uncertain).draw(draws, actuators=robot.actuators)
        terrains = [terrain_of(robot.as_terrain(world)) for world in worlds]
        drawn_terrains = [robot.drawn_terrain(terrain, one) for one in drawn for terrain in terrains]
        variants = [variant for one in drawn for variant in [robot.perturbed(one)] * len(worlds)]
        return cls(drawn_terrains, variants, len(worlds))

    def part(self, rows: Indices, count: int) -> Self:
        """Trials in some of the worlds, by number, ``count`` for each draw."""
        variants = [self.variants[row] for row in rows] if self.variants else ()
        return type(self)([self.worlds[row] for row in rows], variants, count)

    def outcomes(self, robot: Robot, points: Floats, trial: Trial) -> list[list[Outcome]]:
        """Simulate a robot at points, shape (N, P), in each world, draw by draw."""
        found = robot.run_in(robot.points(points), self.worlds, trial, self.variants)
        return [found[first : first + self.count] for first in range(0, len(found), self.count)]


def mean_outcome(outcomes: Sequence[Outcome]) -> Outcome:
    """The means of the measures over draws in one world; a design of which one draw fails, fails."""
    names, status, reason = outcomes[0].measures, outcomes[0].status, outcomes[0].reason
    for other in outcomes[1:]:
        reason = np.where(status == OK, other.reason, reason)
        status = np.where(status == OK, other.status, status)
    measures = {name: np.mean([each.measures[name] for each in outcomes], axis=0) for name in names}
    return Outcome(measures, status, reason)


def under_risk(risk: Risk, values: Sequence[Floats], gradients: Sequence[Floats]) -> tuple[Floats, Floats | None]:
    """Objectives over K draws, each of shape (N,) or (N, M), as one, and the gradient, if gradients are given."""
    each = np.stack(values, axis=-1)
    if not gradients:
        return risk.of(each), None
    weights = risk.weights(each.reshape(len(each), -1))
    return risk.of(each), np.einsum("nk,nkd->nd", weights, np.stack(gradients, axis=1))


def held_out_products(
    robot: Callable[[], Robot],
    worlds: Sequence[World],
    uncertain: str,
    risk: str,
    compute: Compute,
    score: Callable[[Robot], Score],
) -> Mapping[str, Callable[[Path], None]]:
    """A function that writes ``ROBUST_FILE``, by the file's name; none if nothing is uncertain.

    Args:
        robot: makes the best one.
        worlds: where it was designed for, an entry each.
        uncertain, risk: as texts, see ``robots.uncertainty``.
        compute: device, precision and threads.
        score: by which the best one is judged.
    """

    def write(path: Path) -> None:
        unknown, measure, best = Uncertainty.parse(uncertain), Risk.parse(risk), robot()
        judged = score(best)
        found = {
            world.name: judge_uncertain(
                best, world, unknown, measure, JUDGED_DRAWS, score=judged, compute=compute
            ).document
            for world in worlds
        }
        write_text(path, json.dumps({"risk": risk, "terrains": found}, indent=1) + "\n")

    return {ROBUST_FILE: write} if uncertain else {}
