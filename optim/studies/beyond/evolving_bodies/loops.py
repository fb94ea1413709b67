"""Evolution and learning: one loop or two, with and without inheriting what was learnt, at equal CPU time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from optim.experiments.equal_cost import Arm, Contest, Entry
from optim.experiments.judged_runs import JudgedRuns, Run, best_of_search
from optim.experiments.results import Progress
from optim.experiments.tables import Record
from optim.problems.robot import RobotProblem
from optim.studies.beyond.body_and_learning.bodies import LIGHT_AT, WORLDS
from optim.studies.beyond.evolving_bodies.bodies import EvolvableWalker, body_of, drawn_body

NAME, TABLE, SUBJECT = "loops", "loops.csv", "walker"
WORLD = WORLDS[0]
MEMBERS = {"population": 6, "learning": 5}
ARMS = {
    "lamarckian": Arm("two loops, what is learnt is inherited", "lamarckian", MEMBERS),
    "baldwinian": Arm("two loops, it is not", "lamarckian", {**MEMBERS, "inherit": False}),
    "flat": Arm("one loop, without gradients", "genetic", {"population": 24}),
    "fixed": Arm("drawn body, gradients alone", "race", {"climbers": 8, "halving": 4, "moves": 60}),
}


@dataclass(frozen=True)
class Loops:
    """How long searches are, and how many.

    Attributes:
        seconds: of CPU time of a run.
        seeds: runs of each arm.
        cycles: of a trial.
    """

    seconds: float
    seeds: int
    cycles: int

    def contest(self, folder: Path, seed: int) -> Contest:
        """The searches of a seed, each of which may have a body of its own."""
        entries = {
            name: Entry(partial(problem, name, seed, self.cycles), a.method, a.settings) for name, a in ARMS.items()
        }
        return Contest(entries, "cpu", self.seconds, folder / "runs", lambda line: None)


def problem(arm: str, seed: int, cycles: int) -> RobotProblem:
    """What an arm designs: a drawn walker's controller, or both; in single precision, for one thread."""
    fixed = arm == "fixed"
    robot = body_of(drawn_body(np.random.default_rng((seed, 6))), cycles) if fixed else EvolvableWalker(cycles)
    return RobotProblem(robot, (WORLD,), objective="minimise:remaining", precision="f32", threads=1)


def run_loops(folder: Path, loops: Loops, progress: Progress = None, jobs: int = 1) -> Sequence[Record]:
    """A row for each run; those that are whole are not run again."""
    runs: list[Run] = [(SUBJECT, arm, seed) for seed in range(loops.seeds) for arm in ARMS]
    return JudgedRuns(folder, TABLE, SUBJECT, loops.seconds, partial(_judged, folder, loops)).complete(
        runs, progress, jobs
    )


def _judged(folder: Path, loops: Loops, run: Run) -> Record:
    """How much nearer the best of a run comes [m], and what it took."""
    _, arm, seed = run
    contest = loops.contest(folder, seed)
    best, evaluations = best_of_search(contest, arm, seed, loops.seconds, ARMS[arm].gradients)
    if best is None:
        return {"evaluations": evaluations, "nearer": None}
    designed = problem(arm, seed, loops.cycles)
    remaining = -float(designed.evaluate(designed.space.from_dict(best)[None]).objectives[0, 0])
    return {"evaluations": evaluations, "nearer": LIGHT_AT - remaining}
