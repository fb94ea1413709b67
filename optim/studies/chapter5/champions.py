"""What the searches are held against: gaits made by hand, and what they found, simulated again and elsewhere."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from optim.experiments.results import Costs, Progress, cached, part_of
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, HILL, PAIRED, Experiment, Found, ShapeChange
from optim.studies.chapter5.gaits import Case, Robot, repeated
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import INCHING, ROLLING
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.results_folder import ResultsFolder

KIND = "comparison"
BY_HAND = {"rolling by hand": ROLLING, "inching by hand": INCHING}
PLACES = (FLAT, HILL)


@dataclass(frozen=True)
class Played:
    """Gaits that were simulated beside the searches; what is not there yet is left out.

    Attributes:
        by_hand: speeds of copies of each gait made by hand, by place, shape (copies,).
        again: speeds of copies of each experiment's best design, shape (copies,).
        elsewhere: of each experiment, the speeds of its best designs on their own and on the other terrain, shape
            (2, at most ``others``).
        generation: after which those designs were the best; None before any were played.
    """

    by_hand: Mapping[str, Mapping[str, Floats]]
    again: Mapping[str, Floats] = field(default_factory=dict)
    elsewhere: Mapping[str, Floats] = field(default_factory=dict)
    generation: int | None = None


@dataclass(frozen=True)
class Player:
    """Plays gaits beside the searches of a study, and caches their speeds.

    Attributes:
        settings: of the study.
        folder: takes the speeds.
        costs: takes what playing costs.
        threads: CPU threads; no result depends on them.
    """

    settings: ShapeChange
    folder: ResultsFolder
    costs: Costs
    threads: int | None = None

    @classmethod
    def open(cls, settings: ShapeChange, folder: Path, costs: Costs, threads: int | None) -> "Player":
        """Open the folder of these gaits, new or of the same settings; more generations may follow."""
        lasting = {name: value for name, value in asdict(settings).items() if name != "generations"}
        return cls(settings, ResultsFolder(folder / KIND, KIND, lasting), costs, threads)

    def by_hand(self, progress: Progress) -> dict[str, dict[str, Floats]]:
        """Rolling and inching as they were made by hand, on both terrains, in f64."""
        gaits = [repeated(design, self.settings.repeats) for design in BY_HAND.values()]
        cases = [Case(gait, self.settings.terrain(place)) for gait in gaits for place in PLACES]
        robot = self._robot("f64", self.settings.copies)
        speeds = iter(self._played("by_hand", "by hand", lambda: robot.speeds(cases, self.threads, progress)))
        return {name: {place: next(speeds) for place in PLACES} for name in BY_HAND}

    def found(
        self, found: Mapping[str, Found], by_hand: Mapping[str, Mapping[str, Floats]], progress: Progress
    ) -> Played:
        """The best design of every experiment again, and the best few of those on both terrains elsewhere."""
        again, elsewhere = {}, {}
        for number, experiment in enumerate(EXPERIMENTS):
            name = experiment.name
            if name not in found or not found[name].best(1):
                continue
            part = part_of(progress, number, len(EXPERIMENTS))
            again[name] = self._again(experiment, found[name], part_of(part, 0, 2))
            if experiment.row in PAIRED:
                elsewhere[name] = self._elsewhere(experiment, found[name], part_of(part, 1, 2))
        return Played(by_hand, again, elsewhere, _latest(found))

    def before(self, found: Mapping[str, Found], by_hand: Mapping[str, Mapping[str, Floats]]) -> Played:
        """The newest generation of which the folder has all best designs again, and what it has of them elsewhere."""
        best = [experiment for experiment in EXPERIMENTS if experiment.name in found and found[experiment.name].best(1)]
        for generation in range(_latest(found), -1, -1):
            again, elsewhere = (
                {e.name: each["speeds"] for e in best for each in self.folder.load(f"{what}_{_part(e, generation)}")}
                for what in ("again", "elsewhere")
            )
            if again and len(again) == len(best):
                return Played(by_hand, again, elsewhere, generation)
        return Played(by_hand)

    def _again(self, experiment: Experiment, found: Found, progress: Progress) -> Floats:
        """Speeds of copies of the best design where it was found; a search also keeps what chance favoured."""
        cases = [Case(found.designs[found.best(1)[0]], self.settings.terrain(experiment.place))]
        robot = self._robot("f64", self.settings.copies)
        name = f"again_{_part(experiment, len(found.scores) - 1)}"
        return self._played(name, "best designs again", lambda: robot.speeds(cases, self.threads, progress)[0])

    def _elsewhere(self, experiment: Experiment, found: Found, progress: Progress) -> Floats:
        """Speeds of the best designs where they were found, and on the other terrain."""
        best = found.best(self.settings.others)
        terrain = self.settings.terrain(HILL if experiment.place == FLAT else FLAT)
        cases = [Case(found.designs[climber], terrain) for climber in best]
        robot = self._robot("f32", 1, noise=0.0)
        return self._played(
            f"elsewhere_{_part(experiment, len(found.scores) - 1)}",
            "best designs elsewhere",
            lambda: np.array([found.scores[-1, best], robot.speeds(cases, self.threads, progress)[:, 0]]),
        )

    def _played(self, name: str, part: str, play: Callable[[], Floats]) -> Floats:
        """Speeds that the folder has under a name, or that are played now, at a cost of some part of the study."""

        def compute() -> Arrays:
            with self.costs.of(part):
                return {"speeds": play()}

        return cached(self.folder, name, compute)["speeds"]

    def _robot(self, precision: str, copies: int, **more: float) -> Robot:
        return Robot(NAMED_GEOMETRIES[self.settings.geometry], precision=precision, copies=copies, **more)  # type: ignore[arg-type]


def _latest(found: Mapping[str, Found]) -> int:
    """The generation that all experiments have reached; -1 if none has any."""
    return min((len(one.scores) - 1 for one in found.values()), default=-1)


def _part(experiment: Experiment, generation: int) -> str:
    """The name of an experiment's part; what it found changes with the generations."""
    return f"{experiment.name.replace('-', '_')}_{generation}"
