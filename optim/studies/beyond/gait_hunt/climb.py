"""A gait that climbs 15 degrees, found by a program from random gaits: what each of its steps finds, and costs.

See ``program``. The last designs that its last three steps found best are played in full, with
noise, under both conditions of ``robots.inflatable.robustness``; the best of them is what the program has found.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, check_runs, write_json
from optim.experiments.study import Study
from optim.experiments.tables import Record, markdown, page, select, write_records
from optim.studies.beyond.gait_hunt.finalists import (
    FOUND,
    Finalist,
    Finals,
    Seeds,
    best_of,
    cached_finalists,
    finalist_columns,
    hill_of,
    write_gaits,
)
from optim.studies.beyond.gait_hunt.program import RUNGS, Plan, Program, Step
from optim.studies.beyond.gait_hunt.searches import PUBLISHED_COST
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base.files import write_text

TABLES = ("seeds.csv", "steps.csv")  # what the summary, the page and the figure are made from
FILES = ("table.md", *TABLES, "climb.png", "summary.json", "runs", "gaits")


@dataclass(frozen=True)
class Climb(Finals):
    """How large the study is; finalists are designs of each of the last three steps."""

    fixed: ClassVar = ("plan",)  # folders do not tell of it
    seeds: Seeds  # of the programs
    plan: Plan = field(default_factory=Plan)  # of each of them


Climbed = tuple[Sequence[Step], Mapping[str, Sequence[Finalist]]]  # steps, and finalists by the step that found them


def study(folder: Path, settings: Climb, progress: Progress = None, jobs: int = 1, **compute: Any) -> None:
    """Write runs, tables, ``summary.json``, ``climb.png``, and the gait that each seed found."""
    check_runs(folder, "gait-climb", TABLES, FILES)
    tasks = [(f"seed {seed}", partial(_climb, folder / "runs", settings, seed)) for seed in settings.seeds]
    run_parallel(tasks, jobs, compute, progress)
    found = dict[int, Climbed]()
    for number, (seed, (_, climb)) in enumerate(zip(settings.seeds, tasks, strict=True)):
        found[seed] = climb(compute, part_of(progress if jobs == 1 else None, number, len(tasks)))
        _report(folder, settings, found)
    if progress:
        progress(1.0)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json``, ``table.md`` and ``climb.png`` from the tables of seeds and steps."""
    about: dict[str, Kind] = {**dict.fromkeys(("seed", "evaluations"), int), "robot_steps": float, "stays": bool}
    rows = data.records(TABLES[0], {**about, "found_by": str | None, **FOUND})
    lists = dict.fromkeys(("speeds", "hard_speeds"), list)
    steps = data.records(TABLES[1], {"seed": int, **dict.fromkeys(("step", "terrains"), str), **lists})
    for row in rows:
        seed, name = row["seed"], row["found_by"]
        if name is not None and not select(steps, seed=seed, step=name):
            raise ValueError(f"{data.folder / TABLES[0]}: seed {seed} has no step {name} in {TABLES[1]}")
    seeds = tuple(row["seed"] for row in rows)
    write_reports(folder, data.from_summary(lambda summary: Climb(seeds, **hill_of(summary))), rows, steps)


def _climb(runs: Path, settings: Climb, seed: int, compute: Mapping[str, Any], progress: Progress) -> Climbed:
    """The program of one seed, and its finalists."""
    options = {"geometry": settings.geometry, **compute}
    ground, share = replace(settings.terrain, slope=0.0), part_of(progress, 0, 10, 9)
    program = Program(runs / f"seed-{seed}", settings.plan, seed, settings.slope, share, options, ground=ground)
    finalists: dict[str, Sequence[Finalist]] = {}
    for number, step in enumerate(program.run()):
        path, share = runs / f"seed-{seed}-{step.name}.json", part_of(progress, 27 + number, 30)
        (finalists[step.name],) = cached_finalists(path, [step.history], step.problem, settings, share, **compute)
    return list(program.steps.values()), finalists


def _report(folder: Path, settings: Climb, found: Mapping[int, Climbed]) -> None:
    """Write what some seeds have found: tables, what follows from them, and gaits."""
    bests = {
        seed: best_of([one for each in finalists.values() for one in each]) for seed, (_, finalists) in found.items()
    }
    rows = [_row(seed, *climbed, bests[seed]) for seed, climbed in found.items()]
    steps = [{"seed": seed, **_step_row(step)} for seed, (each, _) in found.items() for step in each]
    write_records(folder / TABLES[0], rows)
    write_records(folder / TABLES[1], steps)
    write_reports(folder, settings, rows, steps)
    write_gaits(folder / "gaits", {f"seed-{seed}": best for seed, best in bests.items()})


