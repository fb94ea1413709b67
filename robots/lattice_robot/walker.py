"""Soft walkers: lattice robots of passive and active voxels, which a search may put together voxel by voxel.

Source: Cheney, MacCurdy, Clune & Lipson, "Unshackling evolution: evolving soft robots with multiple materials and a
powerful generative encoding", GECCO 2013: active voxels swell and shrink in time, some in antiphase; nothing else moves
the robot. The robots of evosoro and voxcraft-sim are of this kind.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from robots.control.cyclic import Cycle
from robots.lattice_robot.drive import Drive, Free
from robots.lattice_robot.formats import WALKER_FORMAT
from robots.lattice_robot.ground import WITHOUT_PROPS, material_friction
from robots.lattice_robot.measures import measures_of
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.simulation import LatticeRobotResult, assembled, try_variants
from robots.robot import Progress, Trial, World, part_of
from robots.world import Terrain, terrain_of
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import known_names, number, shown, whole_number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.base.files import read_record, write_record
from taichi_sim.lattice import LatticeBody, Material
from taichi_sim.lattice.body import USUAL_LINKS

EMPTY, PASSIVE, ACTIVE, ANTIPHASE = range(4)
KINDS = ("empty", "passive", "active", "antiphase")
LEAST_VOXELS = 4
LEAST_REACH = 1e-9  # of amplitudes that all are 0 [edges]
PHASES = np.array([0.0, 0.0, 1.0, -1.0])  # by kind, times the sine
SILICONE = Material(5e4, 1000.0, static_friction=1.0, kinetic_friction=0.5, internal_damping=1.0, collision_damping=1.0)


@dataclass(frozen=True, eq=False)
class WalkerDesign:
    """The body of a walker: what every place of a lattice holds.

    Attributes:
        materials: ``EMPTY`` (0), ``PASSIVE`` (1), ``ACTIVE`` (2) or ``ANTIPHASE`` (3), whole numbers of shape
            (X, Y, Z), read-only; the robot is to walk along +x, and +z is up.
    """

    materials: NDArray[np.int8]

    def __post_init__(self) -> None:
        given = np.asarray(self.materials)
        if given.ndim != 3 or not given.size:
            raise ValueError(f"materials: shape {given.shape} is not allowed; give (X, Y, Z), each at least 1")
        wrong = np.argwhere(~np.isin(given, range(len(KINDS))))
        if wrong.size:
            x, y, z = wrong[0].tolist()
            allowed = ", ".join(f"{number} {kind}" for number, kind in enumerate(KINDS))
            raise ValueError(f"materials: {given[x, y, z]} of voxel ({x}, {y}, {z}) is not allowed; give {allowed}")
        materials = given.astype(np.int8)
        materials.setflags(write=False)
        object.__setattr__(self, "materials", materials)

    @property
    def fault(self) -> str:
        """Why it is no robot; empty if it is one."""
        kinds = self.connected[1]
        if not len(kinds):
            return "the body is empty"
        if len(kinds) < LEAST_VOXELS:
            return f"the body has {len(kinds)} connected voxels; it needs {LEAST_VOXELS}"
        return "" if (kinds != PASSIVE).any() else "the body has no active voxel"

    @cached_property
    def connected(self) -> tuple[Ints, NDArray[np.int8]]:
        """The largest part whose voxels share faces (the first of equals), moved to the corner of the lattice.

        Returns:
            Places, shape (V, 3), and kinds, shape (V,).
        """
        part, count = ndimage.label(self.materials != EMPTY)  # neighbours by faces
        if not count:
            return np.zeros((0, 3), np.int64), np.zeros(0, np.int8)
        largest = part == 1 + np.argmax(np.bincount(part.ravel())[1:])
        places = np.argwhere(largest)
        return places - places.min(axis=0), self.materials[largest]


def save_walker(design: WalkerDesign, path: str | PathLike[str]) -> None:
    """Write a design as JSON: layers from the ground up, of each the rows in order of y, a digit a voxel."""
    layers = np.moveaxis(design.materials, [2, 1, 0], [0, 1, 2]).tolist()
    write_record(path, WALKER_FORMAT, {"layers": [["".join(map(str, row)) for row in layer] for layer in layers]})


def load_walker(path: str | PathLike[str]) -> WalkerDesign:
    """Read a design written by :func:`save_walker`.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    return read_record(path, WALKER_FORMAT, _design_of)


