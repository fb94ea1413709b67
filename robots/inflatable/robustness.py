"""Whether a gait is one that a body could walk by, in numbers.

Contact makes long runs chaotic, so a speed is a mean over runs whose start positions differ by 10 nm. The simulation of
the dissertation has two quirks that a search may live on: sliding feet without friction, and bladders without weight
while they move or stay inflated. What remains of the speed when both are taken away, and how far feet slip while they
grip, tell gaits that push off the ground from those that slide. The dissertation's authors judged by eye ("unphysical",
ch. 5, "Results"). A thorough judgement also tells how all parts slide, drift and turning, and tries the gait on the
floors that were measured, with weight and floor apart, with other friction and with half the time step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Unpack

import numpy as np

from robots.inflatable import simulation
from robots.inflatable.actuation import ACTUATION, PUBLISHED_COLUMNS, PUBLISHED_STEPS, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.scrutiny import Scrutiny, scrutinise
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.slip import slip_under_load
from robots.inflatable.timing import gait_steps, nominal_steps
from robots.inflatable.variations import Conditions
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import ComputeOptions
from taichi_sim.base.short_text import decimal

RUNS = 8
NOISE = 1e-8  # standard deviation of the start positions [m]
HARD_FRICTION = 0.2  # of sliding feet
USUAL_SHARE = 0.3  # of the time of a closer look, about: 16 of 52 runs
RECORD_EVERY = 200  # time steps; a thousandth of a gait
# Limits between walking and sliding: inching and rolling, where each belongs, keep to them.
MOST_SLIP = 0.75  # of the way
LEAST_HARD_SPEED = -0.01  # body lengths a second
LEAST_HARD_SHARE = 0.25  # of the speed, on level ground, where nothing pulls a robot back


@dataclass(frozen=True, eq=False)
class NoisySpeeds:
    """How fast a gait is in several runs with noise, under both conditions.

    Attributes:
        speeds: by the published convention [body lengths/s], shape (R,).
        hard_speeds: the same with ``HARD_FRICTION`` of sliding feet and bladders that keep their weight, shape (R,).
    """

    speeds: Floats
    hard_speeds: Floats

    @property
    def speed(self) -> float:
        """Mean of the runs [body lengths/s]; NaN if one diverged."""
        return float(self.speeds.mean())

    @property
    def hard_speed(self) -> float:
        """Mean speed under the harder conditions."""
        return float(self.hard_speeds.mean())


@dataclass(frozen=True, eq=False)
class GaitJudgement(NoisySpeeds):
    """What a gait is worth on a terrain.

    Attributes:
        slip: of each foot as far as it grips, under load, in every run as usual [m], shape (R, 2).
        distances: that these runs went [m], shape (R,).
        steps: of the gait.
        level: whether the ground is.
        most_steps: that a published gait takes in this robot.
        hard_friction: of sliding feet under the harder conditions.
        scrutiny: what a closer look tells, if one was taken and no run diverged.
    """

    slip: Floats
    distances: Floats
    steps: int
    level: bool = False
    most_steps: int = PUBLISHED_STEPS
    hard_friction: float = HARD_FRICTION
    scrutiny: Scrutiny | None = None

    @property
    def slip_ratios(self) -> Floats:
        """Slip of the two feet on average, per distance, of every run; infinite for one that goes nowhere."""
        ways, feet = np.abs(self.distances), self.slip.mean(axis=1)
        return np.divide(feet, ways, out=np.full_like(feet, np.inf), where=ways != 0)

    @property
    def slip_ratio(self) -> float:
        """Slip over distance of all runs together, so that slow ones do not count for more; NaN if one diverged."""
        way = abs(float(self.distances.sum()))
        return float(self.slip.mean(axis=1).sum() / way) if way else np.inf

    @property
    def slip_deviation(self) -> float:
        """Standard deviation of the runs' ratios; NaN where one went nowhere, or diverged."""
        ratios = self.slip_ratios
        return float(ratios.std(ddof=1)) if np.isfinite(ratios).all() else np.nan

    @property
    def least_hard_speed(self) -> float:
        """The least speed that has to remain under the harder conditions [body lengths/s]."""
        return LEAST_HARD_SHARE * abs(self.speed) if self.level else LEAST_HARD_SPEED

    @property
    def diverged(self) -> bool:
        """Whether a run did, so that no mean is known."""
        return not (np.isfinite(self.speeds).all() and np.isfinite(self.hard_speeds).all())

    @cached_property
    def faults(self) -> tuple[str, ...]:
        """What speaks against the gait, a line each; none of one that walks."""
        found = []
        if self.steps > self.most_steps:
            found.append(f"takes {self.steps:,} steps, more than {self.most_steps:,}")
        if self.diverged:
            return (*found, "a run diverged")
        if self.slip_ratio > MOST_SLIP:
            found.append(f"feet slip {self.slip_ratio:.2f} of the way while they grip, more than {MOST_SLIP:g}")
        if self.hard_speed < self.least_hard_speed:
            found.append(
                f"{decimal(self.hard_speed)} BL/s remain with friction {self.hard_friction:g} of sliding feet and"
                f" bladders that keep their weight, less than {self.least_hard_speed:.4g}"
            )
        return tuple(found)

    @property
    def physical(self) -> bool:
        """Whether nothing speaks against the gait."""
        return not self.faults

    @property
    def spoken(self) -> str:
        """What it tells people, in lines; the last one says whether the gait is physical."""
        if self.diverged:
            return "; ".join(self.faults)
        usual, hard = (
            f"{decimal(s.mean())} BL/s, standard deviation {decimal(s.std(ddof=1))}"
            for s in (self.speeds, self.hard_speeds)
        )
        slip = f"{self.slip_ratio:.2f} of the way while they grip, standard deviation {self.slip_deviation:.2f}"
        lines = [f"{usual}, {len(self.speeds)} runs", f"harder conditions: {hard}"]
        lines.append(f"feet slip {slip}; {self.steps:,} steps")
        lines += [] if self.scrutiny is None else self.scrutiny.lines
        return "\n".join([*lines, "physical" if self.physical else "not physical: " + "; ".join(self.faults)])

    def to_document(self) -> dict[str, Any]:
        """Its numbers, for JSON."""
        numbers = {
            "speed": self.speed,
            "deviation": self.speeds.std(ddof=1),
            "hard_speed": self.hard_speed,
            "hard_deviation": self.hard_speeds.std(ddof=1),
            "slip_ratio": self.slip_ratio,
            "slip_deviation": self.slip_deviation,
            "distance": self.distances.mean(),
        }
        known = {name: float(value) if np.isfinite(value) else None for name, value in numbers.items()}
        return {
            **known,
            "runs": len(self.speeds),
            "steps": self.steps,
            "physical": self.physical,
            "faults": list(self.faults),
            **({} if self.scrutiny is None else self.scrutiny.to_document()),
        }


