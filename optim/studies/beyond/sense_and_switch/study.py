"""Whether a machine that notices a change of ground by its senses keeps up with one that is told the ground.

A gait is searched for each kind of ground. Scores of grounds are fitted to what the senses read on training courses;
how long a gait is kept, and by how much another ground's score must be ahead, are those that go farthest there. Then
machines go along courses that none has met: told, sensing, with and without hysteresis, by chance, and with one gait.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.data import Data, Kind
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, cached
from optim.experiments.study import Count, Settings, Several, Study, Whole
from optim.experiments.tables import Record, column, distinct, select, write_records, write_table
from optim.studies.beyond.sense_and_switch.machine import Grounds, Search, machine
from optim.studies.beyond.sense_and_switch.noticing import Noticed, noticed
from optim.studies.beyond.sense_and_switch.picture import Example, draw
from optim.studies.beyond.sense_and_switch.pilots import (
    Crew,
    by_chance,
    distances,
    exploring,
    fixed,
    knowing_ground,
    play_course,
    samples,
    sensing,
    staying,
)
from optim.studies.beyond.sense_and_switch.report import CHANCE, LOOK, RULES, TOLD, TOLD_STAYING, report
from robots.control.switching import Switching, fitted
from robots.course import KINDS
from robots.lattice_robot.repertoire import Played
from robots.robot import part_of
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.checks import positive
from taichi_sim.base.results_folder import ResultsFolder

NAME, TABLE, EVENTS, GAITS = "sense-and-switch", "runs.csv", "changes.csv", "gaits.csv"
FIRST_TRAINED, FIRST_HELD_OUT = 1000, 5000  # seeds of courses
WINDOW = 16  # looks that features are of: one cycle
MARGINS, STAYS = (0.0, 0.1, 0.2, 0.4), (16, 32)
EXPLORERS = 6  # machines on every training course of which readings are taken
# Columns of the tables of machines on courses, of changes, and of gaits.
ALONE = "always {}"  # machines with one gait
MACHINES = (TOLD, TOLD_STAYING, *RULES, CHANCE, *(ALONE.format(kind) for kind in KINDS))  # in the order of rows
WENT: dict[str, Kind] = {
    "machine": MACHINES,
    **dict.fromkeys(("seed", "course", "switches", "false"), int),
    **dict.fromkeys(("distance", "right"), float),
}
CHANGE: dict[str, Kind] = {
    **dict.fromkeys(("seed", "course"), int),
    "machine": str,
    "from": KINDS,
    "to": KINDS,
    "looks": int | None,
}
SEARCHED: dict[str, Kind] = {
    "seed": int,
    "gait": KINDS,
    **dict.fromkeys((f"on_{kind}" for kind in KINDS), float),
    "best_alone": bool,
}


@dataclass(frozen=True)
class SenseAndSwitch(Settings):
    """Searches of gaits, and courses.

    Attributes:
        seeds: repertoires of gaits, each searched anew.
        generations: of the search of a gait for level ground.
        further: of those for other grounds, which begin there.
        population: evaluations of each generation.
        search_cycles: of each evaluation.
        trained: courses on which the switching is fitted.
        held_out: courses that judge.
        cycles: of the machine on a course.
        length: mean length of a stretch [m].
        degrees: of slopes.
        ridge: height of ridges [m].
        factor: of friction where it is slippery.
    """

    seeds: Count = 5
    generations: Whole = 30
    further: Whole = 16
    population: Several = 16
    search_cycles: Count = 8
    trained: Count = 6
    held_out: Several = 32
    cycles: Count = 40
    length: Annotated[float, positive] = 0.12
    degrees: Annotated[float, positive] = 8.0
    ridge: Annotated[float, positive] = 0.004
    factor: Annotated[float, positive] = 0.05

    @property
    def grounds(self) -> Grounds:
        """Properties of the stretches of courses."""
        return Grounds(self.length, self.degrees, self.ridge, self.factor)

    @property
    def training(self) -> list[int]:
        """Seeds of training courses: the first ones in which the kinds that are not level take turns to come first."""
        found, seed = list[int](), FIRST_TRAINED
        while len(found) < self.trained and seed < FIRST_HELD_OUT:
            if self.grounds.course(seed).kinds[1] == 1 + len(found) % (len(KINDS) - 1):
                found.append(seed)
            seed += 1
        return found

    @property
    def search(self) -> Search:
        """How a gait is searched."""
        return Search(self.generations, self.further, self.population, self.search_cycles)


@dataclass(frozen=True, eq=False)
class Repertory:
    """The gaits of a seed, and where they are best.

    Attributes:
        points: of the gaits, one for each kind of ground, shape (G, P).
        speeds: of each gait on each kind of ground [lengths/s], shape (G, T).
    """

    points: Floats
    speeds: Floats

    @property
    def answers(self) -> tuple[int, ...]:
        """The fastest gait for each kind of ground."""
        return tuple(int(gait) for gait in self.speeds.argmax(axis=0))


class Part:
    """All of one seed: gaits, what they read on training courses, how to switch, and held-out courses."""

    def __init__(self, folder: Path, settings: SenseAndSwitch, seed: int) -> None:
        """Continue the seed's folder."""
        described = {"seed": seed, **settings.lasting("seeds", "held_out")}
        self.kept = ResultsFolder(_parts(folder, seed), "seed", described)
        self.settings, self.seed, self.grounds = settings, seed, settings.grounds

    def repertory(self, progress: Progress) -> Repertory:
        """A gait for each kind of ground, and how fast each is on all kinds."""
        points = list[Floats]()
        for number, (kind, world) in enumerate(self.grounds.pure.items()):
            tick, first = part_of(progress, number, len(KINDS)), points[0] if points else None
            check = partial(check_arrays, {"point": Allowed((len(machine(1).start),))})
            found = cached(self.kept, kind, partial(self.settings.search.gait, world, self.seed, first, tick), check)
            points.append(found["point"])
        gaits = np.stack(points)
        speeds = Allowed((len(gaits), len(KINDS)), failed=-np.inf)
        compared = cached(
            self.kept,
            "compared",
            lambda: {"speeds": self.settings.search.speeds(gaits, self.grounds)},
            partial(check_arrays, {"speeds": speeds}),
        )
        return Repertory(gaits, compared["speeds"])

    def _course(self, name: str, found: Repertory, course: int, crew: Crew) -> Played:
        """What a crew did on a course, computed once."""

        def compute() -> Arrays:
            played = play_course(found.points, self.grounds, course, self.settings.cycles, crew)
            kept = {"felt": played.felt} if name == "felt" else {}
            return {"gaits": played.gaits, "places": played.places, "failed": played.failed, **kept}

        allowed = {
            "gaits": Allowed((crew.count, "L"), 0, len(found.points) - 1, kind="i"),
            "places": Allowed((crew.count, "L"), failed=np.nan),
            "failed": Allowed((crew.count,), kind="b"),
            **({"felt": Allowed((crew.count, "L", "S"), failed=np.nan)} if name == "felt" else {}),
        }
        arrays = cached(self.kept, f"{name}{course}", compute, partial(check_arrays, allowed))
        return Played(arrays["gaits"], arrays.get("felt", np.zeros(0)), arrays["places"], arrays["failed"])

    def fitted(self, found: Repertory, progress: Progress) -> Switching:
        """Scores of grounds, fitted to what machines felt on training courses; without hysteresis."""
        parts, gaits = [], len(found.points)
        for number, seed in enumerate(self.settings.training):
            course = self.grounds.course(seed)
            pilot = exploring(course, found.answers, gaits, EXPLORERS, (self.seed, seed))
            played = self._course("felt", found, seed, Crew([(EXPLORERS, pilot)]))
            parts.append(samples(played, course, WINDOW))
            if progress:
                progress((number + 1) / self.settings.trained)
        felt, playing, kinds = (np.concatenate(each) for each in zip(*parts, strict=True))
        return Switching(fitted(felt, playing, kinds, (gaits, len(KINDS))), found.answers, WINDOW)

    def tuned(self, found: Repertory, plain: Switching, progress: Progress) -> tuple[Switching, int]:
        """The margin and stay with which a machine goes farthest on training courses, and the one gait that does."""
        choices = [replace(plain, margin=margin, stay=stay) for margin, stay in product(MARGINS, STAYS)]
        totals = np.zeros(len(choices) + len(found.points))
        for number, seed in enumerate(self.settings.training):
            crew = Crew([*((1, sensing(each)) for each in choices), *_alone(found)])
            totals += distances(self._course("tuned", found, seed, crew))
            if progress:
                progress((number + 1) / self.settings.trained)
        return choices[int(totals[: len(choices)].argmax())], int(totals[len(choices) :].argmax())

    def judged(
        self, found: Repertory, rules: Mapping[str, Switching], number: int
    ) -> tuple[list[Record], list[Noticed]]:
        """What machines do on a held-out course: a row for each, and how those that sense notice changes."""
        seed = FIRST_HELD_OUT + number
        course, gaits = self.grounds.course(seed), len(found.points)
        crew = Crew(
            [
                (1, knowing_ground(course, found.answers)),
                (1, staying(knowing_ground(course, found.answers), rules["sensing"].stay)),
                *((1, sensing(rule)) for rule in rules.values()),
                (1, by_chance(gaits, 1, (self.seed, seed))),
                *_alone(found),
            ]
        )
        played = self._course("judged", found, seed, crew)
        went, rows, events = distances(played), list[Record](), list[Noticed]()
        for row, name in enumerate(MACHINES):
            changes, count, right = noticed(course, found.answers, played.gaits[row], played.places[row])
            where = {"seed": self.seed, "course": seed, "machine": name}
            rows.append({**where, "distance": float(went[row]), "right": right, **count})
            events += [{**where, **each} for each in changes] if name in rules else []
        return rows, events


