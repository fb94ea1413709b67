"""Settings of the study of interference: treatments, and the world they are in."""

from collections.abc import Sequence
from dataclasses import dataclass

from optim.search.method import MOST_POINTS
from robots.quadruped.robot import (
    ENVIRONMENTS,
    LEGGED,
    STEPS,
    TWO_ENVIRONMENTS,
    VARIANTS,
    WHEELED,
    WHEGGED,
    Quadruped,
    QuadrupedResult,
    simulate,
)
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

Lights = tuple[tuple[float, float], ...]

HILL_CLIMB = "hill-climb"
TRAINER_NAMES = (HILL_CLIMB, "gradient")
ROBOTS: dict[str, Quadruped] = {robot.kind: robot for robot in (LEGGED, WHEELED, WHEGGED)}
FITNESS_NAMES = ("sum", "product", "min")
LIGHTS: dict[int, Lights] = {2: TWO_ENVIRONMENTS, 4: ENVIRONMENTS}  # by the number of environments


@dataclass(frozen=True)
class Treatment:
    """A robot, how its environments make a fitness, and how it is trained.

    Attributes:
        robot: a name of ``ROBOTS``.
        fitness: ``"sum"``, ``"product"`` or ``"min"``.
        trainer: a name of ``TRAINER_NAMES``.
    """

    robot: str
    fitness: str
    trainer: str = HILL_CLIMB

    @property
    def row(self) -> str:
        """Its row in tables; robots are columns."""
        return self.fitness if self.trainer == HILL_CLIMB else f"{self.fitness}, {self.trainer}"

    def file(self, run: int) -> str:
        """What a file of one of its runs is called, without hyphens."""
        trainer = "" if self.trainer == HILL_CLIMB else self.trainer.replace("-", "_") + "_"
        return f"{self.robot}_{self.fitness}_{trainer}{run}"


def treatments(
    robots: Sequence[str] = tuple(ROBOTS),
    fitness: Sequence[str] = FITNESS_NAMES,
    trainers: Sequence[str] = (HILL_CLIMB,),
) -> list[Treatment]:
    """Every fitness with every robot, row by row, trainer by trainer.

    Raises:
        ValueError: in one line, for no names, unknown ones, or one given twice.
    """
    for field, names, known in (
        ("robots", robots, tuple(ROBOTS)),
        ("fitness", fitness, FITNESS_NAMES),
        ("trainers", trainers, TRAINER_NAMES),
    ):
        if not names:
            raise ValueError(f"{field}: none given; give some of {', '.join(known)}")
        for name in names:
            if name not in known or list(names).count(name) > 1:
                problem = "given twice" if name in known else "unknown"
                raise ValueError(f"{field}: {name!r} is {problem}; choose some of {', '.join(known)}")
    return [Treatment(robot, way, trainer) for trainer in trainers for way in fitness for robot in robots]


@dataclass(frozen=True)
class Interference:
    """What all results of a folder depend on.

    Attributes:
        lights: places of the light in the environments [m].
        population: climbers of a run.
        steps: looks at the sensors in a simulation.
        variant: a name of ``VARIANTS``: the published experiment or its text, which also bounds weights.
        precision: ``"f64"`` or ``"f32"``: the same distributions, not the same robots.
        device: ``"cpu"`` or one of Taichi's.
    """

    lights: Lights = TWO_ENVIRONMENTS
    population: int = 100
    steps: int = STEPS
    variant: str = "as-run"
    precision: str = "f64"
    device: str = "cpu"

    def __post_init__(self) -> None:
        checks.integer("population", self.population, 1, MOST_POINTS)
        checks.integer("steps", self.steps, 1)
        checks.choice("variant", self.variant, tuple(VARIANTS))
        checks.choice("precision", self.precision, ("f64", "f32"))
        checks.choice("device", self.device, ("cpu", "cuda", "vulkan", "metal"))

    def simulate(
        self, robot: str, weights: Floats, threads: int | None = None, record_every: int | None = None
    ) -> QuadrupedResult:
        """Run controllers, (N, 5, 8), in a robot, each in all environments."""
        return simulate(
            ROBOTS[robot],
            weights,
            self.lights,
            variant=VARIANTS[self.variant],
            steps=self.steps,
            record_every=record_every,
            precision=self.precision,
            device=self.device,
            threads=threads,
        )
