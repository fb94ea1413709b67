"""Read and write ``config.toml``, which has every setting of a run and a checksum in its last line."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tomli_w

from optim.problem import GAIT, ROBOT, VEHICLE, WALKER, Objective, Problem, objectives_of, score_of
from optim.problems.earlier import is_described_by
from optim.search import METHODS, default_settings, has_independent_climbers
from taichi_sim.base import files
from taichi_sim.base.checks import shown, whole_number
from taichi_sim.base.parsing import parse_json, parse_toml
from taichi_sim.base.records import checked

FORMAT = 1  # of a run folder; raised when older programs could misread it
CONFIG = "config.toml"
SECTIONS = "problem", "method", "generations"
OBJECTIVES = "objectives"  # names and units, for readers; no result depends on them; version 1.0 did not write them
GROUND_FILES = "ground_files"  # checksums of the files of heights by name; left out if there are none
SCORES_OF_1_0 = {  # by the kind of problem, for folders without OBJECTIVES
    GAIT: Objective("speed", "BL/s"),
    ROBOT: Objective("speed", "BL/s"),
    WALKER: Objective("speed", "lattices/s"),
    VEHICLE: Objective("score", "m"),
}
SEAL = "# sha256 of all lines above: "


@dataclass(frozen=True)
class _Config:
    """Content of ``config.toml``; problems and methods check their own settings."""

    format: Annotated[int, partial(whole_number, low=1, high=FORMAT)]
    problem: dict[str, Any]
    method: dict[str, Any]
    generations: Annotated[int, partial(whole_number, low=0, high=2**31 - 1)]
    objectives: list[Objective] = field(default_factory=list)
    ground_files: dict[str, str] = field(default_factory=dict)


def has_run(folder: Path) -> bool:
    """Whether a run has been started in a folder."""
    return (folder / CONFIG).exists()


def folder_of_seed(out: Path, seed: int) -> Path:
    """Folder of the run with a given seed, inside the folder of all seeds."""
    return out / f"seed-{seed}"


def folders_of_seeds(out: Path) -> list[Path]:
    """List the folders of seeds inside a folder in order, whether or not they hold a run.

    Raises:
        ValueError: if the folder cannot be listed.
    """
    return folders_in(out, "seed-")


def run_of_any_seed(out: Path) -> Path | None:
    """The first run in the folder of several seeds; None if there is none yet."""
    return next(filter(has_run, folders_of_seeds(out)), None)


def folders_in(folder: Path, prefix: str = "") -> list[Path]:
    """List the folders inside a folder whose names begin with ``prefix``, in order; none if it does not exist.

    Raises:
        ValueError: if the folder cannot be listed (``Path.glob`` would return nothing).
    """
    try:
        names = [name for name in os.listdir(folder) if name.startswith(prefix)]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise ValueError(f"{folder}: cannot be listed ({error.strerror})") from None
    return sorted(folder / name for name in names if os.path.isdir(folder / name))


def write_config(folder: Path, config: Mapping[str, Any]) -> None:
    """Write the settings of a run."""
    text = tomli_w.dumps({"format": FORMAT, **config})
    with files.replacing(folder / CONFIG) as aside:
        aside.write_text(f"{text}{SEAL}{files.sha256(text.encode())}\n")


def _runs_in(folder: Path) -> str:
    """Words about the runs in the folders of one that holds none itself; empty if there are none."""
    names = sorted(path.parent.name for path in folder.glob(f"*/{CONFIG}"))
    return f"; name one of those in it, such as {folder / names[0]}" if names else ""


def read_config(folder: Path) -> dict[str, Any]:
    """Read the settings of the run in a folder.

    Raises:
        ValueError: if there are none, or they cannot be read, were changed, or are of a newer program.
    """
    path = folder / CONFIG
    if not path.exists():
        seed = run_of_any_seed(folder)
        several = f"; it has runs of several seeds, name one, such as {seed}" if seed else _runs_in(folder)
        raise ValueError(f"{folder}: holds no run; its {CONFIG} is missing{several}")
    text = files.read_text(path)
    try:
        config = parse_toml(text)
    except ValueError as error:  # invalid TOML, or a number with more digits than Python converts
        raise ValueError(f"{path}: cannot be read ({error})") from None
    version = config.get("format")
    if isinstance(version, int) and version > FORMAT:
        raise ValueError(f"{path}: was written by a newer morpholab (format {version}; this one reads {FORMAT})")
    above, seal, checksum = text.rpartition(SEAL)
    if not seal or checksum != files.sha256(above.encode()) + "\n":
        raise ValueError(f"{path}: is not as it was written; its checksum {'does not match' if seal else 'is missing'}")
    try:
        checked(_Config, config)
        if not isinstance(name := config["method"].get("name"), str):
            raise ValueError(f"method.name: {shown(name)} is not allowed; it must be a text")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    del config["format"]
    return config


def settings_of(problem: Problem, method: str, settings: Mapping[str, Any], generations: int) -> dict[str, Any]:
    """Make the content of ``config.toml`` for a search of a problem by a method.

    Raises:
        ValueError: if a file of the ground is missing or cannot be read.
    """
    ground_files = getattr(problem, GROUND_FILES, {})
    return {
        "problem": problem.describe(),
        "method": {"name": method, **settings},
        "generations": generations,
        OBJECTIVES: [asdict(objective) for objective in objectives_of(problem)],
        **({GROUND_FILES: ground_files} if ground_files else {}),
    }


def score_in(config: Mapping[str, Any]) -> Objective:
    """Name and unit of the scores in a run's log, read from its settings."""
    if config.get(OBJECTIVES):
        return score_of([Objective(**objective) for objective in config[OBJECTIVES]])
    return SCORES_OF_1_0.get(config["problem"].get("kind", GAIT), Objective("score"))


