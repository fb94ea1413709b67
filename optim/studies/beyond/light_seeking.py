"""A soft walker that finds a light by what it feels: trained along gradients and without them, at equal CPU time.

The robot is a quadruped of muscles that feels a light at each of them, and the time; the waves of its muscles and the
weights of a network with 16 hidden nodes are free. It is trained under a fan of lights, and judged, in double
precision, by how many of 64 lights that it has never met it comes near.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.equal_cost import Arm, Contest, Entry, of_kind
from optim.experiments.judged_runs import JudgedRuns, Run, best_of_search, save_best
from optim.experiments.results import Progress, write_json
from optim.experiments.study import Count, Settings, Several, Study
from optim.experiments.tables import Record, cell, column, distinct, markdown, page, select
from optim.measures.statistics import difference_of_means, known_mean
from optim.problems.robot import RobotProblem
from robots.lattice_robot.presets import light_seeker
from robots.robot import Robot
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import positive
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text
from taichi_sim.base.results_folder import ResultsFolder

NAME, ROBOT = "light-seeking", "light-seeker"
TABLE = "runs.csv"
FILES = ("table.md", TABLE, "summary.json", "runs", "designs")
EXACT = Compute(precision="f64", threads=1)
WIDEST = 60.0  # degrees to either side of the way ahead
NEAR, FAR = 0.06, 0.1  # distance of held-out lights [m]; those of training are half way
OBJECTIVE = ("mean", "minimise:remaining")
NES = {"population": 16, "random_mean": True, "sigma": 0.1}
STOCHASTIC = {"minibatch_size": 2, "moves": 350, "learning_rate": 0.008, "clip": 0.1}
ARMS = {
    "gradient": Arm("gradient ascent", "gradient", {"climbers": 2, "candidates": 16, "patience": 30}),
    "stochastic": Arm("stochastic ascent, 2 lights a move", "stochastic", STOCHASTIC),
    "horizon": Arm(
        "short gradients, 2 lights a move",
        "stochastic",
        {"minibatch_size": 2, "moves": 350, "learning_rate": 0.02},
        horizon=0.06,  # a quarter of a cycle
    ),
    "nes": Arm("NES", "nes", NES),
    "nes-minibatch": Arm("NES, 2 lights a generation", "nes", {**NES, "minibatch_size": 2}),
    "cma": Arm("CMA-ES", "cma", {"population": 16}),
}
COLUMNS: dict[str, Kind] = {
    "search": tuple(ARMS),
    "seed": int,
    "evaluations": int,
    "remaining": float | None,
    "reached": int,
}


@dataclass(frozen=True)
class LightSeeking(Settings):
    """How the robot is trained and judged.

    Attributes:
        seconds: of CPU time of a run.
        seeds: runs of every search.
        cycles: of the robot that count.
        lights: of training, evenly in a fan.
        held_out: lights that judge.
        reach: distance at which a light is reached [m].
    """

    seconds: Annotated[float, positive] = 240.0
    seeds: Count = 5
    cycles: Count = 4
    lights: Several = 8
    held_out: Several = 64
    reach: Annotated[float, positive] = 0.03

    @property
    def runs(self) -> list[Run]:
        """Robot, search and seed of every run, seed by seed."""
        return [(ROBOT, arm, seed) for seed in range(self.seeds) for arm in ARMS]

    def problem(self, worlds: Sequence[Terrain], precision: str = "f32", horizon: float | None = None) -> RobotProblem:
        """The robot under some lights, for one thread."""
        return RobotProblem(
            light_seeker(self.cycles),
            tuple(worlds),
            OBJECTIVE,
            summed=True,
            gradient_horizon=horizon,
            precision=precision,
            threads=1,
        )

    @property
    def training(self) -> list[Terrain]:
        """A fan of lights at the mean distance."""
        middle = WIDEST * (2 * (np.arange(self.lights) + 0.5) / self.lights - 1)
        return _lit(np.full(self.lights, (NEAR + FAR) / 2), middle)

    @property
    def judging(self) -> list[Terrain]:
        """Lights drawn evenly by distance and angle, the same for all runs."""
        drawn = np.random.default_rng(0)
        return _lit(drawn.uniform(NEAR, FAR, self.held_out), drawn.uniform(-WIDEST, WIDEST, self.held_out))

    def contest(self, folder: Path) -> Contest:
        """The searches."""
        entries = {
            name: Entry(partial(self.problem, self.training, horizon=arm.horizon), arm.method, arm.settings)
            for name, arm in ARMS.items()
        }
        return Contest(entries, "cpu", self.seconds, folder / "runs", lambda line: None)


def _lit(distances: Floats, angles: Floats) -> list[Terrain]:
    """Flat ground with a light at each distance [m] and angle to the left [degrees]."""
    x, y = distances * np.cos(np.radians(angles)), distances * np.sin(np.radians(angles))
    return [Terrain(light=(float(a), float(b))) for a, b in zip(x, y, strict=True)]


def study(folder: Path, settings: LightSeeking, progress: Progress = None, jobs: int = 1) -> None:
    """Write what runs have found, and a table; runs that are whole in the folder are not run again."""
    ResultsFolder(folder, NAME, settings.lasting("seeds"))
    runs = JudgedRuns(folder, TABLE, "robot", settings.seconds, partial(_judged, folder, settings))
    _report(folder, settings, runs.complete(settings.runs, progress, jobs))


def rewrite(data: Data, folder: Path) -> None:
    """Write the table and ``summary.json`` from the table of runs."""
    _report(folder, data.settings(LightSeeking), data.records(TABLE, COLUMNS))


def remaining(robot: Robot, worlds: Sequence[Terrain], compute: Compute = EXACT) -> Floats:
    """How far from each light a robot ends, of which nothing is free [m]; infinite where it diverges."""
    found = [robot.simulate((), world, compute=compute).measures["remaining"][0] for world in worlds]
    return np.nan_to_num(np.array(found, float), nan=np.inf)


def _judged(folder: Path, settings: LightSeeking, run: Run) -> Record:
    """What a search finds, by lights that it has not met; its design is saved."""
    _, arm, seed = run
    contest = settings.contest(folder)
    best, evaluations = best_of_search(contest, arm, seed, settings.seconds, ARMS[arm].gradients)
    if best is None:
        return {"evaluations": evaluations, "trained": None, "remaining": None, "reached": 0}
    problem = settings.problem(settings.training, EXACT.precision)
    robot = problem.robot_of(save_best(problem, best, folder / "designs" / f"{arm}-{seed}.json"))
    trained, found = (remaining(robot, lights) for lights in (settings.training, settings.judging))
    reached = int((found <= settings.reach).sum())
    return {
        "evaluations": evaluations,
        "trained": float(trained.mean()),
        "remaining": float(found.mean()),
        "reached": reached,
    }


def _report(folder: Path, settings: LightSeeking, rows: Sequence[Record]) -> None:
    """Write ``summary.json`` and ``table.md``, which follow from the table of runs."""
    found = {arm: _summary(select(rows, search=arm), settings) for arm in distinct(rows, "search")}
    told: dict[str, Any] = {"settings": settings.describe(), "searches": found}
    best = {
        kind: max(of_kind(ARMS, found, kind), key=lambda name: found[name]["share"], default="")
        for kind in (True, False)
    }
    if all(best.values()) and min(each["seeds"] for each in found.values()) > 1:
        gradient, other = (column(select(rows, search=best[kind]), "reached") for kind in (True, False))
        told["advantage"] = {
            "of": best[True],
            "over": best[False],
            **_difference(gradient / settings.held_out, other / settings.held_out),
        }
    write_json(folder / "summary.json", told)
    write_text(folder / "table.md", page(*_table(told, settings)))


def _difference(gradient: Floats, other: Floats) -> dict[str, float]:
    found = difference_of_means(other, gradient)
    return {"difference": found.difference, "low": found.low, "high": found.high}


def _summary(rows: Sequence[Record], settings: LightSeeking) -> dict[str, Any]:
    """What a search found."""
    shares = column(rows, "reached") / settings.held_out
    ends = [row["remaining"] for row in rows if row["remaining"] is not None]
    return {
        "label": ARMS[rows[0]["search"]].label,
        "seeds": len(rows),
        **known_mean(shares, "share"),
        "each": column(rows, "reached").astype(int).tolist(),
        "remaining": float(np.mean(ends)) if ends else None,
        "evaluations": float(np.median(column(rows, "evaluations"))),
    }


def _table(told: Mapping[str, Any], settings: LightSeeking) -> list[str | list[str]]:
    """A table of the searches, the best first, and the advantage of the gradient."""
    lines = []
    for each in sorted(told["searches"].values(), key=lambda one: -one["share"]):
        interval = f"{cell(each['low'], '.0%')} to {cell(each['high'], '.0%')}"
        single = ", ".join(map(str, each["each"]))
        ends = cell(each["remaining"] and 100 * each["remaining"], ".1f")
        lines.append((each["label"], f"{each['evaluations']:.0f}", f"{each['share']:.0%}", interval, single, ends))
    header = ("search", "evaluations", "reached", "95 % interval", f"of {settings.held_out}, each seed", "left [cm]")
    parts: list[str | list[str]] = [markdown(header, "lrrrrr", lines)]
    if one := told.get("advantage"):
        label, other = (ARMS[one[key]].label for key in ("of", "over"))
        low, high = (f"{100 * one[key]:.0f}" for key in ("low", "high"))
        parts.append(
            f"{label} less {other}: {100 * one['difference']:.0f} percent points of the lights, 95 % interval {low} to "
            f"{high}."
        )
    return parts


STUDY = Study(
    title="a soft walker that finds a light by what it feels: gradients beside evolution strategies",
    source="beyond chapter 4",
    scales={
        "small": LightSeeking(seconds=10.0, seeds=1, cycles=1, lights=2, held_out=4),
        "medium": LightSeeking(),
        "full": LightSeeking(seconds=1200.0),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="nine hours of one core; medium takes two",
)
