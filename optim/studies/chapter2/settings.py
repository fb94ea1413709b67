"""Settings of the study of interference: treatments, and the world they are in."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np

from optim.experiments.study import Count, Settings
from optim.problem import Evaluation
from optim.search import build_method
from optim.search.method import MOST_POINTS, Method
from optim.space import Space, Variable
from robots.quadruped import (
    ENVIRONMENTS,
    LEGGED,
    MOTORS,
    SENSORS,
    STEPS,
    TWO_ENVIRONMENTS,
    VARIANTS,
    WHEELED,
    WHEGGED,
    Quadruped,
    QuadrupedResult,
    differentiate,
    simulate,
)
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.compute import Device

Lights = tuple[tuple[float, float], ...]
Place = tuple[str, str]  # of a treatment in tables and figures: its row, and its robot, which is the column

HILL_CLIMB = "hill-climb"
TRAINERS: dict[str, str] = {HILL_CLIMB: HILL_CLIMB, "gradient": "gradient-hill-climb"}  # names in ``METHODS``
ROBOTS: dict[str, Quadruped] = {robot.kind: robot for robot in (LEGGED, WHEELED, WHEGGED)}
FITNESS: dict[str, Callable[..., Floats]] = {"sum": np.sum, "product": np.prod, "min": np.min}
LIGHTS: dict[int, Lights] = {2: TWO_ENVIRONMENTS, 4: ENVIRONMENTS}  # by the number of environments
AT_ONCE = 200  # rollouts to differentiate at a time: 2 MB each
SPACE = Space(tuple(Variable(f"w{s}_{m}", -1.0, 1.0, step=0.05) for s in range(SENSORS) for m in range(MOTORS)))


@dataclass(frozen=True)
class Treatment:
    """A robot, how its environments make a fitness, and how it is trained."""

    robot: str  # a name of ``ROBOTS``
    fitness: str  # ``"sum"``, ``"product"`` or ``"min"``
    trainer: str = HILL_CLIMB  # a name of ``TRAINERS``

    @property
    def row(self) -> str:
        """Its row in tables; robots are columns."""
        return self.fitness if self.trainer == HILL_CLIMB else f"{self.fitness}, {self.trainer}"

    @property
    def place(self) -> Place:
        """Its row and its column."""
        return self.row, self.robot

    def file(self, run: int) -> str:
        """The name of the file of one of its runs, without hyphens."""
        trainer = "" if self.trainer == HILL_CLIMB else self.trainer.replace("-", "_") + "_"
        return f"{self.robot}_{self.fitness}_{trainer}{run}"


def treatments(
    robots: Sequence[str] = tuple(ROBOTS),
    fitness: Sequence[str] = tuple(FITNESS),
    trainers: Sequence[str] = (HILL_CLIMB,),
) -> list[Treatment]:
    """Every fitness with every robot, row by row; raises ValueError for no names, unknown ones, or one given twice."""
    each = (("robots", robots, ROBOTS), ("fitness", fitness, FITNESS), ("trainers", trainers, TRAINERS))
    for field, names, known in each:
        if not names:
            raise ValueError(f"{field}: none given; give some of {', '.join(known)}")
        for name in names:
            if name not in known or list(names).count(name) > 1:
                problem = "given twice" if name in known else "unknown"
                raise ValueError(f"{field}: {name!r} is {problem}; choose some of {', '.join(known)}")
    return [Treatment(robot, way, trainer) for trainer in trainers for way in fitness for robot in robots]


ROWS = tuple(dict.fromkeys(treatment.row for treatment in treatments(trainers=tuple(TRAINERS))))  # of all treatments


@dataclass(frozen=True)
class Interference(Settings):
    """Settings that all results of a folder depend on."""

    lights: Lights = TWO_ENVIRONMENTS  # places of the light in the environments [m]
    population: Annotated[int, partial(checks.integer, low=1, high=MOST_POINTS)] = 100  # climbers of a run
    steps: Count = STEPS  # looks at the sensors in a simulation
    # a name of ``VARIANTS``: the published experiment or its text, which also bounds weights
    variant: Annotated[str, partial(checks.choice, names=tuple(VARIANTS))] = "as-run"
    precision: Literal["f64", "f32"] = "f64"  # ``"f64"`` or ``"f32"``: the same distributions, not the same robots
    device: Device = "cpu"  # ``"cpu"`` or one of Taichi's

    def check(self, state: Arrays) -> None:
        """Refuse climbers of a file that no run with these settings leaves, by a ValueError."""
        kept, environments = len(state["climber"]), len(self.lights)
        shapes = {
            "weights": (self.population, SENSORS, MOTORS),
            "scores": (self.population,),
            "born": (kept,),
            **dict.fromkeys(("light", "distance"), (kept, environments)),
        }
        for name, shape in shapes.items():
            if state[name].shape != shape:
                raise ValueError(f"{name}: shape {state[name].shape} is not allowed; give {shape}")
        checks.within("climber", state["climber"], 0, self.population - 1)
        checks.within("born", state["born"], 0, int(state["generation"]))
        largest = np.finfo(float).max
        checks.within("weights", state["weights"], -largest, largest)
        for name in ("light", "distance"):
            checks.within(name, np.where(np.isnan(state[name]), 0, state[name]), 0, largest)  # NaN if it failed

    def method(self, trainer: str, run: int) -> Method:
        """The climbers of a run; the same run of another treatment draws the same numbers.

        Source: dissertation, chapter 2, "The evolutionary algorithm" (Eq. mutation and survival): a child is its
        parent plus N(0, 0.05), and replaces it if it is strictly better. The text bounds weights, the experiment did
        not.
        """
        bounds = "clip" if self.variant == "text" else "none"
        climbers = {"climbers": self.population, "seed": run, "bounds": bounds, "streams": "generations"}
        return build_method(TRAINERS[trainer], SPACE, climbers)

    def fitness_and_slopes(self, treatment: Treatment, points: Floats, threads: int | None = None) -> Evaluation:
        """The logarithm of the fitness of points, shape (N, 40), and its gradients."""
        weights, done, slopes = controllers(points), list[Floats](), list[Floats]()
        each = max(1, AT_ONCE // len(self.lights))
        for first in range(0, len(weights), each):
            part = weights[first : first + each]
            seen = differentiate(ROBOTS[treatment.robot], part, self.lights, **self._options(threads))
            found = seen.gradient
            assert found is not None
            with np.errstate(divide="ignore", invalid="ignore"):
                shares = fitness_shares(treatment.fitness, seen.light)
                slopes.append(np.einsum("pe,peij->pij", shares, found).reshape(len(found), -1))
                done.append(np.log(FITNESS[treatment.fitness](seen.light, axis=-1)))
        return Evaluation(np.concatenate(done), gradients=np.concatenate(slopes))

    def simulate(
        self, robot: str, weights: Floats, threads: int | None = None, record_every: int | None = None
    ) -> QuadrupedResult:
        """Run controllers, (N, 5, 8), in a robot, each in all environments."""
        return simulate(ROBOTS[robot], weights, self.lights, record_every=record_every, **self._options(threads))

    def _options(self, threads: int | None) -> dict[str, Any]:
        """Options of simulations."""
        compute = {"precision": self.precision, "device": self.device, "threads": threads}
        return {"variant": VARIANTS[self.variant], "steps": self.steps, **compute}


def controllers(points: Floats) -> Floats:
    """The controllers, (N, 5, 8), of points of ``SPACE``."""
    return np.reshape(points, (-1, SENSORS, MOTORS))


def fitness_shares(fitness: str, light: Floats) -> Floats:
    """Derivatives of the logarithm of a fitness by the environments' readings, (P, E) [1/m^2], shape (P, E)."""
    if fitness == "sum":
        return np.repeat(1 / light.sum(-1, keepdims=True), light.shape[-1], -1)
    if fitness == "product":
        return 1 / light
    lowest = light == light.min(-1, keepdims=True)
    return lowest / (lowest.sum(-1, keepdims=True) * light)
