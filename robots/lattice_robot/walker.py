"""Soft voxel walkers: what their bodies do on a terrain, or in water, while their active voxels swell and shrink."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from robots.control.cyclic import SEGMENTS, Cycle, build_cyclic_program, recorded_frames, surroundings
from robots.frames import Frames
from robots.lattice_robot.walker_body import (
    ACTIVE,
    ANTIPHASE,
    EMPTY,
    KINDS,
    LEAST_VOXELS,
    PASSIVE,
    WalkerDesign,
    WalkerTissue,
    load_walker,
    save_walker,
)
from robots.world import Terrain
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import number, whole_number
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeProgram, Quantity

__all__ = [
    "ACTIVE",
    "ANTIPHASE",
    "EMPTY",
    "KINDS",
    "LEAST_VOXELS",
    "PASSIVE",
    "WalkerActuation",
    "WalkerDesign",
    "WalkerResult",
    "WalkerTissue",
    "load_walker",
    "save_walker",
    "simulate",
]

PHASES = np.array([0.0, 0.0, 1.0, -1.0])  # of the kinds, times the sine


@dataclass(frozen=True)
class WalkerActuation:
    """How active voxels change and how long: edges 1 + amplitude sin(2 pi f t), those in antiphase with a minus.

    (differs: Cheney et al. 2013 change volumes by 20 %, edges by about 6.3 %; bodies of few voxels hardly walk then.)

    Attributes:
        amplitude: of the edges, part of their length, 0 to 0.5.
        frequency: f [Hz].
        settling: time on the floor, or afloat, before anything moves [s].
        cycles: whole cycles that count; another one comes before them, so that falling over does not.
    """

    amplitude: float = 0.14
    frequency: float = 4.0
    settling: float = 0.25
    cycles: int = 6

    def __post_init__(self) -> None:
        number("amplitude", self.amplitude, 0.0, 0.5)
        number("frequency", self.frequency, 0.1, 100.0, "Hz")
        number("settling", self.settling, 0.0, unit="s")
        whole_number("cycles", self.cycles, 1)

    def time_step(self, largest: float) -> float:
        """The largest dt [s] up to one of the tissue's of which a whole number makes a segment of the cycle."""
        return Cycle.fit(self.frequency, largest)

    def cycle(self, time_step: float) -> Cycle:
        """When what happens, in steps of dt [s]."""
        return Cycle(self.frequency, self.settling, self.cycles, time_step)


@dataclass(frozen=True, eq=False)
class WalkerResult:
    """What B designs did.

    Attributes:
        distance: of the centre of mass along +x in the cycles that count [m], shape (B,); NaN unless the status is
            "ok".
        speed: lengths of the design's lattice along x per second, shape (B,).
        status: "ok", "diverged" or "invalid", shape (B,).
        reason: why a design is no robot, shape (B,); empty if it is one.
        steps: time steps simulated, shape (B,).
        time_step: dt [s].
        bodies: the lattice of each; None where the design is no robot.
        frames: recorded poses of each, times from the start of the actuation; None where not asked for, or no robot.
    """

    distance: Floats
    speed: Floats
    status: NDArray[np.str_]
    reason: NDArray[np.str_]
    steps: Ints
    time_step: float
    bodies: tuple[LatticeBody | None, ...]
    frames: tuple[Frames | None, ...]


