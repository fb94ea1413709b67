"""Judge whether a gait is physical: whether it walks, rather than exploiting simplifications of the simulation.

Contact makes long runs chaotic, so a speed is the mean over runs whose start positions have noise of 10 nm. The
simulation of the dissertation has two simplifications that a search may exploit: sliding feet have no friction, and
bladders have no weight while they move or stay inflated. Gaits that push off the ground are distinguished from gaits
that slide by the speed that remains without both simplifications, and by how far feet slip while they grip. The
dissertation's authors judged by eye ("unphysical", ch. 5, "Results"). A closer look also measures the slip of all
parts, drift and turning, and simulates the gait on the measured floors, with changes of weight and floor separately,
with other friction and with half the time step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Unpack

import numpy as np

from robots.inflatable import simulation
from robots.inflatable.actuation import ACTUATION, PUBLISHED_COLUMNS, PUBLISHED_STEPS, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.convention import SpeedConvention, counting_of
from robots.inflatable.design import InflatableDesign
from robots.inflatable.rubbing import Rubbing
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
HARD_FRICTION = 0.2  # coefficient of sliding feet
_RUBBING = Rubbing(least=HARD_FRICTION)  # of feet with friction of their own
USUAL_SHARE = 0.3  # approximate share of the usual and harder runs in the time of a closer look: 16 of 52 runs
RECORD_EVERY = 200  # time steps; a thousandth of a gait
# Limits between walking and sliding; inching and rolling, each on its own terrain, keep to them.
MOST_SLIP = 0.75  # per distance travelled
LEAST_HARD_SPEED = -0.01  # [body lengths/s]
LEAST_HARD_SHARE = 0.25  # of the speed, on level ground, where no slope pulls a robot back


@dataclass(frozen=True, eq=False)
class NoisySpeeds:
    """Speeds of a gait in several runs with noise, under the usual and the harder conditions.

    Attributes:
        speeds: speeds by the published convention [body lengths/s], shape (R,).
        hard_speeds: speeds if sliding feet have ``HARD_FRICTION`` and bladders keep their weight, shape (R,).
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
    """Judgement of a gait on a terrain.

    Attributes:
        slip: slip under load of each foot, weighted by how far it grips, in every usual run [m], shape (R, 2).
        distances: distances of these runs [m], shape (R,).
        steps: number of time steps of the gait.
        level: whether the ground is level.
        most_steps: number of time steps of a published gait in this robot.
        hard_friction: friction coefficient of sliding feet under the harder conditions.
        scrutiny: result of a closer look, if one was taken and no run diverged.
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
        """Mean slip of the two feet per distance travelled, for every run, shape (R,); infinite if it does not move."""
        ways, feet = np.abs(self.distances), self.slip.mean(axis=1)
        return np.divide(feet, ways, out=np.full_like(feet, np.inf), where=ways != 0)

    @property
    def slip_ratio(self) -> float:
        """Total slip divided by total distance of all runs, so that slow runs do not dominate; NaN if one diverged."""
        way = abs(float(self.distances.sum()))
        return float(self.slip.mean(axis=1).sum() / way) if way else np.inf

    @property
    def slip_deviation(self) -> float:
        """Standard deviation of the slip ratios of the runs; NaN if one did not move, or diverged."""
        ratios = self.slip_ratios
        return float(ratios.std(ddof=1)) if np.isfinite(ratios).all() else np.nan

    @property
    def least_hard_speed(self) -> float:
        """Least speed under the harder conditions that is accepted [body lengths/s]."""
        return LEAST_HARD_SHARE * abs(self.speed) if self.level else LEAST_HARD_SPEED

    @property
    def diverged(self) -> bool:
        """Whether a run diverged, so that there is no mean."""
        return not (np.isfinite(self.speeds).all() and np.isfinite(self.hard_speeds).all())

    @cached_property
    def faults(self) -> tuple[str, ...]:
        """Reasons why the gait is not physical, one line each; empty for a gait that walks."""
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
        """Whether the gait has no faults."""
        return not self.faults

    @property
    def spoken(self) -> str:
        """Readable text of several lines; the last one says whether the gait is physical."""
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
        """Return its numbers as a dictionary for JSON; None where one is not finite."""
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
    convention: SpeedConvention | None = None,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> GaitJudgement:
    """Judge a gait by runs with noise, under usual and harder conditions, and by the slip of its feet.

    Args:
        design: design of the robot.
        terrain: terrain; flat ground by default.
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates under the usual conditions.
        runs: number of runs with noise under each of the two conditions; at least 2.
        seed: seed of the noise.
        closely: whether to take a closer look, with runs under changed conditions, which takes longer.
        convention: by which speeds count; None is the published one. After a warm-up slip counts as distance does.
        progress: called at intervals with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``robots.inflatable.simulate``.

    Raises:
        ValueError: if an argument is not allowed.
    """
    whole_number("runs", runs, 2)
    given = Conditions(design, terrain or Terrain(), geometry, actuation, convention)
    report = progress or (lambda fraction: None)
    first: Callable[[float], None] = (lambda fraction: report(USUAL_SHARE * fraction)) if closely else report
    usual, hard = _both_ways([design] * runs, given, RECORD_EVERY, seed, first, compute)
    steps = gait_steps(design.schedule, actuation)
    if convention and convention.counting.warm_up:  # feet slip there, too, on a way that does not count
        begin = steps - convention.counted_of(design.schedule, actuation)
        assert usual.frames is not None
        usual = replace(usual, frames=usual.frames.since(begin * usual.time_step))
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
        steps,
        given.terrain.is_level,
        nominal_steps(PUBLISHED_COLUMNS, actuation),
        _hardened(given).friction[0],
        scrutiny,
    )


def harder(terrain: Terrain, actuation: InflatableActuation = ACTUATION) -> tuple[Terrain, InflatableActuation]:
    """The harder conditions on a terrain: friction of at least ``HARD_FRICTION`` for sliding feet, and bladder weight.

    Args:
        terrain: terrain under the usual conditions.
        actuation: actuation under the usual conditions.

    Raises:
        ValueError: for a fluid, and if gripping feet have less friction than sliding feet would have.
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


