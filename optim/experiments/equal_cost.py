"""Searches beside each other at equal cost: resumable runs of a few seeds, their table and their curves.

Runs are ordinary run folders; what each generation cost in CPU time is kept beside them, in ``cpu.jsonl``. A larger
budget continues them.
"""

import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from optim.experiments.side_by_side import run_side_by_side
from optim.problem import Evaluation, Problem, Request, evaluate_request
from optim.runs import Generation, open_run
from optim.runs.config import has_run
from optim.runs.environment import environment
from optim.runs.folder import RunFolder
from optim.runs.history import read_history
from optim.runs.loop import FolderSearch
from optim.search import METHODS, Method, build_method
from optim.search.method import check_fit
from taichi_sim.base import line_files
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.records import Count, Duration, checked

SEEDS = range(5)
CLOCK = "cpu.jsonl"
UNITS = {"cpu": "CPU time [s]", "evaluations": "evaluations"}
Point = dict[str, Any]


@dataclass(frozen=True)
class _Spent:
    """A line of ``cpu.jsonl``."""

    cpu: Duration
    best: float | None
    mean: float | None
    evaluations: Count


@dataclass(frozen=True)
class Entry:
    """One of the searches compared.

    Attributes:
        problem: builds what is designed, for one thread.
        method: name in ``optim.search.METHODS``.
        settings: of the method, but the seed.
    """

    problem: Callable[[], Problem]
    method: str
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class Arm:
    """A search of a comparison of those that follow gradients with those that do not.

    Attributes:
        label: what it is called.
        method: name in ``optim.search.METHODS``.
        settings: of the method, but the seed.
        horizon: of its gradients [s], see ``RobotProblem.gradient_horizon``; None for exact ones.
    """

    label: str
    method: str
    settings: Mapping[str, Any]
    horizon: float | None = None

    @property
    def gradients(self) -> bool:
        """Whether the method asks for gradients."""
        return METHODS[self.method].takes_gradients


def of_kind(arms: Mapping[str, Arm], names: Iterable[str], gradients: bool) -> list[str]:
    """Names of the arms that follow gradients, or of those that do not."""
    return [name for name in names if arms[name].gradients == gradients]