def _alone(found: Repertory) -> list[tuple[int, Any]]:
    """Machines with one gait each."""
    return [(1, fixed(gait)) for gait in range(len(found.points))]


def seed_part(
    folder: Path, settings: SenseAndSwitch, seed: int, _: Any, progress: Progress
) -> tuple[list[Record], list[Noticed], list[Record]]:
    """All of a seed, unless it is done: rows of machines on courses, changes of ground, and gaits on kinds of it."""
    part = Part(folder, settings, seed)
    found = part.repertory(part_of(progress, 0, 10, 5))
    plain = part.fitted(found, part_of(progress, 5, 10))
    tuned, best = part.tuned(found, plain, part_of(progress, 6, 10))
    rules = dict(zip(RULES, (tuned, plain), strict=True))
    rows, events = list[Record](), list[Noticed]()
    for number in range(settings.held_out):
        more, changes = part.judged(found, rules, number)
        rows, events = rows + more, events + changes
        if progress:
            progress(0.7 + 0.3 * (number + 1) / settings.held_out)
    gaits: list[Record] = [
        {
            "seed": seed,
            "gait": gait,
            **{f"on_{kind}": float(speed) for kind, speed in zip(KINDS, found.speeds[row], strict=True)},
            "answers": " ".join(kind for kind, answer in zip(KINDS, found.answers, strict=True) if answer == row),
            "best_alone": row == best,
            "margin": tuned.margin,
            "stay": tuned.stay,
        }
        for row, gait in enumerate(KINDS)
    ]
    return rows, events, gaits


