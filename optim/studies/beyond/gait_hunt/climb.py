"""A gait that climbs 15 degrees, found by a program from random gaits: what each of its steps finds, and costs.

See ``program``. The last designs that its last three steps found best are played in full, with
noise, under both conditions of ``robots.inflatable.robustness``; the best of them is what the program has found.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure, letter
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Budget, Progress, check_folder, check_tables, part_of, tables_alone, write_json
from optim.experiments.study import Study
from optim.experiments.tables import markdown, read_records, write_records
from optim.problems.inflatable.problem import HARD
from optim.studies.beyond.gait_hunt.finalists import (
    Finalist,
    Finals,
    best_of,
    cached_finalists,
    check_seeds,
    columns_of,
    write_gaits,
)
from optim.studies.beyond.gait_hunt.program import RUNGS, Plan, Program, Step
from optim.studies.beyond.gait_hunt.spending import PUBLISHED_COST
from robots.world import Terrain
from taichi_sim.base.files import write_text

Record = Mapping[str, Any]
TABLES = ("seeds.csv", "steps.csv")  # what the summary, the page and the figure are made from
FILES = (*TABLES, "runs", "gaits", "table.md", "climb.png", "summary.json")


@dataclass(frozen=True)
class Climb(Finals):
    """How large the study is; finalists are designs of each of the last three steps.

    Attributes:
        seeds: of the programs.
        plan: of each of them.
    """

    seeds: tuple[int, ...]
    plan: Plan = field(default_factory=Plan)

    def __post_init__(self) -> None:
        check_seeds(self.seeds)
        super().__post_init__()


SCALES: Mapping[Budget, Climb] = {
    "small": Climb((0,), Plan(8, 6, 2, 4, (1, 1), (2 / 3,), 4, 4, 1), geometry="small", finalists=2, runs=2),
    "medium": Climb((0,)),
    "full": Climb((0, 1, 2, 3, 4)),
}


@dataclass(frozen=True, eq=False)
class Climbed:
    """The steps and finalists of the program with one seed.

    Attributes:
        seed: of the program.
        steps: it made, in the order in which they began.
        finalists: played in full, by the step that found them.
    """

    seed: int
    steps: Sequence[Step]
    finalists: Mapping[str, Sequence[Finalist]]

    @property
    def best(self) -> Finalist | None:
        """The best of all finalists; None if all failed."""
        return best_of([one for found in self.finalists.values() for one in found])

    @property
    def found_by(self) -> str | None:
        """The step that found the best."""
        return next((name for name, found in self.finalists.items() if self.best in found), None)

    @property
    def spent(self) -> float:
        """Cost of all steps [robot-steps]."""
        return sum(step.spent for step in self.steps)


def study(folder: Path, settings: Climb, progress: Progress = None, jobs: int = 1, **where: Any) -> None:
    """Write runs, tables, ``summary.json``, ``climb.png``, and the gait that each seed found.

    Where the folder holds the tables alone, the rest is made from them.

    Args:
        folder, settings, progress: see :class:`optim.experiments.study.Study`.
        jobs: programs that go on at the same time, each in a process of its own.
        where: precision, device and threads of the simulations.
    """
    check_folder(folder, FILES, "gait-climb")
    if tables_alone(folder, "runs", TABLES):
        check_tables(folder, {"slope": settings.slope})
        write_reports(folder, settings, *(read_records(folder / name) for name in TABLES))
        return
    seeds, found = settings.seeds, list[Climbed]()
    tasks = [(f"seed {seed}", partial(_climb, folder / "runs", settings, seed)) for seed in seeds]
    run_parallel(tasks, jobs, where, progress)
    for number, seed in enumerate(seeds):
        share = part_of(progress if jobs == 1 else None, number, len(seeds))
        found.append(_climb(folder / "runs", settings, seed, where, share))
        _report(folder, settings, found)
    if progress:
        progress(1.0)


def _climb(runs: Path, settings: Climb, seed: int, where: Mapping[str, Any], progress: Progress) -> Climbed:
    """The program of one seed, and its finalists."""
    options = {"geometry": settings.geometry, **where}
    program = Program(runs / f"seed-{seed}", settings.plan, seed, settings.slope, part_of(progress, 0, 10, 9), options)
    finalists: dict[str, Sequence[Finalist]] = {}
    for number, step in enumerate(program.run()):
        path, share = runs / f"seed-{seed}-{step.name}.json", part_of(progress, 27 + number, 30)
        (finalists[step.name],) = cached_finalists(path, [step.history], step.problem, settings, share, **where)
    return Climbed(seed, list(program.steps.values()), finalists)


def _report(folder: Path, settings: Climb, found: Sequence[Climbed]) -> None:
    """Write what some seeds have found: tables, what follows from them, and gaits."""
    rows = [_row(one) for one in found]
    steps = [{"seed": one.seed, **row} for one in found for row in _step_rows(one)]
    for name, records in zip(TABLES, (rows, steps), strict=True):
        write_records(folder / name, records)
    write_reports(folder, settings, rows, steps)
    write_gaits(folder / "gaits", {f"seed-{one.seed}": one.best for one in found})


def write_reports(folder: Path, settings: Climb, rows: Sequence[Record], steps: Sequence[Record]) -> None:
    """Write ``summary.json``, ``table.md`` and ``climb.png``, all that follows from the tables.

    Args:
        folder: takes the files.
        settings: of the study.
        rows: the records of ``seeds.csv``, one of each seed.
        steps: the records of ``steps.csv``, one of each step of each seed.
    """
    write_json(folder / "summary.json", {"slope": settings.slope, "seeds": rows, "steps": steps})
    write_text(folder / "table.md", _table(rows))
    _draw(settings, rows, steps, folder / "climb.png")


def _row(one: Climbed) -> dict[str, Any]:
    """A seed in a line."""
    return {
        "seed": one.seed,
        "evaluations": sum(step.last.evaluations for step in one.steps),
        "robot_steps": one.spent,
        "published_evaluations": one.spent / PUBLISHED_COST,
        "wall_s": float(sum(np.nansum(step.history.seconds) for step in one.steps)),
        "stays": one.best.stays if one.best else False,
        "found_by": one.found_by,
        **columns_of(one.best),
    }


def _step_rows(one: Climbed) -> list[dict[str, Any]]:
    """The steps of a seed: terrains, cost, and the best's score and speeds on the terrains that it was tried on."""
    return [
        {
            "step": step.name,
            "terrains": " ".join(terrain.name for terrain in step.problem.terrains),
            "evaluations": step.last.evaluations,
            "robot_steps": step.spent,
            "score": step.last.best,
            "speeds": [round(speed, 4) for speed in step.speeds.values()],
            "hard_speeds": _hard_speeds(step),
        }
        for step in one.steps
    ]


