"""What the searches are held against: gaits made by hand, and what they found, simulated again and elsewhere."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.results import Costs, Progress, computed_arrays
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, HILL, PAIRED, Experiment, ShapeChange
from optim.studies.chapter5.found import Found
from optim.studies.chapter5.gaits import Case, GaitRuns, repeated
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import INCHING, ROLLING
from taichi_sim.base.arrays import Floats
from taichi_sim.base.results_folder import ResultsFolder, load_parts

KIND = "comparison"
BY_HAND = {"rolling by hand": ROLLING, "inching by hand": INCHING}
PLACES = (FLAT, HILL)


@dataclass(frozen=True)
class Played:
    """Gaits that were simulated beside the searches; what is not there yet is left out."""

    by_hand: Mapping[str, Mapping[str, Floats]]  # speeds of copies of each gait made by hand, by place, shape (copies,)
    again: Mapping[str, Floats] = field(default_factory=dict)  # of copies of each experiment's best, shape (copies,)
    # speeds of each experiment's best designs on their own and on the other terrain, shape (2, at most ``others``)
    elsewhere: Mapping[str, Floats] = field(default_factory=dict)
    generation: int | None = None  # after which those designs were the best; None before any were played


class Player:
    """Plays gaits beside the searches of a study, and keeps their speeds."""

    def __init__(self, settings: ShapeChange, folder: Path, costs: Costs, threads: int | None = None) -> None:
        """Open the folder of these gaits, new or of the same settings; more generations may follow."""
        lasting = {name: value for name, value in asdict(settings).items() if name != "generations"}
        self.settings, self.costs, self.threads = settings, costs, threads
        self.folder = ResultsFolder(folder / KIND, KIND, lasting)

    def play_by_hand(self, progress: Progress) -> None:
        """Play rolling and inching as they were made by hand, on both terrains, in f64."""
        gaits = [repeated(design, self.settings.repeats) for design in BY_HAND.values()]
        cases = [Case(gait, self.settings.terrain(place)) for gait in gaits for place in PLACES]
        allowed = {"by_hand": Allowed((len(cases), self.settings.copies), failed=np.nan)}
        parts = {"by_hand": partial(self._in_copies, "by hand", cases)}
        computed_arrays(self.folder, "speeds", parts, progress, allowed)

    def play_found(self, found: Mapping[str, Found], progress: Progress) -> None:
        """Simulate each experiment's best design again, and the best few on the other terrain."""
        parts: dict[str, Callable[[Progress], Floats]] = {}
        allowed: dict[str, Allowed] = {}
        for experiment, one in _with_designs(found):
            generation = len(one.scores) - 1
            parts[again := _part("again", experiment, generation)] = partial(self._again, experiment, one)
            allowed[again] = Allowed((self.settings.copies,), failed=np.nan)
            if experiment.row in PAIRED:
                parts[elsewhere := _part("elsewhere", experiment, generation)] = partial(
                    self._elsewhere, experiment, one
                )
                allowed[elsewhere] = Allowed((2, len(one.best(self.settings.others))), failed=np.nan)
        computed_arrays(self.folder, "speeds", parts, progress, allowed)

    def _again(self, experiment: Experiment, found: Found, progress: Progress) -> Floats:
        """Speeds of copies of the best design where it was found; a search also keeps what chance favoured."""
        case = Case(found.designs[found.best(1)[0]], self.settings.terrain(experiment.place))
        return np.asarray(self._in_copies("best designs again", [case], progress)[0])

    def _elsewhere(self, experiment: Experiment, found: Found, progress: Progress) -> Floats:
        """Speeds of the best designs where they were found, and on the other terrain."""
        best = found.best(self.settings.others)
        terrain = self.settings.terrain(HILL if experiment.place == FLAT else FLAT)
        cases = [Case(found.designs[climber], terrain) for climber in best]
        speeds = self._speeds("best designs elsewhere", cases, progress, precision="f32", copies=1, noise=0.0)
        return np.array([found.scores[-1, best], speeds[:, 0]])

    def _in_copies(self, part: str, cases: Sequence[Case], progress: Progress) -> Floats:
        return self._speeds(part, cases, progress, copies=self.settings.copies)

    def _speeds(self, part: str, cases: Sequence[Case], progress: Progress, **how: Any) -> Floats:
        """Play cases now, at a cost of some part of the study."""
        with self.costs.of(part):
            robot = GaitRuns(NAMED_GEOMETRIES[self.settings.geometry], **how)
            return robot.speeds(cases, self.threads, progress)


def read_played(folder: Path, copies: int, found: Mapping[str, Found]) -> Played:
    """Read what was played, of the newest generation of which all best designs were, with what there is elsewhere.

    Raises ValueError if the gaits made by hand are missing.
    """

    def known(name: str, *shape: int | str) -> list[Floats]:
        check = partial(check_arrays, {"speeds": Allowed(shape, failed=np.nan)})
        return [arrays["speeds"] for arrays in load_parts(folder, name, check)]

    if not (by_hand := known("by_hand", len(BY_HAND) * len(PLACES), copies)):
        raise ValueError(f"{folder}: its part by_hand is missing")
    named = {name: dict(zip(PLACES, by_hand[0][2 * n :], strict=False)) for n, name in enumerate(BY_HAND)}
    best = [experiment for experiment, _ in _with_designs(found)]
    for generation in range(min((len(one.scores) - 1 for one in found.values()), default=-1), -1, -1):
        again, elsewhere = (
            {e.name: speeds for e in best for speeds in known(_part(what, e, generation), *shape)}
            for what, shape in (("again", (copies,)), ("elsewhere", (2, "N")))
        )
        if again and len(again) == len(best):
            return Played(named, again, elsewhere, generation)
    return Played(named)


def _with_designs(found: Mapping[str, Found]) -> list[tuple[Experiment, Found]]:
    """The experiments that have found any design."""
    known = [(experiment, found[experiment.name]) for experiment in EXPERIMENTS if experiment.name in found]
    return [(experiment, one) for experiment, one in known if one.best(1)]


def _part(what: str, experiment: Experiment, generation: int) -> str:
    """The name of an experiment's part; what it found changes with the generations."""
    return f"{what}_{experiment.name.replace('-', '_')}_{generation}"