@dataclass(frozen=True)
class Contest:
    """Searches compared at equal cost, from the same seeds.

    Attributes:
        entries: the searches, by name.
        cost: what is equal, ``"cpu"`` time [s] or ``"evaluations"``.
        budget: of each run, in that unit.
        out: folder of the runs.
        tell: is told a line when a run is complete.
    """

    entries: Mapping[str, Entry]
    cost: Literal["cpu", "evaluations"]
    budget: float
    out: Path
    tell: Callable[[str], object] = print

    def run(self, seeds: Sequence[int]) -> None:
        """Run what is missing, until the budget is used up."""
        for seed in seeds:
            for name in self.entries:
                self.run_one(name, seed)

    def run_one(self, name: str, seed: int) -> None:
        """Run a search with a seed, or go on with it, until the budget is used up."""
        entry, folder = self.entries[name], self.folder(name, seed)
        designed, settings = entry.problem(), {**entry.settings, "seed": seed}
        described = designed.describe()
        config = {"problem": described, "method": {"name": entry.method, **settings}}
        about = environment(device="cpu", precision=described["precision"], threads=1, seed=seed)
        known = self._complete_curve(name, seed)
        if not known or known[-1][self.cost] < self.budget:
            begun = {**config, "generations": max(len(known) - 1, 0)}
            with open_run(folder, begun, resume=True, environment=about) as opened:
                method = build_method(entry.method, designed.space, settings)
                check_fit(method, designed)
                search = TimedSearch(designed, method, opened, known, self)
                run_side_by_side(
                    [search], lambda _, requests: [evaluate_request(designed, request) for request in requests]
                )
            ended = {**config, "generations": len(known) - 1}
            with open_run(folder, ended, resume=True, environment=about):
                pass  # the status of the run says that it is finished
        end = known[-1]
        best = f"best {_number(end['best']):.4f}"
        self.tell(f"{folder.name}: {end['evaluations']} evaluations, {end['cpu']:.0f} s, {best}")

    def _complete_curve(self, name: str, seed: int) -> list[Point]:
        """The curve, with a generation booked whose cost a kill cut off: by its wall time, as there is one thread."""
        folder, known = self.folder(name, seed), self.curve(name, seed)
        if has_run(folder):
            line_files.keep_lines(folder / CLOCK, len(known))
            history = read_history(folder)
            for last in history.generations[len(known) :]:
                _book(folder, known, last, float(np.nan_to_num(history.seconds[last.generation])))
        return known

    def folder(self, name: str, seed: int) -> Path:
        """Where a run is."""
        return self.out / f"{name.replace(' ', '-')}-{seed}"

    def curve(self, name: str, seed: int) -> list[Point]:
        """Generations of a run: CPU time [s] and evaluations so far, best and mean score of what it keeps.

        Raises:
            ValueError: if its file is damaged.
        """
        path = self.folder(name, seed) / CLOCK
        try:
            return [asdict(checked(_Spent, parse_json(line))) for line in line_files.complete_lines(path)]
        except ValueError as error:
            raise ValueError(f"{path}: cannot be read ({error})") from None

    def last_within(self, name: str, seed: int, cost: float) -> int | None:
        """The last generation of a run that ended within a cost; None if none did."""
        within = [number for number, each in enumerate(self.curve(name, seed)) if each[self.cost] <= cost]
        return within[-1] if within else None

    @property
    def complete(self) -> bool:
        """Whether every entry has run with every seed up to the budget."""
        curves = [self.curve(name, seed) for name in self.entries for seed in SEEDS]
        return all(c and c[-1][self.cost] >= self.budget for c in curves)

    def at(self, points: Sequence[Point], cost: float, what: str) -> float:
        """The last value known at a cost; NaN before the first."""
        known = [p[what] for p in points if p[self.cost] <= cost]
        return _number(known[-1]) if known else np.nan

    def table(self) -> str:
        """Medians over the seeds, and the best of each seed, as Markdown."""
        lines = [
            "| search | evaluations | CPU time [s] | mean of what it keeps, start | end | best, start | end | "
            "best of each seed | wins |",
            "| --- | ---: | ---: | ---: | ---: | ---: | ---: | --- | ---: |",
        ]
        curves = {name: [self.curve(name, seed) for seed in SEEDS] for name in self.entries}
        best = np.array([[self.at(c, self.budget, "best") for c in each] for each in curves.values()])
        for (name, each), row in zip(curves.items(), best, strict=True):
            first = {what: np.median([_number(c[0][what]) for c in each]) for what in ("best", "mean")}
            end = {
                what: np.median([self.at(c, self.budget, what) for c in each])
                for what in ("evaluations", "cpu", "mean")
            }
            wins = int((np.nanmax(best, axis=0) == row).sum())
            lines.append(
                f"| {name} | {end['evaluations']:.0f} | {end['cpu']:.0f} | {first['mean']:.3f} | {end['mean']:.3f} | "
                f"{first['best']:.3f} | {np.median(row):.3f} | {', '.join(f'{b:.3f}' for b in row)} | {wins} |"
            )
        return "\n".join(lines)

    def save_plot(self, path: Path, label: str) -> None:
        """Best score, and mean of what is kept, over cost: a thin line for each seed, a thick one for the median."""
        from matplotlib.figure import Figure

        from robots.view.picture import save_picture

        figure = Figure(figsize=(9, 3.6), layout="constrained")
        costs = np.linspace(0, self.budget, 200)
        for axes, what in zip(figure.subplots(1, 2), ("best", "mean"), strict=True):
            for number, name in enumerate(self.entries):
                curves = [self.curve(name, seed) for seed in SEEDS]
                rows = np.array([[self.at(c, cost, what) for cost in costs] for c in curves])
                axes.plot(costs, rows.T, color=f"C{number}", linewidth=0.6, alpha=0.5)
                axes.plot(costs, np.median(rows, axis=0), color=f"C{number}", linewidth=2.2, label=name)
            axes.set_title({"best": "best so far", "mean": "mean of what the search keeps"}[what], fontsize=10)
            axes.set_xlabel(UNITS[self.cost])
            axes.spines[["top", "right"]].set_visible(False)
        figure.axes[0].set_ylabel(label)
        figure.axes[1].legend(frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        save_picture(figure, path)


class TimedSearch(FolderSearch):
    """A search in a run folder whose generations are booked with their CPU time, until the budget is used up."""

    def __init__(
        self, problem: Problem, method: Method, folder: RunFolder, known: list[Point], contest: Contest
    ) -> None:
        super().__init__(problem, method, folder)
        self.folder, self.known, self.contest, self.begun = folder.path, known, contest, 0.0

    @property
    def done(self) -> bool:
        """Whether the budget is used up."""
        return bool(self.known) and self.known[-1][self.contest.cost] >= self.contest.budget

    def ask(self) -> Request:
        """What the method wants to know next; the clock starts."""
        self.begun = time.process_time()
        return super().ask()

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Complete a generation and book it."""
        super().tell(request, evaluation)
        assert self.last is not None
        _book(self.folder, self.known, self.last, time.process_time() - self.begun)


def _book(folder: Path, known: list[Point], last: Generation, cpu: float) -> None:
    """Add a generation and its CPU time [s] to the curve, here and on disk."""
    before = known[-1]["cpu"] if known else 0.0
    known.append({"cpu": before + cpu, "best": last.best, "mean": last.mean, "evaluations": last.evaluations})
    line_files.append_line(folder / CLOCK, json.dumps(known[-1]))


def _number(value: float | None) -> float:
    """The value; NaN for None, where nothing has succeeded yet."""
    return np.nan if value is None else value