def simulate(
    designs: Sequence[WalkerDesign] | WalkerDesign,
    terrain: Terrain | None = None,
    *,
    tissue: WalkerTissue | None = None,
    actuation: WalkerActuation | None = None,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    record_every: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> WalkerResult:
    """Let designs walk on a terrain. Those with the same voxels, whatever these do, run as one batch.

    Args:
        designs: one design or several.
        terrain: flat ground by default; its high friction, if any, replaces both of the tissue's.
        tissue: of all voxels.
        actuation: of the active ones.
        precision: "f32" or "f64".
        device: "cpu", "cuda", "vulkan" or "metal".
        threads: CPU threads that share a batch; all cores by default. Results do not depend on it.
        record_every: record the poses every so many time steps from the start of the actuation on.
        progress: called now and then with the fraction done.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    designs = [designs] if isinstance(designs, WalkerDesign) else list(designs)
    if not designs or not all(isinstance(d, WalkerDesign) for d in designs):
        raise ValueError("designs: give at least one WalkerDesign")
    terrain, actuation = terrain or Terrain(), actuation or WalkerActuation()
    tissue = (tissue or WalkerTissue()).on(terrain)
    record_every = None if record_every is None else whole_number("record_every", record_every, 1)
    reason = np.array([design.fault for design in designs])
    groups: dict[bytes, list[int]] = {}
    for i in np.flatnonzero(reason == "").tolist():
        groups.setdefault(designs[i].connected[0].tobytes(), []).append(i)

    count = len(designs)
    distance, status, steps = np.full(count, np.nan), np.full(count, "invalid", object), np.zeros(count, np.int64)
    bodies: list[LatticeBody | None] = [None] * count
    frames: list[Frames | None] = [None] * count
    dt = actuation.time_step(tissue.time_step)
    for done, members in enumerate(groups.values()):
        tick = partial(_tick, progress, done, len(groups)) if progress else None
        body, kinds = _shared_body([designs[i] for i in members], tissue)
        program = build_program(kinds, terrain, actuation, dt, record_every)
        engine = LatticeEngine(
            body,
            len(members),
            time_step=dt,
            **terrain.medium,
            device=device,
            precision=precision,
            threads=threads,
        )
        run = engine.run(program, tick)
        centre = run.positions[:, :2, :, 0].mean(axis=2)  # all voxels weigh the same
        distance[members] = np.where(run.status == "ok", centre[:, 1] - centre[:, 0], np.nan)
        status[members], steps[members] = run.status, run.steps
        for row, i in enumerate(members):
            bodies[i] = body
            frames[i] = recorded_frames(body, run, row, record_every * dt) if record_every else None
    lengths = np.array([design.materials.shape[0] for design in designs]) * tissue.voxel_size
    speed = distance / lengths * actuation.frequency / actuation.cycles
    return WalkerResult(distance, speed, status.astype(str), reason, steps, dt, tuple(bodies), tuple(frames))


def _tick(progress: Callable[[float], None], done: int, groups: int, fraction: float) -> None:
    progress((done + fraction) / groups)


def _shared_body(designs: Sequence[WalkerDesign], tissue: WalkerTissue) -> tuple[LatticeBody, NDArray[np.int8]]:
    """The lattice of designs with the same voxels, and what its regions are in each, shape (B, R).

    Voxels that are of the same kind in every design are one region.
    """
    each = [design.connected for design in designs]
    kinds, regions = np.unique(np.array([kind for _, kind in each]), axis=1, return_inverse=True)
    return tissue.body(each[0][0], regions.ravel()), kinds


def build_program(
    kinds: NDArray[np.int8],
    terrain: Terrain,
    actuation: WalkerActuation,
    time_step: float,
    record_every: int | None = None,
) -> LatticeProgram:
    """The program of robots whose regions are of these kinds, shape (B, R); snapshots as of ``cyclic``."""
    regions = np.arange(kinds.shape[1])
    sine = actuation.amplitude * np.sin(2 * np.pi * np.arange(SEGMENTS) / SEGMENTS)
    swing = np.repeat(PHASES[kinds][..., None] * sine, 3, axis=1)  # of x, y and z
    quantities = np.tile(Quantity.SCALE + np.arange(3), len(regions))
    cycle = actuation.cycle(time_step)
    return build_cyclic_program(
        np.repeat(regions, 3), quantities, 1.0, swing, cycle, surroundings(terrain, 0.0), len(regions), record_every
    ).program
