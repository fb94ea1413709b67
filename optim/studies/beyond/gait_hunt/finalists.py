"""The best designs of a search, played in full with noise under both conditions; judged once and cached."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Kind
from optim.experiments.results import Progress
from optim.experiments.study import Count, Settings
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import History
from optim.studies.chapter5.gaits import Uphill
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import InflatableDesign, save_design
from robots.inflatable.kind import InflatableKind
from robots.inflatable.robustness import HARD_FRICTION, LEAST_HARD_SPEED, NOISE, NoisySpeeds, play_with_noise
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.files import read_text, sha256, write_text
from taichi_sim.base.parsing import parse_json


def check_seeds(name: str, seeds: Sequence[int]) -> Sequence[int]:
    """Return seeds; raises ValueError for none, or for one that is negative or given twice."""
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"{name}: {tuple(seeds)} are not allowed; give at least one, and none twice")
    return tuple(checks.integer(name, seed, 0) for seed in seeds)


def check_friction(name: str, friction: Sequence[float]) -> tuple[float, float]:
    """Return the friction of sliding and of gripping feet; raises ValueError for what is not allowed."""
    terrain = InflatableKind().on_ground(Terrain(), {name: friction})
    assert terrain.low_friction is not None and terrain.high_friction is not None
    return terrain.low_friction, terrain.high_friction


Seeds = Annotated[tuple[int, ...], check_seeds]


@dataclass(frozen=True, kw_only=True)
class Finals(Settings):
    """The hill that gaits shall climb, and how the best of them are played there in full."""

    slope: Uphill = 15.0  # of the hill [degrees]
    geometry: str = "published"  # of the robot, by name
    finalists: Count = 4  # designs of a search that are played in full, at most
    runs: Count = 4  # with noise, of each of them under either condition
    friction: Annotated[tuple[float, float], check_friction] | None = None  # of sliding and of gripping feet

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.choice("geometry", self.geometry, NAMED_GEOMETRIES)

    @property
    def terrain(self) -> Terrain:
        """The hill."""
        low, high = self.friction or (None, None)
        return Terrain(self.slope, high, low)

    @property
    def about_hill(self) -> dict[str, Any]:
        """The slope, and the friction where it is not the robot's own."""
        return {"slope": self.slope, **({} if self.friction is None else {"friction": list(self.friction)})}


@dataclass(frozen=True, eq=False)
class Finalist(NoisySpeeds):
    """A design that a search found best at some time, played in full."""

    design: InflatableDesign  # the gait
    generation: int  # in which it was found

    @property
    def stays(self) -> bool:
        """Whether enough remains under the harder conditions."""
        return bool(self.hard_speed >= LEAST_HARD_SPEED)


def finalist_columns(best: Finalist | None) -> dict[str, Any]:
    """The columns of tables that tell of the best finalist; None where there is none."""
    if best is None:
        return dict.fromkeys(("generation", "speed", "hard_speed", "pressure", "orientation"))
    speeds = {"speed": best.speed, "hard_speed": best.hard_speed}
    gait = {"pressure": best.design.pressure, "orientation": best.design.orientation}
    return {"generation": best.generation, **speeds, **gait}


# Kinds of these columns.
FOUND: dict[str, Kind] = {
    "generation": int | None,
    **dict.fromkeys(("speed", "hard_speed", "orientation"), float | None),
    "pressure": float | list | tuple | None,
}


def hill_of(summary: Mapping[str, Any]) -> dict[str, Any]:
    """What a study's summary says of its hill, as ``Finals.about_hill`` gave it."""
    return {"slope": summary["slope"], **({"friction": summary["friction"]} if "friction" in summary else {})}


def last_bests(history: History, problem: GaitProblem, count: int) -> list[tuple[InflatableDesign, int]]:
    """The last few designs that a run found better than all before, and the generations that found them."""
    found: list[tuple[InflatableDesign, int]] = []
    full, before = problem.in_full(), None
    for generation in history.generations:
        if generation.best_point is not None and generation.best_point != before:
            before = generation.best_point
            found.append((full.design(problem.space.from_dict(before)), generation.generation))
    return found[-count:]


def best_of(finalists: Sequence[Finalist]) -> Finalist | None:
    """The fastest of those that stay under the harder conditions; else the one that loses least there."""
    known = [f for f in finalists if np.isfinite([f.speed, f.hard_speed]).all()]
    staying = [f for f in known if f.stays]
    if staying:
        return max(staying, key=lambda f: f.speed)
    return max(known, key=lambda f: f.hard_speed) if known else None


def cached_finalists(
    path: Path,
    histories: Sequence[History],
    problem: GaitProblem,
    settings: Finals,
    progress: Progress,
    **compute: Any,
) -> list[list[Finalist]]:
    """The last bests of each run of a search, played in full: from the file, if they are of these runs and conditions.

    All of them are one batch under either condition, since a few robots take as long as a vector full of them. The
    noise of each follows from its place among them. The file may be missing, damaged, or of fewer generations; the
    ``precision`` of the simulations is ``"f32"`` unless it is given.
    """
    compute = {"precision": "f32", **compute}
    found = [last_bests(history, problem, settings.finalists) for history in histories]
    listed = [each for one in found for each in one]
    bests = [[generation.best_point for generation in history.generations] for history in histories]
    world = {"problem": problem.describe(), "terrain": settings.terrain.document, "noise": NOISE}
    conditions = {
        **world,
        "friction": HARD_FRICTION,
        "precision": compute["precision"],
        "device": compute.get("device"),
    }
    of = {"bests": sha256(json.dumps(bests).encode()), "count": settings.finalists, "runs": settings.runs}
    of["conditions"] = sha256(json.dumps(conditions, sort_keys=True).encode())
    known = _read(path)
    if known.get("of") != of or len(known["speeds"]) != len(listed):
        speeds = np.empty((0, 2, settings.runs))
        if listed:
            designs, body = [design for design, _ in listed], NAMED_GEOMETRIES[settings.geometry]
            options = {"progress": progress, "geometry": body, **compute}
            speeds = np.stack(play_with_noise(designs, settings.terrain, settings.runs, **options), axis=1)
        known = {"of": of, "speeds": np.where(np.isnan(speeds), None, speeds).tolist()}  # type: ignore[call-overload]
        write_text(path, json.dumps(known) + "\n")
    judged = zip(listed, np.array(known["speeds"], float), strict=True)
    rest = iter([Finalist(usual, hard, *each) for each, (usual, hard) in judged])
    return [list(islice(rest, len(one))) for one in found]


def _read(path: Path) -> dict[str, Any]:
    """Read cached speeds; a damaged file is as good as missing."""
    try:
        known = parse_json(read_text(path)) if path.exists() else {}
    except ValueError:
        return {}
    return known if isinstance(known, dict) and isinstance(known.get("speeds"), list) else {}


def write_gaits(folder: Path, found: Mapping[str, Finalist | None]) -> None:
    """Write the gaits found by their names to a folder of gaits alone; what earlier reports named there goes."""
    folder.mkdir(exist_ok=True)
    for path in folder.glob("*.json"):
        if not found.get(path.stem):
            path.unlink()
    for name, best in found.items():
        if best:
            save_design(best.design, folder / f"{name}.json")
