"""How many bladders the inflatable robot needs, and where: a short search for a gait of every body, and evolution.

Of the 256 layouts of bladders 76 differ as bodies: a robot can be turned round and laid upside down. Each body gets
searches of one number of evaluations, from random waves (encoding ``graded-wave``), core pressures and headings; seeds
take turns in the way the body lies, as a search knows headings from rolling to inching only, and only one side of the
ground. The best design is written as a file, read again, and played in double precision with noise on its start; its
speed is the median of several starts. Beside these, evolution chooses the bladders with the gait, by a few times the
evaluations of one body, which is a small part of those of all.

Robot and rig are those of ``inflatable_gradients``: the small one, of a closed pouch, which inflates four times as fast
as published. Gaits are played for 10,000 time steps, of which the first quarter does not count, and the slower half of
the rest tells the speed.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data
from optim.experiments.equal_cost import Contest, Entry
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, check_runs, write_json
from optim.experiments.study import Count, Settings, Study, Whole, some_of
from optim.experiments.tables import (
    Record,
    column,
    distinct,
    markdown,
    mean_with_interval,
    page,
    read_records,
    select,
    write_records,
)
from optim.measures.statistics import known_mean
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import read_history
from optim.studies.beyond.inflatable_gradients import FASTER, replayed
from robots.calibration import Properties
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import load_design, save_design
from robots.inflatable.layout import WAYS_TO_LIE, Layout, different_layouts, laid, told_layout
from robots.inflatable.schedule import BLADDERS
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice
from taichi_sim.base.files import write_text

NAME = "bladder-layouts"
BODIES: dict[str, Layout] = {told_layout(layout): layout for layout in different_layouts()}
EVOLVED = "evolved"  # in the place of a body
STEPS, WARM_UP, STAGES = 10_000, 2_500, 2  # of gaits
POPULATION = 8
TABLE = "runs.csv"
FILES = ("table.md", TABLE, "summary.json", "runs", "gaits")
ABOUT = ("evaluations", "evolution", "geometry", "starts", "variables")  # what a report says of all runs
SHOWN = 12  # bodies of the table, the fastest first


@dataclass(frozen=True)
class Enumeration(Settings):
    """How large the enumeration is.

    Attributes:
        evaluations: of each search of a body.
        evolved: of each run of evolution, in searches of a body; 0 is none.
        seeds: searches of each body, which take turns in ``WAYS_TO_LIE``; runs of evolution.
        starts: replays of what a run has found.
        columns: of the gaits.
        geometry: of the body.
        bodies: of ``BODIES``, by their layouts in words.
    """

    evaluations: Count = 16
    evolved: Whole = 8
    seeds: Count = 4
    starts: Count = 1
    columns: Count = 4
    geometry: Annotated[str, partial(choice, names=NAMED_GEOMETRIES)] = "small-closed"
    bodies: Annotated[tuple[str, ...], partial(some_of, names=BODIES)] = tuple(BODIES)

    @property
    def runs(self) -> list[tuple[str, int]]:
        """Body and seed of every run, seed by seed; evolution is the last of each."""
        bodies = (*self.bodies, EVOLVED) if self.evolved else self.bodies
        return [(body, seed) for seed in range(self.seeds) for body in bodies]

    @property
    def about(self) -> dict[str, Any]:
        """What a report says of all runs."""
        variables = self.problem("none", 0).space.size
        told = (self.evaluations, self.evolved * self.evaluations, self.geometry, self.starts, variables)
        return dict(zip(ABOUT, told, strict=True))

    def problem(self, body: str, seed: int) -> GaitProblem:
        """What a search of a seed designs: a gait of a body as it lies for that seed, or body and gait."""
        published = Properties.of(NAMED_GEOMETRIES[self.geometry])
        rig = dataclasses.replace(published, inflation_rate=FASTER * published.inflation_rate)
        is_free = body == EVOLVED
        way = list(WAYS_TO_LIE)[seed % len(WAYS_TO_LIE)]
        return GaitProblem(
            (Terrain(),),
            columns=self.columns,
            encoding="graded-wave",
            steps=STEPS,
            warm_up=WARM_UP,
            stages=STAGES,
            geometry=self.geometry,
            properties=rig,
            threads=1,
            more=("bladders",) if is_free else (),
            bladders=None if is_free else laid(BODIES[body], way),
        )

    def contest(self, body: str, seed: int, folder: Path) -> Contest:
        """A run, as one of equal evaluations."""
        entries = {_file(body): Entry(partial(self.problem, body, seed), "genetic", {"population": POPULATION})}
        budget = self.evaluations * (self.evolved if body == EVOLVED else 1)
        return Contest(entries, "evaluations", budget, folder / "runs", lambda line: None)


def study(folder: Path, settings: Enumeration, progress: Progress = None, jobs: int = 1) -> None:
    """Write runs, the best design of each, a table of them, and what follows; runs go on where they ended."""
    grows = ("bodies", "seeds", "evaluations", "evolved", "starts")
    check_runs(folder, NAME, (TABLE,), FILES, settings.lasting(*grows))
    tasks = [(f"{_file(body)}-{seed}", partial(_search, folder, settings, body, seed)) for body, seed in settings.runs]
    run_parallel(tasks, jobs, {}, progress and part_of(progress, 0, 10, 9))
    rows, size = list[Record](), len(tasks) // settings.seeds
    for seed in range(settings.seeds):
        first = seed * size
        for number, (_, search) in enumerate(tasks[first : first + size], first + 1):
            search({}, None)
            if progress:
                progress((number - 1) / len(tasks))
        # In double precision, for which kernels are loaded anew: so all of a seed together.
        for body, _ in settings.runs[first : first + size]:
            _replay(folder, settings, body, seed)
            rows.append(_found(folder, settings, body, seed))
        write_records(folder / TABLE, rows)  # what there is so far is of use
        _report(folder, settings.about, rows)
    if progress:
        progress(1.0)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json`` and ``table.md`` from the table of runs."""
    kinds = {"seed": int, "evaluations": int, "score": float | None, "speed": float, "slowest": float, "fastest": float}
    rows = data.records(TABLE, {"body": (*BODIES, EVOLVED), "found": str, **kinds})
    _report(folder, data.from_summary(lambda summary: {name: summary[name] for name in ABOUT}), rows)