def _design_of(record: dict[str, Any]) -> WalkerDesign:
    known_names(record, "format", "layers")
    for row in (row for layer in record["layers"] for row in layer):
        if not (isinstance(row, str) and row.isascii() and row.isdigit()):
            raise ValueError(f"layers: {shown(row)} is not allowed; give rows of digits, such as '0123'")
    layers = [[[int(digit) for digit in row] for row in layer] for layer in record["layers"]]
    if len({(len(layer), len(row)) for layer in layers for row in layer}) != 1:
        raise ValueError("layers: they differ in size; give equally many rows, equally long")
    return WalkerDesign(np.moveaxis(np.array(layers), [0, 1, 2], [2, 1, 0]))


@dataclass(frozen=True)
class WalkerTissue:
    """What all voxels are made of: by default a very soft silicone.

    Attributes:
        material: of the lattice.
        voxel_size: h [m].
        time_step_safety: the largest stable time step is divided by this.
        links: law of the links between voxels, see ``LatticeBody``.
    """

    material: Material = SILICONE
    voxel_size: float = 0.02
    time_step_safety: float = 1.3
    links: str = USUAL_LINKS


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


def walker_robot(
    design: WalkerDesign, tissue: WalkerTissue | None = None, actuation: WalkerActuation | None = None
) -> LatticeRobot:
    """The lattice robot of a design: groups ``active`` and ``antiphase``, as far as it has such voxels.

    Raises:
        ValueError: if the design is no robot.
    """
    if design.fault:
        raise ValueError(f"design: it is no robot: {design.fault}")
    drive, (places, kinds) = actuation or WalkerActuation(), design.connected
    drives = [
        Drive(KINDS[kind], (kind,), amplitude=float(PHASES[kind]) * drive.amplitude)
        for kind in (ACTIVE, ANTIPHASE)
        if kind in kinds
    ]
    return _robot(places, kinds, drives, tissue or WalkerTissue(), drive)


def check_terrain(terrain: Terrain) -> None:
    """Raise a ValueError if a terrain gives props, or a friction for parts of the inflatable robot."""
    material_friction(terrain, "a walker has no sliding feet", WITHOUT_PROPS)


def simulate(
    designs: Sequence[WalkerDesign] | WalkerDesign,
    terrain: Terrain | None = None,
    *,
    tissue: WalkerTissue | None = None,
    actuation: WalkerActuation | None = None,
    record_every: int | None = None,
    progress: Progress | None = None,
    **compute: Unpack[ComputeOptions],
) -> LatticeRobotResult:
    """Let designs walk on a terrain. Those with the same voxels, whatever these do, run as one batch.

    Args:
        designs: one design or several.
        terrain: flat ground by default; its friction, if any, replaces the tissue's.
        tissue: of all voxels.
        actuation: of the active ones.
        record_every: record the poses every so many time steps from the start of the actuation on.
        progress: called now and then with the fraction done.
        compute: ``device``, ``precision`` (``"f64"`` by default) and ``threads``.

    Returns:
        Results by design; speeds are in lengths of the design's whole lattice along x per second. The body of a design
        that is no robot is None.

    Raises:
        ValueError: that names the argument, the value and what is allowed.
    """
    trial = Trial(terrain or Terrain(), Compute.given(compute), record_every, progress)
    return simulate_in(designs, [trial.world], trial, tissue, actuation)[0]


