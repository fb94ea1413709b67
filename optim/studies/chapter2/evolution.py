"""Runs of climbers side by side, kept in a folder, where they go on after any interruption."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import Progress
from optim.experiments.side_by_side import evaluate_together, run_side_by_side
from optim.problem import Evaluation, Request
from optim.studies.chapter2.settings import FITNESS, SPACE, Interference, Treatment, controllers
from taichi_sim import runtime
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

KIND = "interference"
SECONDS_BETWEEN_FILES = 60.0  # a kill loses so much

Run = tuple[Treatment, int]
Runs = Mapping[Treatment, Sequence[Arrays]]  # what the climbers of each run kept, see :meth:`Climbers.state`
KEPT = ("born", "climber", "light", "distance")


class Climbers:
    """The climbers of one run, and every evaluation that they kept.

    Attributes:
        treatment: what is trained, and how.
        run: its number.
        goal: generations to make, the first population among them.
        method: the climbers.
        changed: whether they were told anything that is not written yet.
    """

    def __init__(self, settings: Interference, treatment: Treatment, run: int, goal: int) -> None:
        """Set up the climbers; see :attr:`Interference.method`."""
        self.treatment, self.run, self.goal = treatment, run, goal
        self.method: Any = settings.method(treatment.trainer, run)
        self.changed = False
        self._kept: list[Arrays] = []
        self._derivatives = 0

    @property
    def turns(self) -> int:
        """Generations completed; gradients belong to the generation before."""
        return int(self.method.generation)

    @property
    def done(self) -> bool:
        """Whether all generations have been made."""
        return self.turns >= self.goal

    @property
    def whole(self) -> bool:
        """Whether it stands between two generations; only then it can be written."""
        return self.method.wants == "points"

    def ask(self) -> Request:
        """The climbers' next controllers, or those whose gradients are wanted."""
        return Request(self.method.ask(), self.method.wants)

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Tell the method, and note what its climbers keep."""
        before, born = self.method.points, self.turns
        self.method.tell(request.points, evaluation)
        self.changed = True
        if request.wants == "gradients":
            self._derivatives += len(request.points)
            return
        which = np.flatnonzero((self.method.points != before).any(axis=1))
        self._kept.append(
            {
                "born": np.full(len(which), born, np.int32),
                "climber": which.astype(np.int32),
                "light": evaluation.details["light"][which],
                "distance": evaluation.details["distance"][which].astype(np.float32),
            }
        )

    def state(self) -> Arrays:
        """All that ``restore`` needs to go on exactly, as files of version 1.0 have it.

        ``generation``; ``weights`` (P, 5, 8) and ``scores`` (P,) of the climbers now; what was kept: ``born``
        (generation) and ``climber``, (N,), ``light`` [1/m^2] and ``distance`` [m], (N, E); and the rest of the method.
        """
        self._kept = [{name: np.concatenate([part[name] for part in self._kept]) for name in KEPT}]
        state = self.method.state()
        own = {
            "generation": state.pop("generation"),
            "weights": controllers(state.pop("points")),
            "scores": np.nan_to_num(state.pop("scores"), nan=-np.inf),
            **self._kept[0],
        }
        state.pop("moved", None)  # none have between generations
        if "uphill" in state:  # files have steps in weights, the method in ranges
            state |= {"uphill": controllers(state["uphill"]), "step": state["step"] * SPACE.span[0]}
            state["derivatives"] = np.array(self._derivatives)
        return own | state

    def restore(self, state: Arrays) -> None:
        """Take over what :meth:`state` returned."""
        state = dict(state)
        self._kept = [{name: state.pop(name) for name in KEPT}]
        scores = np.where(np.isinf(state["scores"]), np.nan, state["scores"])
        state |= {"points": state.pop("weights").reshape(-1, SPACE.size), "scores": scores}
        if "uphill" in state:
            self._derivatives = int(state.pop("derivatives"))
            state |= {"uphill": state["uphill"].reshape(-1, SPACE.size), "step": state["step"] / SPACE.span[0]}
            state["moved"] = np.zeros(len(scores), bool)
        self.method.restore(state)


def by_treatment(found: Mapping[Run, Arrays]) -> Runs:
    """Collect the runs of each treatment, in their order."""
    parts: dict[Treatment, list[Arrays]] = {}
    for (treatment, _), state in found.items():
        parts.setdefault(treatment, []).append(state)
    return parts


def evolve(
    settings: Interference,
    chosen: Sequence[Treatment],
    runs: int,
    generations: int,
    out: Path | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> dict[Run, Arrays]:
    """Train every treatment in every run; the number of a run, from 0, is its seed, too.

    All that lag behind move on together: their controllers go through one simulation for each kind of robot and
    generation, gradients treatment by treatment. What a run does depends neither on those beside it nor on where it
    went on. The folder takes a file for each run and goes on from it; also with more treatments, runs, generations,
    which come after the first population.

    Returns:
        By treatment and run, the state of its climbers, see :meth:`Climbers.state`.

    Raises:
        ValueError: for numbers that are not allowed, a device that is not there, or a folder of other
            settings, or of runs that went further.
    """
    checks.integer("runs", runs, 1)
    checks.integer("generations", generations, 0)
    runtime.start(settings.device, settings.precision, threads)  # refuses what is not there before a folder is made
    folder = None if out is None else ResultsFolder(out, KIND, asdict(settings))
    goal = generations + 1
    members = [Climbers(settings, each, run, goal) for each in chosen for run in range(runs)]
    for climbers in members:
        for state in folder.load(climbers.treatment.file(climbers.run), settings.check) if folder else ():
            climbers.restore(state)
    if (reached := max(each.turns for each in members)) > goal:
        raise ValueError(f"generations: {generations} is not allowed; {out} holds {reached - 1}")
    written = time.monotonic()

    def evaluate(searches: Sequence[Climbers], requests: Sequence[Request]) -> Iterable[Evaluation]:
        return _evaluate(settings, searches, requests, threads)

    def after_round() -> None:
        nonlocal written
        if progress:
            progress(sum(each.turns for each in members) / (goal * len(members)))
        if all(each.whole for each in members) and time.monotonic() - written > SECONDS_BETWEEN_FILES:
            _write(folder, members)
            written = time.monotonic()

    run_side_by_side(members, evaluate, after_round)
    _write(folder, members)
    return {(each.treatment, each.run): each.state() for each in members}


def _evaluate(
    settings: Interference, searches: Sequence[Climbers], requests: Sequence[Request], threads: int | None
) -> Iterable[Evaluation]:
    """Evaluate what climbers ask for: a simulation for each robot, and gradients treatment by treatment."""

    def together(owners: Sequence[Climbers], request: Request) -> Evaluation:
        treatment = owners[0].treatment
        if request.wants == "gradients":
            return settings.fitness_and_slopes(treatment, request.points, threads)
        seen = settings.simulate(treatment.robot, controllers(request.points), threads)
        every = np.stack([combine(seen.light, axis=-1) for combine in FITNESS.values()])
        own = [list(FITNESS).index(climbers.treatment.fitness) for climbers in owners]
        details = {"light": seen.light, "distance": seen.distance}
        return Evaluation(every[own, np.arange(len(owners))], details=details)

    def kind(climbers: Climbers) -> tuple[str, str]:
        return climbers.treatment.robot, "" if climbers.whole else climbers.treatment.fitness

    return evaluate_together(searches, requests, together, kind)


def _write(folder: ResultsFolder | None, members: Sequence[Climbers]) -> None:
    """Write the files of all runs that changed since, and forget that they did."""
    for climbers in members:
        if folder and climbers.changed:
            name = climbers.treatment.file(climbers.run)
            folder.add(name, name.encode(), **climbers.state())
        climbers.changed = False
