"""A closer look at a gait: slip of all parts, drift, turning, and the speed under changed conditions."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.inflatable import simulation
from robots.inflatable.contact import PARTS, Footing, footing_of
from robots.inflatable.convention import counting_of
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.variations import Conditions, variations_of
from robots.robot import part_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import ComputeOptions

VARIED_RUNS = 4  # under each changed condition, or as many as there are usual runs if those are fewer


@dataclass(frozen=True, eq=False)
class Scrutiny:
    """Result of a closer look at a gait.

    Attributes:
        friction: friction coefficients of sliding and of gripping feet under the usual conditions.
        weight: weight of bladders under the usual conditions, ``"published"`` or ``"physical"``.
        speed: mean speed of the usual runs [body lengths/s].
        distances: distances of these runs [m], shape (R,).
        sideways: drift to the left of the heading in each of these runs [m], shape (R,).
        footings: contact of the robot with the ground in each of these runs, R in all.
        changed: speeds of runs under changed conditions, by the names of the conditions [body lengths/s].
    """

    friction: tuple[float, float]
    weight: str
    speed: float
    distances: Floats
    sideways: Floats
    footings: Sequence[Footing]
    changed: Mapping[str, Floats]

    @property
    def slips(self) -> dict[str, float]:
        """Slip under load of each part, and of all together, per length of path; NaN for parts that never bear load."""
        return {name: _mean(each.slips[name] for each in self.footings) for name in (*PARTS, "all")}

    @property
    def loads(self) -> dict[str, float]:
        """Share of the load that each part bears, by the part's name."""
        return {name: _mean(each.loads[name] for each in self.footings) for name in PARTS}

    @property
    def chatter(self) -> float:
        """Mean chatter of the runs, see ``Footing``."""
        return _mean(each.chatter for each in self.footings)

    @property
    def turning(self) -> float:
        """Mean angle by which the robot turns to the left [degrees]."""
        return _mean(each.turning for each in self.footings)

    @property
    def drift(self) -> float:
        """Total drift to either side divided by total distance of all runs; infinite if the robot does not move."""
        way = float(np.abs(self.distances).sum())
        return float(np.abs(self.sideways).sum()) / way if way else np.inf

    @property
    def kept(self) -> dict[str, float]:
        """Share of the speed that remains under each changed condition; NaN if the speed is 0, or a run diverged."""
        return {name: float(each.mean()) / self.speed if self.speed else np.nan for name, each in self.changed.items()}

    @property
    def lines(self) -> list[str]:
        """Readable text, by lines."""
        low, high = self.friction
        shown = {name: slip for name, slip in self.slips.items() if name == "all" or self.loads[name] > 0}
        slips = ", ".join(f"{name} {_decimal(slip)}" for name, slip in shown.items())
        changed = ", ".join(
            f"{name} {_decimal(float(each.mean()), 4)} ({_decimal(self.kept[name])})"
            for name, each in self.changed.items()
        )
        return [
            f"friction {low:g} and {high:g}, bladders of {self.weight} weight",
            f"slip of parts under load, of the robot's path: {slips}; chatter {_decimal(self.chatter, 3)}",
            f"drifts {_decimal(self.drift)} of the way to the side, "
            f"turns {_decimal(self.turning, 1)} degrees to the left",
            f"changed, BL/s and share kept: {changed}",
        ]

    def to_document(self) -> dict[str, Any]:
        """Return its numbers as a dictionary for JSON; None where one is unknown."""
        numbers = {
            "part_slip": self.slips,
            "part_load": self.loads,
            "changed": {name: float(each.mean()) for name, each in self.changed.items()},
            "changed_deviation": {name: float(each.std(ddof=1)) for name, each in self.changed.items()},
            "kept": self.kept,
        }
        return {
            "weight": self.weight,
            "friction": list(self.friction),
            "chatter": _known(self.chatter),
            "sideways": _known(float(self.sideways.mean())),
            "drift": _known(self.drift),
            "turning": _known(self.turning),
            **{name: {each: _known(one) for each, one in group.items()} for name, group in numbers.items()},
        }


def scrutinise(
    given: Conditions,
    usual: InflatableResult,
    *,
    noise: float,
    seed: int,
    progress: Callable[[float], None] | None,
    compute: ComputeOptions,
) -> Scrutiny:
    """Take a closer look at a gait: measure its recorded runs, and simulate it under changed conditions.

    Args:
        given: conditions of the simulated runs, which are varied.
        usual: result of at least two runs under these conditions, with frames; none diverged.
        noise: standard deviation of the start positions in runs under changed conditions [m].
        seed: seed of the noise.
        progress: called at intervals with the fraction done.
        compute: see ``robots.inflatable.simulate``.
    """
    design, runs, speeds = given.design, len(usual.speed), {}
    footings = [footing_of(usual, design, given.geometry.body_length, robot) for robot in range(runs)]
    variations = variations_of(given)
    for number, (name, tried) in enumerate(variations.items()):
        played = simulation.simulate(
            [tried.design] * min(runs, VARIED_RUNS),
            tried.terrain,
            geometry=tried.geometry,
            actuation=tried.actuation,
            counting=counting_of(tried.convention),
            perturbation=noise,
            seed=seed,
            progress=part_of(progress, number, len(variations)),
            **compute,
        )
        speeds[name] = tried.speeds(played)
    drift = simulation.sideways(usual.displacement, [design.orientation] * runs)
    weight, speed = given.actuation.weight, float(usual.speed.mean())
    return Scrutiny(given.friction, weight, speed, usual.distance, drift, footings, speeds)


def _mean(values: Iterable[float]) -> float:
    """Mean of the values that are not NaN; NaN if there are none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else np.nan


def _decimal(value: float, digits: int = 2) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "unknown"


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
