"""Bodies evolved for resistance to interference beside speed, for speed alone, and drawn: how well they learn."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.results import Progress, cached
from optim.experiments.tables import Record
from optim.measures.pareto import non_dominated
from optim.measures.sampled import SampledMetrics, sampled_metrics
from optim.problem import Evaluation
from optim.search import build_method
from optim.space import Space
from optim.studies.beyond.body_and_learning.bodies import LIGHT_AT, WORLDS
from optim.studies.beyond.body_and_learning.learning import LEARNERS, learned_cells
from optim.studies.beyond.body_and_learning.study import BodyAndLearning, learn
from optim.studies.beyond.evolving_bodies.bodies import BODY, body_of, code, drawn_body, stands
from robots.lattice_robot import LatticeRobot
from robots.robot import Trial, part_of
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.results_folder import ResultsFolder

HERE = Compute(precision="f32", threads=1)
ARMS = {
    "speed": "for speed",
    "both": "for speed and M_CI",
    "drawn": "drawn",
}
SPACE = Space(BODY)
CHOSEN = partial(check_arrays, {"genes": Allowed((SPACE.size,), 0.0), "tried": Allowed((), 1, kind="i")})
HELD_OUT = 10_000  # added to seeds of what selection has not seen


@dataclass(frozen=True)
class Evolving:
    """How bodies evolve, and how they are measured.

    Attributes:
        population, generations: of the evolution, generation 0 included.
        controllers: drawn in each body; the same ones for all bodies of a run.
        held_out: others, drawn in the bodies that were chosen.
        learning: how controllers are learned in these.
    """

    population: int
    generations: int
    controllers: int
    held_out: int
    learning: BodyAndLearning


def tried(robot: LatticeRobot, settings: BodyAndLearning, count: int, seed: int) -> tuple[Bools, Floats]:
    """Whether drawn controllers succeed in each world, (N, E), and how far each comes on flat ground, (N,) [m]."""
    space = Space(tuple(robot.parameters))
    points = space.sample(np.random.default_rng((seed, 4)), count)
    remaining = [outcome.measures["remaining"] for outcome in robot.run_in(points, WORLDS, Trial(WORLDS[0], HERE))]
    gained = np.nan_to_num(LIGHT_AT - np.stack(remaining, axis=1), nan=-LIGHT_AT)
    return gained >= settings.nearer, gained[:, 0]


def evolve(folder: ResultsFolder, evolving: Evolving, arm: str, seed: int, progress: Progress = None) -> Arrays:
    """Genes of the body that an arm chooses, shape (12,), and of how many bodies it was chosen; a drawn one of none."""
    drawn = {"genes": drawn_body(np.random.default_rng((seed, 5))), "tried": np.array(1)}
    if arm == "drawn":
        return drawn
    method = build_method("nsga2", SPACE, {"population": evolving.population, "seed": seed})
    known: dict[str, Floats] = {}
    for generation in range(evolving.generations):
        points = method.ask()
        worth = np.full((len(points), 2), np.nan)
        for number, genes in enumerate(points):
            if stands(genes):
                worth[number] = known.setdefault(code(genes), _worth(folder, evolving, genes, seed))
            if progress:
                progress((generation + (number + 1) / len(points)) / evolving.generations)
        method.tell(points, Evaluation(worth if arm == "both" else worth[:, :1]))
    if not known:  # no body that evolution met stands
        return drawn
    bodies = np.array([[int(gene) for gene in name] for name in known], float)
    values = np.array(list(known.values()))
    return {"genes": bodies[_chosen(values if arm == "both" else values[:, :1])], "tried": np.array(len(bodies))}


def _worth(folder: ResultsFolder, evolving: Evolving, genes: Floats, seed: int) -> Floats:
    """Speed and M_CI of a body by the controllers of a run, shape (2,).

    Speed is the best way [m]; M_CI counts one success and one failure more, so that few successes are not the best.
    """

    def measure() -> Arrays:
        settings = evolving.learning
        solved, gained = tried(body_of(genes, settings.cycles), settings, evolving.controllers, seed)
        every, some = solved.all(axis=1).sum(), solved.any(axis=1).sum()
        return {"worth": np.array([gained.max(), (every + 1) / (some + 2)])}

    return cached(folder, f"body_{code(genes)}", measure, partial(check_arrays, {"worth": Allowed((2,))}))["worth"]


def _chosen(values: Floats) -> int:
    """The body whose ranks in all objectives are the best together, among those that no other dominates."""
    ranks = np.argsort(np.argsort(values, axis=0, kind="stable"), axis=0).sum(axis=1)
    return int(np.argmax(np.where(non_dominated(values), ranks, -1)))


def arm_part(folder: Path, evolving: Evolving, arm: str, seed: int, _: Mapping[str, Any], progress: Progress) -> Record:
    """What an arm chooses with a seed, and how well that learns, unless it is known; its row."""
    parts = ResultsFolder(folder / "parts" / f"{arm}-{seed}", "arm", {"arm": arm, "seed": seed})
    bodies = ResultsFolder(folder / "parts" / f"bodies-{seed}", "bodies", {"seed": seed})
    choice = cached(parts, "choice", partial(evolve, bodies, evolving, arm, seed, part_of(progress, 0, 2)), CHOSEN)
    robot, settings = body_of(choice["genes"], evolving.learning.cycles), evolving.learning

    def measure() -> Arrays:
        solved, gained = tried(robot, settings, evolving.held_out, seed + HELD_OUT)
        return {"solved": solved, "fastest": np.array(gained.max())}

    allowed = {"solved": Allowed((evolving.held_out, len(WORLDS)), kind="b"), "fastest": Allowed(())}
    measured = cached(parts, "held_out", measure, partial(check_arrays, allowed))
    sampled: SampledMetrics = sampled_metrics(measured["solved"])
    row: dict[str, Any] = {
        "arm": arm,
        "seed": seed,
        "genes": "g" + code(choice["genes"]),
        "voxels": robot.body.voxel_count,
        "fastest": float(measured["fastest"]),
        "M_L": sampled.learnability.value,
        "M_CI": sampled.resistance.value,
    }
    for count, name in enumerate(LEARNERS):
        told = part_of(progress, len(LEARNERS) + count, 2 * len(LEARNERS))
        learn_here = partial(learn, settings, robot, seed, name, told)
        row |= learned_cells(parts, f"learned_{name}", name, settings.repetitions, settings.budget, learn_here)
    return row
