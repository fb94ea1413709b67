"""A closer look at a gait: how all parts slide, where the robot drifts, and what speed changed conditions leave."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.inflatable import simulation
from robots.inflatable.contact import PARTS, Footing, footing_of
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.variations import Conditions, variations_of
from robots.robot import part_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import ComputeOptions

VARIED_RUNS = 4  # of each changed condition, at most as many as of the usual ones


@dataclass(frozen=True, eq=False)
class Scrutiny:
    """What a closer look at a gait tells.

    Attributes:
        friction: of sliding and of gripping feet, under the usual conditions.
        weight: of bladders under these, ``"published"`` or ``"physical"``.
        speed: mean of the usual runs [body lengths/s].
        distances: that these runs went [m], shape (R,).
        sideways: drift to the left of the heading in each of them [m], shape (R,).
        footings: how the robot stood and slid in each of them, R of these.
        changed: speeds of runs under changed conditions, by the names of these [body lengths/s].
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
        """Slip of each part per path while it bears load, and of all together; NaN of parts that never do."""
        return {name: _mean(each.slips[name] for each in self.footings) for name in (*PARTS, "all")}

    @property
    def loads(self) -> dict[str, float]:
        """Share of the load that each part bears."""
        return {name: _mean(each.loads[name] for each in self.footings) for name in PARTS}

    @property
    def chatter(self) -> float:
        """Share of changes of contact, see ``Footing``."""
        return _mean(each.chatter for each in self.footings)

    @property
    def turning(self) -> float:
        """How far the robot turns to the left [degrees]."""
        return _mean(each.turning for each in self.footings)

    @property
    def drift(self) -> float:
        """How far the robot drifts to either side per distance, of all runs together; infinite if it goes nowhere."""
        way = float(np.abs(self.distances).sum())
        return float(np.abs(self.sideways).sum()) / way if way else np.inf

    @property
    def kept(self) -> dict[str, float]:
        """Share of the speed that remains under each changed condition; NaN if there is none, or a run diverged."""
        return {name: float(each.mean()) / self.speed if self.speed else np.nan for name, each in self.changed.items()}

    @property
    def lines(self) -> list[str]:
        """What it tells people."""
        low, high = self.friction
        shown = {name: slip for name, slip in self.slips.items() if name == "all" or self.loads[name] > 0}
        slips = ", ".join(f"{name} {_told(slip)}" for name, slip in shown.items())
        changed = ", ".join(
            f"{name} {_told(float(each.mean()), 4)} ({_told(self.kept[name])})" for name, each in self.changed.items()
        )
        return [
            f"friction {low:g} and {high:g}, bladders of {self.weight} weight",
            f"slip of parts under load, of the robot's path: {slips}; chatter {_told(self.chatter, 3)}",
            f"drifts {_told(self.drift)} of the way to the side, turns {_told(self.turning, 1)} degrees to the left",
            f"changed, BL/s and share kept: {changed}",
        ]

    def to_document(self) -> dict[str, Any]:
        """Its numbers, for JSON; None where one is not known."""
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
    """Look closely at a gait.

    Args:
        given: conditions under which it was simulated, and which are varied.
        usual: result of at least two runs under these, with frames, none of which diverged.
        noise: standard deviation of start positions in runs under changed conditions [m].
        seed: of the noise.
        progress: called now and then with the fraction done.
        compute: see ``robots.inflatable.simulate``.
    """
    design, runs, speeds = given.design, len(usual.speed), {}
    footings = [footing_of(usual, design, given.geometry.body_length, robot) for robot in range(runs)]
    variations = variations_of(given)
    for number, (name, tried) in enumerate(variations.items()):
        speeds[name] = simulation.simulate(
            [tried.design] * min(runs, VARIED_RUNS),
            tried.terrain,
            geometry=tried.geometry,
            actuation=tried.actuation,
            perturbation=noise,
            seed=seed,
            progress=part_of(progress, number, len(variations)),
            **compute,
        ).speed
    drift = simulation.sideways(usual.displacement, [design.orientation] * runs)
    weight, speed = given.actuation.weight, float(usual.speed.mean())
    return Scrutiny(given.friction, weight, speed, usual.distance, drift, footings, speeds)


def _mean(values: Iterable[float]) -> float:
    """Mean of the values that are known; NaN if none is."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else np.nan


def _told(value: float, digits: int = 2) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "unknown"


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