def study(folder: Path, settings: SenseAndSwitch, progress: Progress = None, jobs: int = 1) -> None:
    """Write what machines did on every course, and a table; what is whole in the folder is not done again."""
    ResultsFolder(folder, NAME, settings.lasting("seeds", "held_out"))
    parts = [(f"seed {seed}", partial(seed_part, folder, settings, seed)) for seed in range(settings.seeds)]
    run_parallel(parts, jobs, {}, progress and part_of(progress, 0, 10, 9))
    tables: tuple[list[Any], list[Any], list[Any]] = ([], [], [])
    for seed, (_, part) in enumerate(parts):
        for table, more in zip(tables, part({}, part_of(progress, seed, len(parts))), strict=True):
            table += more
        write_records(folder / TABLE, tables[0])
        write_table(folder / EVENTS, tuple(CHANGE), [[change[name] for name in CHANGE] for change in tables[1]])
        write_records(folder / GAITS, tables[2])
    _report(folder, settings, *tables, folder)


def rewrite(data: Data, folder: Path) -> None:
    """Write table, summary and figure from the tables; without panels of a course where no run is kept beside them."""
    settings = data.settings(SenseAndSwitch)
    rows, gaits = data.records(TABLE, WENT), data.records(GAITS, SEARCHED)
    rows.sort(key=lambda row: (row["seed"], row["course"], MACHINES.index(row["machine"])))  # as the study writes them
    _check_whole(data, settings, rows, gaits)
    _report(folder, settings, rows, data.records(EVENTS, CHANGE, may_be_empty=True), gaits, data.folder)


