"""What the searches are held against: gaits made by hand, and what they found, simulated again and elsewhere."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from optim.experiments.results import Costs, Progress, cached, part_of
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, HILL, PAIRED, Experiment, Found, ShapeChange
from optim.studies.chapter5.gaits import Case, Robot, repeated
from robots.inflatable.robot import INCHING, NAMED_GEOMETRIES, ROLLING
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


def open_played(settings: ShapeChange, folder: Path) -> ResultsFolder:
    """The folder of these gaits, new or of the same settings; more generations may follow."""
    lasting = {name: value for name, value in asdict(settings).items() if name != "generations"}
    return ResultsFolder(folder / KIND, KIND, lasting)


def play_by_hand(
    settings: ShapeChange, folder: ResultsFolder, costs: Costs, threads: int | None, progress: Progress
) -> dict[str, dict[str, Floats]]:
    """Rolling and inching as they were made by hand, on both terrains, in f64."""
    robot = _robot(settings, "f64", settings.copies)
    cases = [
        Case(repeated(design, settings.repeats), settings.terrain(place))
        for design in BY_HAND.values()
        for place in PLACES
    ]

    def compute() -> Arrays:
        with costs.of("by hand"):
            return {"speeds": robot.speeds(cases, threads, progress)}

    speeds = iter(cached(folder, "by_hand", compute)["speeds"])
    return {name: {place: next(speeds) for place in PLACES} for name in BY_HAND}


def play_found(
    settings: ShapeChange,
    found: Mapping[str, Found],
    by_hand: Mapping[str, Mapping[str, Floats]],
    folder: ResultsFolder,
    costs: Costs,
    threads: int | None,
    progress: Progress,
) -> Played:
    """The best design of every experiment again, and the best few of those on both terrains elsewhere."""
    again, elsewhere = {}, {}
    for number, experiment in enumerate(EXPERIMENTS):
        if experiment.name not in found or not found[experiment.name].best(1):
            continue
        one, part = found[experiment.name], part_of(progress, number, len(EXPERIMENTS))
        again[experiment.name] = _again(settings, experiment, one, folder, costs, threads, part_of(part, 0, 2))
        if experiment.row in PAIRED:
            elsewhere[experiment.name] = _elsewhere(
                settings, experiment, one, folder, costs, threads, part_of(part, 1, 2)
            )
    return Played(by_hand, again, elsewhere, _latest(found))


def played_before(
    found: Mapping[str, Found], by_hand: Mapping[str, Mapping[str, Floats]], folder: ResultsFolder
) -> Played:
    """The newest generation of which the folder has all best designs again, and what it has of them elsewhere."""
    best = [experiment for experiment in EXPERIMENTS if experiment.name in found and found[experiment.name].best(1)]
    for generation in range(_latest(found), -1, -1):
        again, elsewhere = (
            {e.name: arrays["speeds"] for e in best for arrays in folder.load(f"{what}_{_part(e, generation)}")}
            for what in ("again", "elsewhere")
        )
        if again and len(again) == len(best):
            return Played(by_hand, again, elsewhere, generation)
    return Played(by_hand)


def _latest(found: Mapping[str, Found]) -> int:
    """The generation that all experiments have reached; -1 if none has any."""
    return min((len(one.scores) - 1 for one in found.values()), default=-1)


def _again(
    settings: ShapeChange,
    experiment: Experiment,
    found: Found,
    folder: ResultsFolder,
    costs: Costs,
    threads: int | None,
    progress: Progress,
) -> Floats:
    """Speeds of copies of the best design where it was found: a search also keeps what contact favoured by chance."""
    cases = [Case(found.designs[found.best(1)[0]], settings.terrain(experiment.place))]

    def compute() -> Arrays:
        with costs.of("best designs again"):
            return {"speeds": _robot(settings, "f64", settings.copies).speeds(cases, threads, progress)[0]}

    return cached(folder, f"again_{_part(experiment, len(found.scores) - 1)}", compute)["speeds"]


def _elsewhere(
    settings: ShapeChange,
    experiment: Experiment,
    found: Found,
    folder: ResultsFolder,
    costs: Costs,
    threads: int | None,
    progress: Progress,
) -> Floats:
    best = found.best(settings.others)
    place = HILL if experiment.place == FLAT else FLAT
    cases = [Case(found.designs[climber], settings.terrain(place)) for climber in best]

    def compute() -> Arrays:
        with costs.of("best designs elsewhere"):
            robot = _robot(settings, "f32", 1, noise=0.0)
            return {"speeds": np.array([found.scores[-1, best], robot.speeds(cases, threads, progress)[:, 0]])}

    return cached(folder, f"elsewhere_{_part(experiment, len(found.scores) - 1)}", compute)["speeds"]


def _robot(settings: ShapeChange, precision: str, copies: int, **more: float) -> Robot:
    return Robot(NAMED_GEOMETRIES[settings.geometry], precision=precision, copies=copies, **more)  # type: ignore[arg-type]


def _part(experiment: Experiment, generation: int) -> str:
    """The name of an experiment's part; what it found changes with the generations."""
    return f"{experiment.name.replace('-', '_')}_{generation}"