def _file(body: str) -> str:
    """A body in names of files."""
    return body.replace(",", "")


def _gait(folder: Path, body: str, seed: int) -> Path:
    return folder / "gaits" / f"{_file(body)}-{seed}.json"


def _search(
    folder: Path, settings: Enumeration, body: str, seed: int, compute: Mapping[str, Any], progress: Progress
) -> None:
    """Run a search, if it is not complete."""
    contest, name = settings.contest(body, seed, folder), _file(body)
    known = contest.curve(name, seed)
    if not known or known[-1]["evaluations"] < contest.budget:
        contest.run_one(name, seed)


def _replay(folder: Path, settings: Enumeration, body: str, seed: int) -> None:
    """Write what a search has found as a file, and replay that, if it is not done."""
    contest, name, path = settings.contest(body, seed, folder), _file(body), _gait(folder, body, seed)
    kept = path.with_suffix(".csv")
    known = read_records(kept) if kept.exists() else []
    if len(known) == settings.starts and known[0]["budget"] == contest.budget:
        return
    end, problem = contest.last_within(name, seed, contest.budget) or 0, settings.problem(body, seed)
    best = read_history(contest.folder(name, seed)).generations[end].best_point
    path.parent.mkdir(parents=True, exist_ok=True)
    save_design(problem.design(problem.space.low if best is None else problem.space.from_dict(best)), path)
    speeds = replayed(problem, path, settings.starts)[0]
    write_records(kept, [{"budget": contest.budget, "speed": speed} for speed in speeds.tolist()])


def _found(folder: Path, settings: Enumeration, body: str, seed: int) -> Record:
    """What a run has found."""
    contest, name = settings.contest(body, seed, folder), _file(body)
    last = contest.curve(name, seed)[contest.last_within(name, seed, contest.budget) or 0]
    speeds = column(read_records(_gait(folder, body, seed).with_suffix(".csv")), "speed")
    return {
        "body": body,
        "seed": seed,
        "found": told_layout(load_design(_gait(folder, body, seed)).bladders or ()),
        "evaluations": last["evaluations"],
        "score": last["best"],
        "speed": float(np.median(speeds)),
        "slowest": float(speeds.min()),
        "fastest": float(speeds.max()),
    }


