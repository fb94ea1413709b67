"""The best designs of a search, played in full with noise under both conditions; judged once and cached."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import Progress, check_counts
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import History
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import InflatableDesign
from robots.inflatable.files import save_design
from robots.inflatable.robustness import HARD_FRICTION, LEAST_HARD_SPEED, NOISE, NoisySpeeds, play_with_noise
from robots.world import STEEPEST, Terrain
from taichi_sim.base import checks
from taichi_sim.base.files import read_text, sha256, write_text


@dataclass(frozen=True, kw_only=True)
class Finals:
    """The hill that gaits shall climb, and how the best of them are played there in full.

    Attributes:
        slope: of the hill [degrees].
        geometry: of the robot, by name.
        finalists: designs of a search that are played in full, at most.
        runs: with noise, of each of them under either condition.
    """

    slope: float = 15.0
    geometry: str = "published"
    finalists: int = 4
    runs: int = 4

    def __post_init__(self) -> None:
        checks.number("slope", self.slope, 0.1, STEEPEST, "degrees")
        checks.choice("geometry", self.geometry, NAMED_GEOMETRIES)
        check_counts(self, finalists=1, runs=1)

    @property
    def terrain(self) -> Terrain:
        """The hill."""
        return Terrain(self.slope)


def check_seeds(seeds: Sequence[int]) -> None:
    """Raise a ValueError for no seeds, or for one that is negative or given twice."""
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: {tuple(seeds)} are not allowed; give at least one, and none twice")
    for seed in seeds:
        checks.integer("seeds", seed, 0)


@dataclass(frozen=True, eq=False)
class Finalist(NoisySpeeds):
    """A design that a search found best at some time, played in full.

    Attributes:
        design: the gait.
        generation: in which it was found.
    """

    design: InflatableDesign
    generation: int

    @property
    def stays(self) -> bool:
        """Whether enough remains under the harder conditions."""
        return bool(self.hard_speed >= LEAST_HARD_SPEED)


def columns_of(best: Finalist | None) -> dict[str, Any]:
    """The columns of tables that tell of the best finalist; None where there is none."""
    if best is None:
        return dict.fromkeys(("generation", "speed", "hard_speed", "pressure", "orientation"))
    speeds = {"speed": best.speed, "hard_speed": best.hard_speed}
    gait = {"pressure": best.design.pressure, "orientation": best.design.orientation}
    return {"generation": best.generation, **speeds, **gait}


def last_bests(history: History, problem: GaitProblem, count: int) -> list[tuple[InflatableDesign, int]]:
    """The last few designs that a run found better than all before, and the generations that found them."""
    found: list[tuple[InflatableDesign, int]] = []
    full, before = problem.in_full(), None
    for generation in history.generations:
        if generation.best_point is not None and generation.best_point != before:
            before = generation.best_point
            found.append((full.design(problem.space.from_dict(before)), generation.generation))
    return found[-count:]


def judge_finalists(
    found: Sequence[tuple[InflatableDesign, int]],
    terrain: Terrain,
    runs: int,
    *,
    progress: Callable[[float], None] | None = None,
    **where: Any,
) -> list[Finalist]:
    """Play designs of one kind on a terrain, each ``runs`` times under either condition, as two batches."""
    if not found:
        return []
    rows = play_with_noise([design for design, _ in found], terrain, runs, progress=progress, **where)
    return [Finalist(usual, hard, *one) for usual, hard, one in zip(*rows, found, strict=True)]


def best_of(finalists: Sequence[Finalist]) -> Finalist | None:
    """The fastest of those that stay under the harder conditions; else the one that loses least there."""
    known = [f for f in finalists if np.isfinite([f.speed, f.hard_speed]).all()]
    staying = [f for f in known if f.stays]
    if staying:
        return max(staying, key=lambda f: f.speed)
    return max(known, key=lambda f: f.hard_speed) if known else None


def _read(path: Path) -> dict[str, Any]:
    """Read cached speeds; a damaged file is as good as missing."""
    try:
        known = json.loads(read_text(path)) if path.exists() else {}
    except ValueError:
        return {}
    return known if isinstance(known, dict) and isinstance(known.get("speeds"), list) else {}


def _conditions(problem: GaitProblem, terrain: Terrain, where: Mapping[str, Any]) -> str:
    """A digest of all that speeds of given designs depend on, beside the number of runs."""
    world = {"problem": problem.describe(), "terrain": asdict(terrain), "noise": NOISE, "friction": HARD_FRICTION}
    record = {**world, "precision": where.get("precision"), "device": where.get("device")}
    return sha256(json.dumps(record, sort_keys=True).encode())


def cached_finalists(
    path: Path,
    histories: Sequence[History],
    problem: GaitProblem,
    settings: Finals,
    progress: Progress,
    **where: Any,
) -> list[list[Finalist]]:
    """The last bests of each run of a search, played in full: from the file, if they are of these runs and conditions.

    All of them are one batch under either condition, since a few robots take as long as a vector full of them. The
    noise of each follows from its place among them.

    Args:
        path: of the JSON file, which may be missing, or of fewer generations.
        histories: of the runs.
        problem: that they searched.
        settings: the hill, and how many finalists of each run are played how often.
        progress: called with the fraction done.
        where: options of the simulations; ``precision`` is ``"f32"`` unless it is given.
    """
    where, body = {"precision": "f32", **where}, NAMED_GEOMETRIES[settings.geometry]
    found = [last_bests(history, problem, settings.finalists) for history in histories]
    bests = json.dumps([[generation.best_point for generation in history.generations] for history in histories])
    of = {"bests": sha256(bests.encode()), "count": settings.finalists, "runs": settings.runs}
    of |= {"conditions": _conditions(problem, settings.terrain, where)}
    known, listed = _read(path), [each for one in found for each in one]
    if known.get("of") != of or len(known["speeds"]) != len(listed):
        judged = judge_finalists(listed, settings.terrain, settings.runs, progress=progress, geometry=body, **where)
        speeds = [[f.speeds.tolist(), f.hard_speeds.tolist()] for f in judged]
        known = {"of": of, "speeds": json.loads(json.dumps(speeds).replace("NaN", "null"))}
        write_text(path, json.dumps(known) + "\n")
    rest = iter(np.array(known["speeds"], float))
    shares = ((one, islice(rest, len(one))) for one in found)
    return [[Finalist(usual, hard, *each) for each, (usual, hard) in zip(*share, strict=True)] for share in shares]


def write_gaits(folder: Path, found: Mapping[str, Finalist | None]) -> None:
    """Write the gaits found, by the names of their files; what earlier reports named there goes.

    Args:
        folder: of gaits alone, which may be new.
        found: None where nothing was.
    """
    folder.mkdir(exist_ok=True)
    for path in folder.glob("*.json"):
        if not found.get(path.stem):
            path.unlink()
    for name, best in found.items():
        if best:
            save_design(best.design, folder / f"{name}.json")