def _row(
    seed: int, steps: Sequence[Step], finalists: Mapping[str, Sequence[Finalist]], best: Finalist | None
) -> dict[str, Any]:
    """A seed in a line."""
    spent = sum(step.spent for step in steps)
    return {
        "seed": seed,
        "evaluations": sum(step.last.evaluations for step in steps),
        "robot_steps": spent,
        "published_evaluations": spent / PUBLISHED_COST,
        "wall_s": float(sum(np.nansum(step.history.seconds) for step in steps)),
        "stays": best.stays if best else False,
        "found_by": next((name for name, each in finalists.items() if best in each), None),
        **finalist_columns(best),
    }


def _step_row(step: Step) -> dict[str, Any]:
    """A step in a line: terrains, cost, and the best's score and speeds on the terrains that it was tried on."""
    return {
        "step": step.name,
        "terrains": " ".join(terrain.name for terrain in step.problem.terrains),
        "evaluations": step.last.evaluations,
        "robot_steps": step.spent,
        "score": step.last.best,
        "speeds": [round(speed, 4) for speed in step.speeds.values()],
        "hard_speeds": [round(speed, 4) for speed in step.hard_speeds],
    }


def write_reports(folder: Path, settings: Climb, rows: Sequence[Record], steps: Sequence[Record]) -> None:
    """Write ``summary.json``, ``table.md`` and ``climb.png``, all that follows from the records of both tables."""
    write_json(folder / "summary.json", {**settings.about_hill, "seeds": rows, "steps": steps})
    write_text(folder / "table.md", text_of(rows))
    _draw(settings, rows, steps, folder / "climb.png")


def text_of(rows: Sequence[Record]) -> str:
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
    return page(
        markdown((*effort, "found by", "heading", "core [kPa]", "speed", "harder", "stays"), "rrrlrrrrl", cells)
    )


def _draw(settings: Climb, rows: Sequence[Record], steps: Sequence[Record], path: Path) -> None:
    """Speed of each step's best on the slopes of the first ladder, a panel a seed; looks are judged in another way.

    Crosses are speeds under the harder conditions, of the steps that judge them.
    """
    names = [Terrain(rung * settings.slope).name for rung in RUNGS]
    with figure(path, PAGE, 2.6, ncols=len(rows), sharey=True) as (drawn, panels):
        for panel, row in zip(panels[0], rows, strict=True):
            mine = [step for step in steps if step["seed"] == row["seed"] and not step["step"].startswith("look")]
            for name, colour in zip(names, COLOURS, strict=False):
                for speeds, marker, label in (("speeds", "o", name), ("hard_speeds", "x", f"{name}, harder")):
                    each = [dict(zip(step["terrains"].split(), step[speeds], strict=False)) for step in mine]
                    told = [(place, found[name]) for place, found in enumerate(each) if name in found]
                    named = label if told or speeds == "speeds" else None
                    panel.plot(*np.array(told).reshape(-1, 2).T, marker, color=colour, label=named, markersize=4)
            places = [step["step"] for step in mine]
            if row["found_by"]:
                panel.plot(places.index(row["found_by"]), row["speed"], "k*", label="in full")
            panel.axhline(0.0, color="0.7", linewidth=0.6)
            panel.set(title=f"seed {row['seed']}", xticks=range(len(mine)))
            panel.set_xticklabels(places, rotation=90)
        panels[0, 0].set(ylabel="speed of the step's best [BL/s]")
        shown = {line.get_label(): line for panel in panels[0] for line in panel.get_legend_handles_labels()[0]}
        legend_above(drawn, list(shown.values()))


STUDY = Study(
    title="a program that finds gaits which climb 15 degrees: random ones, their kinds refined, the best led uphill",
    source="chapter 5, discussion: why the search did not find inching on the hill",
    scales={
        "small": Climb((0,), Plan(8, 6, 2, 4, (1, 1), (2 / 3,), 4, 4, 1), geometry="small", finalists=2, runs=2),
        "medium": Climb((0,)),
        "full": Climb((0, 1, 2, 3, 4)),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="15 h of CPU time",
)