def judge_gait(
    design: InflatableDesign,
    terrain: Terrain | None = None,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    runs: int = RUNS,
    seed: int = 0,
    closely: bool = False,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> GaitJudgement:
    """Simulate a gait with noise, under harder conditions, and watch its feet.

    Args:
        design: what the robot does.
        terrain: flat ground by default.
        geometry: of the robot.
        actuation: how it is driven, but for the harder conditions.
        runs: with noise, under either condition; at least 2.
        seed: of the noise.
        closely: whether a closer look is taken, which takes one and a half times as long again.
        progress: called now and then with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``robots.inflatable.simulate``.

    Raises:
        ValueError: if an argument is not allowed.
    """
    whole_number("runs", runs, 2)
    given = Conditions(design, terrain or Terrain(), geometry, actuation)
    report = progress or (lambda fraction: None)
    first: Callable[[float], None] = (lambda fraction: report(USUAL_SHARE * fraction)) if closely else report
    usual, hard = _both_ways([design] * runs, given.terrain, geometry, actuation, RECORD_EVERY, seed, first, compute)
    slip = np.stack([slip_under_load(usual, design, actuation, robot) for robot in range(runs)])
    scrutiny = None
    if closely and np.isfinite(usual.speed).all() and np.isfinite(hard.speed).all():

        def rest(fraction: float) -> None:
            report(USUAL_SHARE + (1 - USUAL_SHARE) * fraction)

        scrutiny = scrutinise(given, usual, noise=NOISE, seed=seed, progress=rest, compute=compute)
    return GaitJudgement(
        usual.speed,
        hard.speed,
        slip,
        usual.distance,
        gait_steps(design.schedule, actuation),
        given.terrain.is_level,
        nominal_steps(PUBLISHED_COLUMNS, actuation),
        actuation.on(harder(given.terrain, actuation)[0]).low_friction,
        scrutiny,
    )


def harder(terrain: Terrain, actuation: InflatableActuation = ACTUATION) -> tuple[Terrain, InflatableActuation]:
    """The harder conditions on a terrain: sliding feet of at least ``HARD_FRICTION``, bladders that keep their weight.

    Args:
        terrain: what it is like.
        actuation: how the robot is driven.

    Raises:
        ValueError: for a fluid, and friction of gripping feet below that.
    """
    if terrain.is_fluid:
        raise ValueError(
            f"terrain: {terrain.name} is not allowed with harder conditions, which are about feet on ground"
        )
    own = actuation.on(terrain)
    friction = max(HARD_FRICTION, own.low_friction)
    hard = replace(terrain, low_friction=friction)
    if own.low_friction <= own.high_friction < friction:
        raise ValueError(
            f"friction: {own.high_friction:g} of gripping feet is not allowed under the harder conditions, where "
            f"sliding feet have {friction:g}"
        )
    return hard, replace(actuation, weight="physical")


def play_with_noise(
    designs: Sequence[InflatableDesign],
    terrain: Terrain,
    runs: int,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> tuple[Floats, Floats]:
    """Speeds of designs as usual and under the harder conditions, shape (N, R) each.

    Args:
        designs: N of them.
        terrain: where.
        runs: R, of each design under either condition, as two batches; at least 1.
        geometry: of the robot.
        actuation: how it is driven, but for the harder conditions.
        seed: of the noise.
        progress: called now and then with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``robots.inflatable.simulate``.

    Raises:
        ValueError: if an argument is not allowed.
    """
    whole_number("runs", runs, 1)
    copies = [design for design in designs for _ in range(runs)]
    usual, hard = _both_ways(copies, terrain, geometry, actuation, None, seed, progress, compute)
    return usual.speed.reshape(-1, runs), hard.speed.reshape(-1, runs)


def _both_ways(
    designs: Sequence[InflatableDesign],
    terrain: Terrain,
    geometry: InflatableGeometry,
    actuation: InflatableActuation,
    record_every: int | None,
    seed: int,
    progress: Callable[[float], None] | None,
    compute: ComputeOptions,
) -> tuple[InflatableResult, InflatableResult]:
    """Results of designs that start with noise, as usual and under the harder conditions; frames of the former."""
    report, found = progress or (lambda fraction: None), []
    for number, (ground, drive) in enumerate(((terrain, actuation), harder(terrain, actuation))):

        def part(fraction: float, number: int = number) -> None:
            report((number + fraction) / 2)

        result = simulation.simulate(
            designs,
            ground,
            geometry=geometry,
            actuation=drive,
            record_every=None if number else record_every,
            perturbation=NOISE,
            seed=seed,
            progress=part,
            **compute,
        )
        found.append(result)
    return found[0], found[1]