def identity(config: Mapping[str, Any]) -> str:
    """Checksum of the settings that determine a run's results and stay the same when it continues."""
    lasting = {name: value for name, value in config.items() if name not in ("generations", OBJECTIVES)}
    return hashlib.sha256(json.dumps(lasting, sort_keys=True).encode()).hexdigest()


def check_same(known: Mapping[str, Any], asked: Mapping[str, Any], folder: Path, prefix: str = "") -> None:
    """Raise ValueError if the requested settings are not those of the run; ``generations`` may be larger.

    Settings of the problem and the method may be left out; one that is a table must be given whole.
    """
    for name, value in asked.items():
        if not prefix and name == OBJECTIVES:  # those in the folder are kept
            continue
        if not prefix and name == GROUND_FILES:
            check_ground_files(known, value, folder)
            continue
        old = known.get(name)
        if not prefix and isinstance(old, Mapping) and isinstance(value, Mapping):
            check_same(old, value, folder, f"{name}.")
        elif prefix + name == "generations" and value < known[name]:
            raise ValueError(f"generations: {value} is below the {old} of the run in {folder}; it may only be raised")
        elif prefix == "method." and name not in known and value == usual_settings(known).get(name):
            continue  # a setting that methods did not have when the run began
        elif prefix + name == "problem.robot" and _is_same_robot(old, value):
            continue
        elif prefix + name != "generations" and value != old:
            raise ValueError(f"{prefix}{name}: {value!r} is not what the run in {folder} has, {old!r}; leave it out")


def _is_same_robot(known: object, asked: object) -> bool:
    """Whether two descriptions of robots as JSON mean the same; the first may be one of an earlier version."""
    try:
        return is_described_by(parse_json(str(known)), parse_json(str(asked)))
    except ValueError:
        return False


def check_ground_files(known: Mapping[str, Any], found: Mapping[str, str], folder: Path) -> None:
    """Refuse files of the ground that have changed since a run began.

    Runs of earlier versions did not record checksums and are accepted.

    Args:
        known: settings of the run.
        found: checksums of the files as they are now, by name.
        folder: folder of the run.

    Raises:
        ValueError: for the first file that differs.
    """
    recorded = known.get(GROUND_FILES, {})
    for file, checksum in found.items():
        if (old := recorded.get(file, checksum)) != checksum:
            copy = files.copy_in(folder, file)
            wrong = copy if copy.is_file() and files.sha256(copy.read_bytes()) == checksum else file
            raise ValueError(
                f"terrain: {wrong} is not the file of the run in {folder} (SHA-256 {checksum[:12]}..., the run has "
                f"{old[:12]}...); give it as it was, or start a new run"
            )


def keep_ground_files(problem: Problem, folder: Path) -> None:
    """Copy the files of the ground that a problem needs, if any, into a folder, so that the folder can be moved.

    Raises:
        ValueError: if a file cannot be read, or the folder cannot be written.
        RuntimeError: if the disk is full or broken.
    """
    if keep := getattr(problem, "keep_ground_files", None):
        keep(folder)


def usual_settings(method: Mapping[str, Any]) -> dict[str, Any]:
    """Default settings of a run's method, by name; none if the method is not installed."""
    return default_settings(str(method["name"])) if str(method.get("name")) in METHODS else {}


def climbs_independently(method: Mapping[str, Any]) -> bool:
    """Whether climbers of a run's method are independent samples; not known, so False, if it is not installed."""
    return str(method.get("name")) in METHODS and has_independent_climbers(str(method["name"]))