def _hardened(given: Conditions) -> Conditions:
    """The harder conditions of a gait, of whose feet with friction of their own, too, sliding ones rub."""
    terrain, actuation = harder(given.terrain, given.actuation)
    return replace(given, design=_RUBBING.of(given.design), terrain=terrain, actuation=actuation)


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
    """Simulate designs with noise; return speeds under the usual and the harder conditions, shape (N, R) each.

    Args:
        designs: N designs.
        terrain: terrain.
        runs: R, the number of runs of each design under each condition; at least 1.
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates under the usual conditions.
        seed: seed of the noise.
        progress: called at intervals with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``robots.inflatable.simulate``.

    Raises:
        ValueError: if an argument is not allowed.
    """
    whole_number("runs", runs, 1)
    copies = [design for design in designs for _ in range(runs)]
    given = Conditions(simulation.checked_designs(copies, geometry, actuation)[0], terrain, geometry, actuation)
    usual, hard = _both_ways(copies, given, None, seed, progress, compute)
    return usual.speed.reshape(-1, runs), hard.speed.reshape(-1, runs)


def _both_ways(
    designs: Sequence[InflatableDesign],
    given: Conditions,
    record_every: int | None,
    seed: int,
    progress: Callable[[float], None] | None,
    compute: ComputeOptions,
) -> tuple[InflatableResult, InflatableResult]:
    """Results of designs with noise, under given and the harder conditions; only the former record frames."""
    report, found = progress or (lambda fraction: None), []
    hard = [_RUBBING.of(design) for design in designs]
    ways = ((designs, given.terrain, given.actuation), (hard, *harder(given.terrain, given.actuation)))
    for number, (played, ground, drive) in enumerate(ways):

        def part(fraction: float, number: int = number) -> None:
            report((number + fraction) / 2)

        result = simulation.simulate(
            played,
            ground,
            geometry=given.geometry,
            actuation=drive,
            counting=counting_of(given.convention),
            record_every=None if number else record_every,
            perturbation=NOISE,
            seed=seed,
            progress=part,
            **compute,
        )
        found.append(result if given.convention is None else replace(result, speed=given.speeds(result)))
    return found[0], found[1]