def _report(folder: Path, about: Mapping[str, Any], rows: Sequence[Record]) -> None:
    """Write ``summary.json`` and ``table.md``, which follow from the runs and what is ``about`` all of them."""
    every = {body: column(select(rows, body=body), "speed") for body in distinct(rows, "body")}
    bodies = {body: speeds for body, speeds in every.items() if body != EVOLVED}
    by_number = {count: _of_number(bodies, count) for count in range(BLADDERS + 1)}
    found: dict[str, Any] = {
        **about,
        "by_number": {count: told for count, told in by_number.items() if told},
        "bodies": {body: _of_runs(bodies[body]) for body in sorted(bodies, key=lambda b: -bodies[b].mean())},
    }
    if EVOLVED in every:
        layouts = [row["found"] for row in select(rows, body=EVOLVED)]
        found[EVOLVED] = {**_of_runs(every[EVOLVED]), "each": every[EVOLVED].tolist(), "layouts": layouts}
    write_json(folder / "summary.json", found)
    write_text(folder / "table.md", page(*_tables(found, bodies, every.get(EVOLVED))))


def _of_runs(speeds: Floats) -> dict[str, Any]:
    return {**known_mean(speeds), "best": float(speeds.max())}


def _of_number(bodies: Mapping[str, Floats], count: int) -> dict[str, Any]:
    """Mean of the means and the fastest of all bodies with ``count`` bladders; empty if there is none."""
    means = {body: float(speeds.mean()) for body, speeds in bodies.items() if len(BODIES[body]) == count}
    if not means:
        return {}
    fastest = max(means, key=lambda body: means[body])
    return {"bodies": len(means), **_of_runs(np.array(list(means.values()))), "fastest": fastest}


def _tables(found: Mapping[str, Any], bodies: Mapping[str, Floats], evolved: Floats | None) -> list[str | list[str]]:
    """Speeds by the number of bladders, those of the fastest bodies, and what evolution found."""
    numbers = [
        (count, told["bodies"], _with_interval(told), f"{told['best']:z.3f}", told["fastest"])
        for count, told in found["by_number"].items()
    ]
    header = ("bladders", "bodies", "mean of the bodies' means (95 % interval)", "fastest body's mean", "its bladders")
    fastest = list(found["bodies"])[:SHOWN]
    listed = [
        (body, len(BODIES[body]), mean_with_interval(bodies[body], "z.3f"), f"{bodies[body].max():z.3f}")
        for body in fastest
    ]
    runs = len(next(iter(bodies.values())))
    parts: list[str | list[str]] = [
        f"Speed [BL/s] by the number of bladders; searches of a body: {runs}, of {found['evaluations']} evaluations:",
        markdown(header, "rrrrl", numbers),
        f"The {len(fastest)} fastest bodies:",
        markdown(("bladders at", "number", "mean (95 % interval)", "best run"), "lrrr", listed),
    ]
    if evolved is not None:
        layouts = "; ".join(found[EVOLVED]["layouts"])
        told = mean_with_interval(evolved, "z.3f")
        parts.append(
            f"Evolution of body and gait, {found['evolution']} evaluations a run: {told}, best {evolved.max():z.3f}; "
            f"bladders at {layouts}."
        )
    return parts


def _with_interval(told: Mapping[str, Any]) -> str:
    if told["low"] is None:
        return f"{told['mean']:z.3f}"
    return f"{told['mean']:z.3f} ({told['low']:z.3f} to {told['high']:z.3f})"


STUDY = Study(
    title="how many bladders the inflatable robot needs, and where: every layout, each by a short search",
    source="beyond chapter 5",
    scales={
        "small": Enumeration(seeds=1, evaluations=8, evolved=1, columns=2, bodies=("none", "1", "1,2", "1,3,5,7")),
        "medium": Enumeration(seeds=2),
        "full": Enumeration(evaluations=256, starts=5),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES[:3],
    cost="eight hours of one core; medium takes a quarter of an hour",
)
