"""Robots that walk on a floor that is not known exactly: searches that meet few draws at a time, or all of them.

A design is worth its mean speed over draws of friction, slope and levels. Searches along gradients and evolution
strategies are compared at equal CPU time; each judges designs in all draws, or in a minibatch of them. What a search
has found is then simulated in double precision over 64 draws that no search has met.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.equal_cost import Arm, Contest, Entry, of_kind
from optim.experiments.judged_runs import JudgedRuns, Run, best_of_search, save_best
from optim.experiments.results import Progress, write_json
from optim.experiments.study import Count, Settings, Several, Study, some_of
from optim.experiments.tables import Record, between, cell, column, distinct, markdown, page, select
from optim.measures.statistics import known_mean, ratio_of_means
from optim.problems.robot import RobotProblem
from robots.freeform.grid import Grid
from robots.freeform.robot import FreeformRobot
from robots.lattice_robot.presets import soft_quadruped
from robots.robot import Robot
from robots.uncertainty import HELD_OUT, Uncertainty
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import positive
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text
from taichi_sim.base.results_folder import ResultsFolder

NAME = "uncertain-walking"
TABLE = "runs.csv"
FILES = ("table.md", TABLE, "summary.json", "runs", "designs")
EXACT = Compute(precision="f64", threads=1)
ROBOTS: Mapping[str, Callable[[], Robot]] = {
    "quadruped": partial(soft_quadruped, 4),
    "block": partial(FreeformRobot, Grid((12, 4, 3)), full=True),
}
_NES = {"population": 16, "random_mean": True, "sigma": 0.1}
ARMS = {
    "race": Arm("gradient race, all draws", "race", {"climbers": 8}),
    "stochastic": Arm("stochastic ascent, 1 draw a move", "stochastic", {}),
    "nes": Arm("NES, all draws", "nes", _NES),
    "nes-minibatch": Arm("NES, 2 draws a generation", "nes", {**_NES, "minibatch_size": 2}),
}
COLUMNS: dict[str, Kind] = {
    "robot": tuple(ROBOTS),
    "search": tuple(ARMS),
    "seed": int,
    "evaluations": int,
    "trained": float | None,
    "speed": float,
    "worst": float | None,
}


@dataclass(frozen=True)
class UncertainWalking(Settings):
    """How robots are searched for and judged.

    Attributes:
        seconds: of CPU time of a run.
        seeds: runs of every search.
        robots: of ``ROBOTS``.
        draws: of what is uncertain, for searches that meet all.
        held_out: draws that judge.
        uncertain: as a text, see ``robots.uncertainty``.
    """

    seconds: Annotated[float, positive] = 60.0
    seeds: Count = 5
    robots: Annotated[tuple[str, ...], partial(some_of, names=ROBOTS)] = tuple(ROBOTS)
    draws: Several = 16
    held_out: Several = 64
    uncertain: str = "friction=20%,slope=3,levels=10%"

    def __post_init__(self) -> None:
        super().__post_init__()
        Uncertainty.parse(self.uncertain)

    @property
    def runs(self) -> list[Run]:
        """Robot, search and seed of every run, seed by seed."""
        return [(robot, arm, seed) for seed in range(self.seeds) for robot in self.robots for arm in ARMS]

    def problem(self, robot: str, precision: str = "f32") -> RobotProblem:
        """A robot over the draws, for one thread."""
        about: dict[str, Any] = {"uncertain": self.uncertain, "draws": self.draws}
        return RobotProblem(ROBOTS[robot](), (Terrain(),), **about, precision=precision, threads=1)

    def contest(self, robot: str, folder: Path) -> Contest:
        """The searches of a robot."""
        entries = {name: Entry(partial(self.problem, robot), arm.method, arm.settings) for name, arm in ARMS.items()}
        return Contest(entries, "cpu", self.seconds, folder / "runs" / robot, lambda line: None)


def study(folder: Path, settings: UncertainWalking, progress: Progress = None, jobs: int = 1) -> None:
    """Write what runs have found, and a table; runs that are whole in the folder are not run again."""
    ResultsFolder(folder, NAME, settings.lasting("seeds"))
    runs = JudgedRuns(folder, TABLE, "robot", settings.seconds, partial(_judged, folder, settings))
    _report(folder, settings, runs.complete(settings.runs, progress, jobs))


def rewrite(data: Data, folder: Path) -> None:
    """Write the table and ``summary.json`` from the table of runs."""
    _report(folder, data.settings(UncertainWalking), data.records(TABLE, COLUMNS))


def speeds(robot: Robot, settings: UncertainWalking, compute: Compute = EXACT) -> Floats:
    """Speeds of a robot, of which nothing is free, over draws that no search has met; 0 where it diverges."""
    drawn = Uncertainty.parse(settings.uncertain).draw(settings.held_out, HELD_OUT, actuators=robot.actuators)
    outcomes = robot.simulate_in([robot.drawn_terrain(Terrain(), one) for one in drawn], draws=drawn, compute=compute)
    return np.nan_to_num(np.array([outcome.measures["speed"][0] for outcome in outcomes], float))


def _judged(folder: Path, settings: UncertainWalking, run: Run) -> Record:
    """What a search finds, over draws that it has not met; its design is saved."""
    robot, arm, seed = run
    contest = settings.contest(robot, folder)
    best, evaluations = best_of_search(contest, arm, seed, settings.seconds, ARMS[arm].gradients)
    if best is None:
        return {"evaluations": evaluations, "trained": None, "speed": 0.0, "worst": None}
    problem = settings.problem(robot, EXACT.precision)
    point = save_best(problem, best, folder / "designs" / f"{robot}-{arm}-{seed}.json")
    found = speeds(problem.robot_of(point), settings)
    trained = float(problem.evaluate(point[None]).objectives[0, 0])
    return {
        "evaluations": evaluations,
        "trained": trained,
        "speed": float(found.mean()),
        "worst": float(found.min()),
    }


def _report(folder: Path, settings: UncertainWalking, rows: Sequence[Record]) -> None:
    """Write ``summary.json`` and ``table.md``, which follow from the table of runs."""
    told = {robot: _of_robot(select(rows, robot=robot)) for robot in distinct(rows, "robot")}
    write_json(folder / "summary.json", {"settings": settings.describe(), "robots": told})
    write_text(folder / "table.md", page(*[part for robot, one in told.items() for part in _table(robot, one)]))


def _of_robot(rows: Sequence[Record]) -> dict[str, Any]:
    """What the searches of a robot found, and how the best along gradients compares with the best without."""
    found = {arm: _summary(select(rows, search=arm)) for arm in distinct(rows, "search")}
    told: dict[str, Any] = {"variables": len(ROBOTS[rows[0]["robot"]]().parameters), "searches": found}
    best = [
        max(of_kind(ARMS, found, kind), key=lambda name: found[name]["speed"], default="") for kind in (True, False)
    ]
    if all(best) and min(each["seeds"] for each in found.values()) > 1:
        gradient, other = (column(select(rows, search=name), "speed") for name in best)
        if other.mean() > 0:
            ratio, low, high = ratio_of_means(gradient, other)
            told["advantage"] = {"of": best[0], "over": best[1], "ratio": ratio, "low": low, "high": high}
    return told


def _summary(rows: Sequence[Record]) -> dict[str, Any]:
    """What a search found."""
    worst = [row["worst"] for row in rows if row["worst"] is not None]
    return {
        "label": ARMS[rows[0]["search"]].label,
        "seeds": len(rows),
        **known_mean(column(rows, "speed"), "speed"),
        "worst": float(np.mean(worst)) if worst else None,
        "evaluations": float(np.median(column(rows, "evaluations"))),
    }


def _table(robot: str, told: Mapping[str, Any]) -> list[str | list[str]]:
    """A table of the searches of a robot, the best first, and the advantage of the gradient."""
    lines = [
        (
            each["label"],
            f"{each['evaluations']:.0f}",
            f"{each['speed']:.3f}",
            f"{cell(each['low'], '.3f')} to {cell(each['high'], '.3f')}",
            cell(each["worst"], ".3f"),
        )
        for each in sorted(told["searches"].values(), key=lambda one: -one["speed"])
    ]
    header = ("search", "evaluations", "mean speed [BL/s]", "95 % interval", "worst draw")
    parts: list[str | list[str]] = [f"{robot}, {told['variables']} variables", markdown(header, "lrrrr", lines)]
    if one := told.get("advantage"):
        label, other = (ARMS[one[key]].label for key in ("of", "over"))
        parts.append(
            f"{label} over {other}: {one['ratio']:.2f} times the speed, 95 % interval "
            f"{between(one['low'], one['high'])}."
        )
    return parts


STUDY = Study(
    title="walking on a floor that is not known exactly: a few draws at a time, and all of them",
    source="beyond chapter 5",
    scales={
        "small": UncertainWalking(seconds=5.0, seeds=1, robots=("quadruped",), draws=4, held_out=8),
        "medium": UncertainWalking(),
        "full": UncertainWalking(seconds=240.0, seeds=10),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="six hours of one core; medium takes 50 minutes",
)