def _check_whole(data: Data, settings: SenseAndSwitch, rows: Sequence[Record], gaits: Sequence[Record]) -> None:
    """Refuse tables in which a machine, a repertoire or a course of the settings is missing."""
    courses = [FIRST_HELD_OUT + number for number in range(settings.held_out)]
    for seed, name in product(range(settings.seeds), MACHINES):
        if [row["course"] for row in select(rows, seed=seed, machine=name)] != courses:
            lacks = f"lacks rows of machine {name} of seed {seed}, or has others; give courses"
            raise ValueError(f"{data.folder / TABLE}: it {lacks} {courses[0]} to {courses[-1]} once, in this order")
    for seed in range(settings.seeds):
        own = select(gaits, seed=seed)
        if tuple(row["gait"] for row in own) != KINDS or sum(row["best_alone"] for row in own) != 1:
            kinds = ", ".join(KINDS)
            raise ValueError(f"{data.folder / GAITS}: seed {seed} must have gaits {kinds}, of which one is best_alone")
    if len(rows) != settings.seeds * len(courses) * len(MACHINES) or len(gaits) != settings.seeds * len(KINDS):
        raise ValueError(f"{data.folder}: its tables have other rows than {settings.seeds} seeds of its settings")


def _report(
    folder: Path,
    settings: SenseAndSwitch,
    rows: Sequence[Record],
    events: Sequence[Record],
    gaits: Sequence[Record],
    parts: Path,
) -> None:
    """Write what follows from the tables, and from the run whose parts are in a folder, if they are."""
    machines = report(folder, settings, rows, events, gaits)
    draw(folder / "course.png", _example(parts, settings, rows), machines, events, LOOK)


def _example(folder: Path, settings: SenseAndSwitch, rows: Sequence[Record]) -> Example | None:
    """The held-out course of the first repertoire on which the sensing machine keeps its median share.

    None where what machines did there is not kept.
    """
    own = select(rows, seed=0)
    whole, part = (column(select(own, machine=name), "distance") for name in (TOLD, "sensing"))
    shares = part / np.where(whole > 0, whole, np.inf)
    number = int(np.argsort(shares, kind="stable")[len(shares) // 2])
    names = distinct(own, "machine")
    arrays = Data(_parts(folder, 0)).part(f"judged{FIRST_HELD_OUT + number}", gaits="i2", places="f2")
    if arrays is None or len(arrays["gaits"]) != len(names):
        return None
    best = int(np.argmax([column(select(own, machine=ALONE.format(kind)), "distance").mean() for kind in KINDS]))
    shown = [TOLD, *RULES, CHANCE, ALONE.format(KINDS[best])]
    chosen = [names.index(name) for name in shown]
    gaits, places = arrays["gaits"][chosen], arrays["places"][chosen]
    return Example(settings.grounds.course(FIRST_HELD_OUT + number), shown, gaits, places)


def _parts(folder: Path, seed: int) -> Path:
    """Where what a seed has computed is kept."""
    return folder / "parts" / f"{seed}"


STUDY = Study(
    title="a machine that notices by its senses that the ground has changed, and changes its gait",
    source="chapters 5 and 6, on machines that change their shape and gait with the environment",
    scales={
        "small": SenseAndSwitch(
            seeds=1, generations=0, further=0, population=4, search_cycles=1, trained=1, held_out=2, cycles=4
        ),
        "medium": SenseAndSwitch(),
        "full": SenseAndSwitch(seeds=10, generations=150, further=100, trained=16, held_out=64, cycles=60),
    },
    run=study,
    rewrite=rewrite,
    writes=("table.md", TABLE, EVENTS, GAITS, "summary.json", "course.png"),
    cost="about three hours of a core; medium takes 20 minutes",
)