def _hard_speeds(step: Step) -> list[float]:
    """Speeds of the step's best on its terrains under the harder conditions; empty if it was not tried there."""
    details = step.last.best_details or {}
    names = [f"speed_{terrain.name}{HARD}" for terrain in step.problem.terrains]
    return [round(details[name], 4) for name in names if name in details]


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The seeds in Markdown."""
    cells = []
    for row in rows:
        found = ("",) * 5
        if row["speed"] is not None:
            shape = f"{row['orientation']:.0f}°", f"{np.max(row['pressure']) / 1e3:.1f}"
            found = (row["found_by"], *shape, f"{row['speed']:.4f}", f"{row['hard_speed']:.4f}")
        effort = row["seed"], row["evaluations"], f"{row['robot_steps'] / 1e6:.1f}"
        cells.append((*effort, *found, "yes" if row["stays"] else "no"))
    effort = ("seed", "evaluations", "million robot-steps")
    header = (*effort, "found by", "heading", "core [kPa]", "speed", "harder", "stays")
    return "\n".join(markdown(header, "rrrlrrrrl", cells)) + "\n"


def _draw(settings: Climb, rows: Sequence[Record], steps: Sequence[Record], path: Path) -> None:
    """Speed of each step's best on the slopes of the first ladder, a panel a seed; looks are judged in another way.

    Crosses are speeds under the harder conditions, of the steps that judge them.
    """
    names = [Terrain(rung * settings.slope).name for rung in RUNGS]
    with figure(path, PAGE, 2.4, ncols=len(rows), sharey=True) as (_, panels):
        for panel, row in zip(panels[0], rows, strict=True):
            mine = [step for step in steps if step["seed"] == row["seed"] and not step["step"].startswith("look")]
            for name, colour in zip(names, COLOURS, strict=False):
                for column, marker, label in (("speeds", "o", name), ("hard_speeds", "x", f"{name}, harder")):
                    each = [dict(zip(step["terrains"].split(), step[column], strict=False)) for step in mine]
                    told = [(place, speeds[name]) for place, speeds in enumerate(each) if name in speeds]
                    shown = label if told or column == "speeds" else None
                    panel.plot(*np.array(told).reshape(-1, 2).T, marker, color=colour, label=shown, markersize=4)
            places = {step["step"]: place for place, step in enumerate(mine)}
            if row["found_by"]:
                panel.plot(places[row["found_by"]], row["speed"], "k*", label="in full")
            panel.axhline(0.0, color="0.7", linewidth=0.6)
            panel.set(title=f"seed {row['seed']}", xticks=range(len(mine)))
            panel.set_xticklabels(list(places), rotation=90)
        panels[0, 0].set(ylabel="speed of the step's best [BL/s]")
        panels[0, 0].legend()
        if len(rows) > 1:
            letter(panels)


STUDY = Study(
    title="a program that finds gaits which climb 15 degrees: random ones, their kinds refined, the best led uphill",
    source="chapter 5, discussion: why the search did not find inching on the hill",
    scales=SCALES,
    run=study,
    writes=("table.md", "seeds.csv", "steps.csv", "climb.png", "summary.json", "runs", "gaits"),
    cost="15 h of CPU time",
)
