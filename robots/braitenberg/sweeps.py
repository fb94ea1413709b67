"""Sweeps: every controller on a grid of weights, in every body, in the four environments.

Source: dissertation, chapter 4. Two symmetries of the model are exact, also in floating point: with left and right
exchanged, and driven backwards, a vehicle meets the same four environments in another order. So up to four bodies share
a sweep.
"""

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robots.braitenberg.body import VehicleBody
from robots.braitenberg.experiment import PUBLISHED, batch_of, contralateral, weight_grid
from robots.checks import whole_number
from robots.files import read_text, write_bytes, write_text
from taichi_sim.vehicle import VehicleTask, rollout

Overlap = NDArray[np.uint8]
SETTINGS = "sweep.json"
BODIES_PER_FILE = 32  # a file each half a minute or so


@dataclass(frozen=True)
class Sweep:
    """Settings of a sweep.

    Attributes:
        weights: values of each of the two weights, from -1 to 1.
        radius: of success [m].
        time_step: [s].
        steps: of every rollout.
        precision: ``"f64"``; ``"f32"`` flips a few percent of the cells.
    """

    weights: int = 121
    radius: float = PUBLISHED.radius
    time_step: float = PUBLISHED.time_step
    steps: int = PUBLISHED.steps
    precision: str = "f64"

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", whole_number("weights", self.weights, 2))
        if self.precision not in ("f32", "f64"):
            raise ValueError(f"precision: {self.precision!r} is unknown; choose one of f32, f64")
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
    """In how many environments each controller of a grid reaches the light, for every body.

    Args:
        bodies: with two sensors each.
        weights: n, values of each weight, see :func:`weight_grid`.
        r: radius of success [m].
        dt: time step [s].
        steps: of every rollout.
        precision, device, threads: see :func:`taichi_sim.vehicle.rollout`; results do not depend on threads.
        out: folder that takes the results as they come. A sweep of the same settings that finds it goes on from there,
            also for other bodies; killed at any moment, it loses half a minute of work at most.
        progress: called with the fraction done.

    Returns:
        Overlap matrices O, shape (D, n, n): O[d, i, j] is the number of environments in which body d with the
        weights grid[i] and grid[j] succeeds.

    Raises:
        ValueError: in one line, for settings that are not allowed, no bodies, or a folder of other settings.
    """
    settings = Sweep(weights, r, dt, steps, precision)
    orbits = _orbits(bodies)
    store = _Store(None if out is None else Path(out), settings)
    known = store.load()
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
        store.add(fresh)
    found = np.empty((len(bodies), len(grid), len(grid)), np.uint8)
    for body, members in orbits.items():
        for index, flipped, transposed in members:
            seen = known[body][::-1, ::-1] if flipped else known[body]
            found[index] = seen.T if transposed else seen
    return found


def _orbits(bodies: Sequence[VehicleBody]) -> dict[VehicleBody, list[tuple[int, bool, bool]]]:
    """Bodies that stand for others, and whose places they take: index, whether weights change sign, and places."""
    if not len(bodies):
        raise ValueError("bodies: none given; give at least one")
    found: dict[VehicleBody, list[tuple[int, bool, bool]]] = {}
    for index, body in enumerate(bodies):
        if len(body.sensors) != 2:
            raise ValueError(f"bodies: {len(body.sensors)} sensors are not allowed in a sweep; give bodies with 2")
        images = {
            body: (False, False),
            body.mirrored: (False, True),
            body.reversed: (True, True),
            body.mirrored.reversed: (True, False),
        }
        first = min(images, key=lambda b: b.sensors)
        found.setdefault(first, []).append((index, *images[first]))
    return found


class _Store:
    """Overlap matrices on disk: compressed files of some bodies each, written whole or not at all."""

    def __init__(self, folder: Path | None, settings: Sweep) -> None:
        """Make the folder, or check that it is of the same settings."""
        self.folder, self.settings = folder, settings
        if folder is None:
            return
        text = json.dumps({"format": "morpholab-sweep-1", **asdict(settings)}, indent=2) + "\n"
        if (folder / SETTINGS).exists():
            if read_text(folder / SETTINGS) != text:
                raise ValueError(f"out: {folder} holds a sweep of other settings; name another folder")
            return
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ValueError(f"out: {folder} holds something else; name a new folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ValueError(f"out: {folder} cannot be made ({error.strerror})") from None
        write_text(folder / SETTINGS, text)

    def load(self) -> dict[VehicleBody, Overlap]:
        """All that is known; what is damaged is as good as missing."""
        known: dict[VehicleBody, Overlap] = {}
        for path in sorted(self.folder.glob("overlaps-*.npz")) if self.folder else ():
            try:
                with np.load(path) as file:  # checks its own checksums
                    sites, overlaps = file["sites"].tolist(), file["overlaps"]
            except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
                continue
            known |= {_body(places): overlap for places, overlap in zip(sites, overlaps, strict=True)}
        return known

    def add(self, fresh: dict[VehicleBody, Overlap]) -> None:
        """Write a file of some bodies, named by them."""
        if self.folder is None:
            return
        sites = np.array([body.sensors for body in fresh])
        content = io.BytesIO()
        np.savez_compressed(content, sites=sites, overlaps=np.stack(list(fresh.values())))
        name = hashlib.sha256(sites.tobytes()).hexdigest()[:16]
        write_bytes(self.folder / f"overlaps-{name}.npz", content.getvalue())


def _body(places: list[list[float]]) -> VehicleBody:
    return VehicleBody(tuple((x, y) for x, y in places))
