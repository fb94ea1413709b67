"""The machine: a soft walker whose muscles have free shapes and waves, and a gait for each kind of ground."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.experiments.results import Progress
from optim.maximising import maximise
from optim.problems.robot import RobotProblem
from optim.runs.generation import Generation
from robots.course import KINDS, RIDGE, Course
from robots.lattice_robot.drive import Drive, Free
from robots.lattice_robot.presets import EDGE, FREQUENCY, MOST, SETTLING
from robots.lattice_robot.robot import LatticeRobot
from robots.robot import Trial
from robots.world import Terrain
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import Material, body_from_array

HERE = Compute(precision="f32", threads=1)
# Softer than that of other walkers, with time steps twice as long.
RUBBER = Material(2.5e4, 1e3, static_friction=1.0, kinetic_friction=0.8, internal_damping=1.0, name="soft rubber")
RUN_UP = 0.09  # m of level ground under the machine before a slope on which a gait is searched
SHAPE = 0.15  # most by which a muscle's mean size differs from its own
NEAR = 0.15  # first standard deviation of a search that begins at a gait [ranges]
LENGTHS = 2  # how many times longer gaits are compared than they are searched


def machine(cycles: int) -> LatticeRobot:
    """A back of 8 x 2 x 2 voxels on two feet as wide as it is, with 10 muscles: the same at the left and at the right.

    Each muscle has a free mean size, its shape, and a free amplitude and phase: 30 free numbers.
    """
    filled = np.ones((8, 2, 3), bool)
    filled[2:6, :, 0] = False
    x, _, z = np.indices(filled.shape)
    numbers = np.zeros(filled.shape, int)
    numbers[filled] = np.unique((x // 2 * filled.shape[2] + z)[filled], return_inverse=True)[1]
    body = body_from_array(filled.astype(int), RUBBER, EDGE, regions=numbers)
    count = int(numbers.max()) + 1
    mean, amplitude, phase = Free(1 - SHAPE, 1 + SHAPE, 1.0), Free(0.0, MOST), Free(0.0, 1.0)
    means, amplitudes, phases = (mean,) * count, (amplitude,) * count, (phase,) * count
    drive = Drive("muscle", tuple(range(count)), mean=means, amplitude=amplitudes, phase=phases)
    return LatticeRobot(body, (drive,), frequency=FREQUENCY, cycles=cycles, settling=SETTLING, name="switching walker")


@dataclass(frozen=True)
class Grounds:
    """Properties of the stretches of courses, as in ``robots.course.Course``."""

    length: float
    degrees: float
    ridge: float
    factor: float

    def course(self, seed: int) -> Course:
        """The course of a seed."""
        return Course(float(seed), self.length, self.degrees, self.ridge, self.factor)

    def world(self, seed: int) -> Terrain:
        """The terrain of :meth:`course`."""
        return Terrain(ground=f"course:{seed},{self.length!r},{self.degrees!r},{self.ridge!r},{self.factor!r}")

    @property
    def pure(self) -> dict[str, Terrain]:
        """A terrain for each kind of stretch that is of that kind everywhere; the slope begins ahead of the machine."""
        grounds = {
            "level": Terrain(),
            "slope": Terrain(ground=f"ramp:{self.degrees!r},{RUN_UP!r}"),
            "ridges": Terrain(ground=f"wave:{self.ridge!r},{RIDGE!r}"),
            "slippery": Terrain(ground=f"patches:{self.factor!r},{self.factor!r}"),
        }
        return {kind: grounds[kind] for kind in KINDS}


@dataclass(frozen=True)
class Search:
    """How a gait is searched: by CMA-ES, for speed on one kind of ground.

    Attributes:
        generations: after the first, of a search from the middle.
        further: of one that begins at a gait.
        population: evaluations of each.
        cycles: of an evaluation that count.
    """

    generations: int
    further: int
    population: int
    cycles: int

    def gait(self, world: Terrain, seed: int, first: Floats | None, progress: Progress = None) -> Arrays:
        """The fastest point found, shape (P,), and its speed [lengths/s]; the first, and NaN, if all evaluations fail.

        Args:
            world: where.
            seed: of the search.
            first: the gait where it begins, shape (P,); None is the middle of all ranges.
            progress: told the fraction done.
        """
        problem = RobotProblem(machine(self.cycles), (world,), measure="speed", precision="f32", threads=1)
        generations = self.generations if first is None else self.further
        settings: dict[str, Any] = {"population": self.population}
        if first is not None:
            settings |= {"start": dict(zip(problem.space.names, first.tolist(), strict=True)), "sigma": NEAR}
        evaluations = (generations + 1) * self.population

        def tell(last: Generation) -> None:
            if progress:
                progress(min(1.0, last.evaluations / evaluations))

        found = maximise(problem, "cma", generations=generations, seed=seed, progress=tell, **settings)
        missing = np.array(machine(1).start) if first is None else first
        return {"point": missing if found.best is None else found.point, "speed": np.array(found.score)}

    def speeds(self, points: Floats, grounds: Grounds) -> Floats:
        """Speeds of gaits (G, P) on each kind of ground [lengths/s], shape (G, T); minus infinity where one fails."""
        robot = machine(LENGTHS * self.cycles)
        found = [robot.run(robot.points(points), Trial(world, HERE)) for world in grounds.pure.values()]
        return np.stack([np.nan_to_num(each.measures["speed"], nan=-np.inf) for each in found], axis=1)
