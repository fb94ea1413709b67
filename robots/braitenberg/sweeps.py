"""Sweeps: every controller on a grid of weights, in every body, in the four environments.

Source: dissertation, chapter 4. Two symmetries of the model are exact, also in floating point: with left and right
exchanged, and driven backwards, a vehicle meets the same four environments in another order. So up to four bodies share
a sweep.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from robots.braitenberg.body import HALF_SIDE, VehicleBody
from robots.braitenberg.experiment import PUBLISHED, batch_of, check_bodies, contralateral, weight_grid
from taichi_sim.base.arrays import Arrays, Bytes
from taichi_sim.base.checks import choice, whole_number, within
from taichi_sim.base.compute import PRECISIONS
from taichi_sim.base.results_folder import ResultsFolder, read_settings
from taichi_sim.vehicle import VehicleTask, rollout

Overlap = Bytes
KIND, OVERLAPS = "sweep", "overlaps"  # of folders and files
MOST_WEIGHTS = 2001  # 16 million rollouts at once
BODIES_PER_FILE = 32  # a file each half a minute or so


@dataclass(frozen=True)
class Sweep:
    """Settings of a sweep over all controllers on a grid of weights.

    Attributes:
        weights: number of values of each of the two weights, from -1 to 1.
        radius: distance from the light below which a vehicle succeeds [m].
        time_step: time step [s].
        steps: time steps of every rollout.
        precision: ``"f64"``; ``"f32"`` flips a few percent of the cells.

    Raises:
        ValueError: for a setting that is not allowed.
    """

    weights: int = 121
    radius: float = PUBLISHED.radius
    time_step: float = PUBLISHED.time_step
    steps: int = PUBLISHED.steps
    precision: str = "f64"

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", whole_number("weights", self.weights, 2))
        if self.weights > MOST_WEIGHTS:
            raise ValueError(f"weights: {self.weights} is not allowed; give at most {MOST_WEIGHTS}")
        choice("precision", self.precision, PRECISIONS)
        _ = self.task

    @property
    def task(self) -> VehicleTask:
        """The four environments with these settings."""
        return replace(PUBLISHED, radius=self.radius, time_step=self.time_step, steps=self.steps)


def sweep(
    bodies: Sequence[VehicleBody],
    weights: int = 121,
    r: float = PUBLISHED.radius,
    dt: float = PUBLISHED.time_step,
    steps: int = PUBLISHED.steps,
    *,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    out: Path | str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Overlap:
    """Count the environments in which each controller of a grid reaches the light, for every body.

    Args:
        bodies: with two sensors each.
        weights: number n of values of each weight, see :func:`weight_grid`.
        r: distance from the light below which a vehicle succeeds [m].
        dt: time step [s].
        steps: of every rollout.
        precision, device, threads: as of :class:`Compute`; results do not depend on threads.
        out: folder that takes the results as they come. A sweep of the same settings that finds it goes on from there,
            also for other bodies; killed at any moment, it loses half a minute of work at most.
        progress: called with the fraction done.

    Returns:
        Overlap matrices O, shape (D, n, n): O[d, i, j] is the number of environments in which body d with the
        weights grid[i] and grid[j] succeeds.

    Raises:
        ValueError: for settings that are not allowed, no bodies, or a folder of other settings.
    """
    settings = Sweep(weights, r, dt, steps, precision)
    orbits = _orbits(bodies)
    folder = None if out is None else ResultsFolder(Path(out), KIND, asdict(settings))
    known = _load(folder, settings) if folder else {}
    missing = [body for body in orbits if body not in known]
    grid = weight_grid(settings.weights)
    controllers = contralateral(np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(1, -1, 2))
    for first in range(0, len(missing), BODIES_PER_FILE):
        fresh = {}
        for body in missing[first : first + BODIES_PER_FILE]:
            batch = batch_of([body], controllers)
            done = rollout(batch, settings.task, until="success", precision=precision, device=device, threads=threads)
            fresh[body] = done.reached.sum(axis=-1, dtype=np.uint8).reshape(len(grid), len(grid))
            if progress:
                progress((len(orbits) - len(missing) + first + len(fresh)) / len(orbits))
        known |= fresh
        if folder:
            _add(folder, fresh)
    found = np.empty((len(bodies), len(grid), len(grid)), np.uint8)
    for body, members in orbits.items():
        for index, flipped, transposed in members:
            seen = known[body][::-1, ::-1] if flipped else known[body]
            found[index] = seen.T if transposed else seen
    return found


def read_sweep(folder: Path | str) -> tuple[Sweep, list[VehicleBody]]:
    """Read the settings of a sweep on disk, and the bodies whose results :func:`sweep` finds there, in order.

    Raises:
        ValueError: if the folder holds no sweep.
    """
    settings = read_sweep_settings(Path(folder))
    known = _load(ResultsFolder(Path(folder), KIND, asdict(settings)), settings)
    images = {image for body in known for image in _images(body)}
    return settings, sorted(images, key=lambda body: body.sensors)


def holds_sweep(folder: Path) -> bool:
    """Whether a folder is that of a sweep."""
    return (folder / f"{KIND}.json").is_file()


def read_sweep_settings(folder: Path) -> Sweep:
    """The settings of a sweep on disk; a ValueError if the folder holds none."""
    try:
        return Sweep(**read_settings(folder, KIND))
    except TypeError as error:
        raise ValueError(f"{folder}: holds no {KIND} ({KIND}.json: {error})") from None


def _images(body: VehicleBody) -> dict[VehicleBody, tuple[bool, bool]]:
    """The bodies that are as good as this one: whether its weights change sign there, and places."""
    return {
        body: (False, False),
        body.mirrored: (False, True),
        body.reversed: (True, True),
        body.mirrored.reversed: (True, False),
    }


def _orbits(bodies: Sequence[VehicleBody]) -> dict[VehicleBody, list[tuple[int, bool, bool]]]:
    """Bodies that stand for others, and whose places they take: index, whether weights change sign, and places."""
    check_bodies(bodies)
    found: dict[VehicleBody, list[tuple[int, bool, bool]]] = {}
    for index, body in enumerate(bodies):
        if len(body.sensors) != 2:
            raise ValueError(f"bodies: {len(body.sensors)} sensors are not allowed in a sweep; give bodies with 2")
        images = _images(body)
        first = min(images, key=lambda b: b.sensors)
        found.setdefault(first, []).append((index, *images[first]))
    return found


def _load(folder: ResultsFolder, settings: Sweep) -> dict[VehicleBody, Overlap]:
    grid = settings.weights, settings.weights

    def check(arrays: Arrays) -> None:
        if (found := arrays["overlaps"].shape[1:]) != grid:
            raise ValueError(f"overlaps: a grid of {found[0]} x {found[1]} weights is not allowed; give {grid[0]} each")
        within("overlaps", arrays["overlaps"], 0, len(settings.task.starts))  # environments
        if (places := arrays["sites"].shape[1:]) != (2, 2):
            raise ValueError(f"sites: {places[0]} x {places[1]} numbers of a body are not allowed; give 2 x 2")
        within("sites", arrays["sites"], -HALF_SIDE, HALF_SIDE)  # inside the body [m]

    known: dict[VehicleBody, Overlap] = {}
    for arrays in folder.load(OVERLAPS, check, sites="f3", overlaps="u3"):
        known |= {VehicleBody(s): o for s, o in zip(arrays["sites"], arrays["overlaps"], strict=True)}
    return known


def _add(folder: ResultsFolder, fresh: dict[VehicleBody, Overlap]) -> None:
    sites = np.array([body.sensors for body in fresh])
    folder.add(OVERLAPS, sites.tobytes(), sites=sites, overlaps=np.stack(list(fresh.values())))