def simulate_in(
    designs: Sequence[WalkerDesign] | WalkerDesign,
    worlds: Sequence[World],
    trial: Trial,
    tissue: WalkerTissue | None = None,
    actuation: WalkerActuation | None = None,
) -> list[LatticeRobotResult]:
    """Let designs walk in several worlds; those with the same voxels run as one batch, in all that can share it.

    Args:
        designs: as of :func:`simulate`.
        worlds: terrains.
        trial: computation, recording and progress.
        tissue: of all voxels.
        actuation: of the active ones.

    Returns:
        A result as :func:`simulate` gives it for each world.

    Raises:
        ValueError: that names the argument, the value and what is allowed.
    """
    designs = [designs] if isinstance(designs, WalkerDesign) else list(designs)
    if not designs or not all(isinstance(d, WalkerDesign) for d in designs):
        raise ValueError("designs: give at least one WalkerDesign")
    tissue, drive = tissue or WalkerTissue(), actuation or WalkerActuation()
    for world in worlds:
        check_terrain(terrain_of(world))
    if trial.record_every is not None:
        whole_number("record_every", trial.record_every, 1)
    reason = np.array([design.fault for design in designs])
    groups: dict[bytes, list[int]] = {}
    for i in np.flatnonzero(reason == "").tolist():
        groups.setdefault(designs[i].connected[0].tobytes(), []).append(i)
    parts: list[list[tuple[Ints, LatticeRobotResult]]] = [[] for _ in worlds]
    for done, members in enumerate(groups.values()):
        robot, points = _batch([designs[i] for i in members], tissue, drive)
        told = replace(trial, progress=part_of(trial.progress, done, len(groups)))
        outcomes = try_variants([robot] * len(worlds), points, worlds, told)
        for mine, outcome in zip(parts, outcomes, strict=True):
            mine.append((np.array(members), outcome.result))
    names, dry = [m.name for m in measures_of(False)], walker_cycle(drive, tissue).time_step
    lengths = np.array([design.materials.shape[0] for design in designs]) * tissue.voxel_size

    def whole(mine: list[tuple[Ints, LatticeRobotResult]]) -> LatticeRobotResult:
        """The result in a world, with speeds in lengths of the lattice."""
        time_step = mine[0][1].time_step if mine else dry  # steps are shorter in water, in that of all bodies
        result = assembled(mine, reason, time_step, names, {})
        speed = result.distance / lengths * drive.frequency / drive.cycles
        return replace(result, measures={**result.measures, "speed": speed})

    return [whole(mine) for mine in parts]


def _batch(
    designs: Sequence[WalkerDesign], tissue: WalkerTissue, actuation: WalkerActuation
) -> tuple[LatticeRobot, Floats]:
    """One robot for designs with the same voxels, and its point for each: the amplitudes of its regions.

    Voxels that are of the same kind in every design are one region.
    """
    each = [design.connected for design in designs]
    kinds, regions = np.unique(np.array([kind for _, kind in each]), axis=1, return_inverse=True)
    count = kinds.shape[1]
    reach = actuation.amplitude or LEAST_REACH  # in water, time steps are those of the largest voxels that there may be
    drive = Drive("voxels", tuple(range(count)), amplitude=(Free(-reach, reach),) * count)
    return _robot(each[0][0], regions.ravel(), [drive], tissue, actuation), PHASES[kinds] * actuation.amplitude


def _robot(
    places: Ints, regions: NDArray[Any], drives: Sequence[Drive], tissue: WalkerTissue, actuation: WalkerActuation
) -> LatticeRobot:
    of = np.zeros(len(places), int)
    body = LatticeBody(places, (tissue.material,), of, tissue.voxel_size, regions, links=tissue.links)
    return LatticeRobot(
        body,
        tuple(drives),
        frequency=actuation.frequency,
        cycles=actuation.cycles,
        settling=actuation.settling,
        time_step_safety=tissue.time_step_safety,
        name="walker",
    )


def walker_cycle(actuation: WalkerActuation, tissue: WalkerTissue | None = None) -> Cycle:
    """When what happens: the same for all bodies, so that of the smallest robot."""
    pair, regions, drive = np.array([[0, 0, 0], [1, 0, 0]]), np.zeros(2, np.int64), Drive("pair", (0,))
    return _robot(pair, regions, [drive], tissue or WalkerTissue(), actuation).cycle
