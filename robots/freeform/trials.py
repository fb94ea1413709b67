"""How freeform robots are tried: designs that can be built, each as its own lattice, and mixtures between designs."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from robots.batches import batch_key, grouped, in_groups, of_each
from robots.control.cyclic import SEGMENTS
from robots.freeform.fields import RESOLUTION, Fields
from robots.freeform.palette import MIXED
from robots.freeform.solid import Solid, channels_of_cells
from robots.lattice_robot.ground import WITHOUT_PROPS, material_friction
from robots.lattice_robot.rollout import Aim, Channels, Rollout
from robots.lattice_robot.scenes import Scenes
from robots.lattice_robot.simulation import LARGEST_BATCH, LatticeRobotResult, assembled, result_of
from robots.robot import Progress, Trial, World, part_of
from robots.world import Terrain, terrain_of
from taichi_sim.autodiff.arrays import trace, value_of
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import LatticeBody, Quantity

if TYPE_CHECKING:
    from robots.freeform.robot import FreeformRobot

MEMORY = 1e9  # of a differentiation's record [B]
AT_ONCE = 2  # robots a thread in a record: more share the memory, and so compute more again
REST = 1.0  # size of a cell that no muscle moves [edges]
ANGLES = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS  # of the nodes of a cycle [rad]
WAVE = np.stack([np.sin(ANGLES), np.cos(ANGLES)], axis=1)  # of the components of a swing, at the nodes
CHOICE = 4.0  # how sharply the heaviest tissue prevails, where nothing is sharpened yet
Case = tuple["FreeformRobot", Terrain]


@dataclass(frozen=True, eq=False)
class Cases:
    """Variants of one robot, each in its world, that can share a batch; they differ as draws of it do.

    Attributes:
        robots: W of them.
        terrains: of each.
        trial: how they are tried; its world is that of the first.
    """

    robots: "Sequence[FreeformRobot]"
    terrains: Sequence[Terrain]
    trial: Trial

    @property
    def first(self) -> "FreeformRobot":
        """The first robot, for what all of them share."""
        return self.robots[0]

    def of(self, which: Ints) -> list[Case]:
        """Robot and terrain of cases, shape (N,); the same object for the same case."""
        pairs = list(zip(self.robots, self.terrains, strict=True))
        return [pairs[case] for case in which.tolist()]

    def parts(self, cases: Ints, done: int, count: int) -> "Iterator[tuple[Ints, Cases]]":
        """Numbers of cases, N for each world, in groups small enough for a record, and how each group is tried."""
        compute = self.trial.compute
        size = max(LARGEST_BATCH, len(cases) // len(self.robots)) if compute.device == "cpu" else len(cases)
        if self.trial.gradients:
            size = AT_ONCE * compute.thread_count
        groups = [cases[first : first + size] for first in range(0, len(cases), size)]
        outer = part_of(self.trial.progress, done, count)
        for number, group in enumerate(groups):
            tick = part_of(outer, number, len(groups))
            yield group, replace(self, trial=replace(self.trial, progress=tick))


def try_variants(
    robots: "Sequence[FreeformRobot]", points: Floats, worlds: Sequence[World], trial: Trial
) -> list[LatticeRobotResult]:
    """Try points, shape (N, P), with each of several variants of a robot in its world; those that can share a batch do.

    They are tried as robots that can be built, or between designs if the trial's sharpness is finite. Of robots that
    can be built the results also tell the numbers of ``cells`` and ``channels``.
    """
    terrains = [terrain_of(world) for world in worlds]
    pairs = zip(robots, terrains, strict=True)
    groups = grouped(
        (
            r.actuation.frequency,
            r.cycle_on(terrain).time_step,
            terrain.light is None,
            batch_key(terrain, r.palette.materials),
        )
        for r, terrain in pairs
    )

    def run(group: Sequence[int], progress: Progress | None) -> Iterator[LatticeRobotResult]:
        told = replace(trial, progress=progress)
        cases = Cases([robots[number] for number in group], [terrains[number] for number in group], told)
        between = math.isfinite(trial.sharpness) and cases.first.relaxable
        return (_between if between else _true)(cases, points).split(len(group))

    return in_groups(groups, trial.progress, run)


def _true(cases: Cases, points: Floats) -> LatticeRobotResult:
    """What the robots do that can be built of N points, in each of W cases, as W N points."""
    robot, count = cases.first, len(points)
    fields = robot.parametrisation(points)
    solids = [robot.solid_at(fields, row) for row in range(count)]
    alike = grouped((s.cells.tobytes(), s.tissues.tobytes(), s.channels.tobytes()) for s in solids)
    alike = [rows for rows in alike if not solids[rows[0]].fault]
    worlds, parts = count * np.arange(len(cases.robots))[:, None], []
    for done, rows in enumerate(alike):
        for each, told in cases.parts((worlds + rows).ravel(), done, len(alike)):
            parts.append((each, _built(told, solids[rows[0]], points[each % count], each // count)))
    found = _assembled(cases, parts, np.array([solid.fault for solid in solids]), points.shape[1])
    return replace(found, measures={**found.measures, **counts_of(solids * len(cases.robots), found.status)})


def counts_of(solids: Sequence[Solid], status: NDArray[np.str_]) -> dict[str, Floats]:
    """How many cells and channels robots have, by these names, shape (N,) each; NaN of those that have no measures."""
    counts = {"cells": [len(solid.cells) for solid in solids], "channels": [solid.waves for solid in solids]}
    return {name: np.where(status == "ok", each, np.nan) for name, each in counts.items()}


def _assembled(
    cases: Cases, parts: list[tuple[NDArray[Any], LatticeRobotResult]], reason: NDArray[np.str_], free: int
) -> LatticeRobotResult:
    measures = cases.first.measures_in(cases.terrains)
    names, slopes = [m.name for m in measures], dict.fromkeys(cases.trial.gradients, free)
    cycle = cases.first.cycle_on(cases.terrains[0])
    return assembled(parts, np.tile(reason, len(cases.robots)), cycle.time_step, names, slopes)


def _built(cases: Cases, solid: Solid, points: Floats, which: Ints) -> LatticeRobotResult:
    """What robots with the same cells do: that of each point, shape (N, P), in one of the cases, shape (N,)."""
    trial, owners, still = cases.trial, cases.of(which), np.zeros(solid.count)
    shell = owners[0][0].built(solid, still, still)
    shells = {id(owners[0][0].palette): shell}
    for robot, _ in owners:  # which differ in what rubs; all else of their shells is that of the first
        if id(robot.palette) not in shells:
            shells[id(robot.palette)] = replace(shell, body=shell.body.with_materials(robot.palette.materials))
    where = [terrain for _, terrain in owners]
    scenes = Scenes.of([shells[id(robot.palette)] for robot, _ in owners], where)
    regions, places = np.arange(solid.count), np.arange(SEGMENTS) / SEGMENTS

    def swing(points: Any) -> Any:
        """What the cycle adds to the sizes, shape (N, 3 count, 16); with the bits of a ``Drive``."""
        amplitude, phase = of_each(owners, lambda case, own: case[0].waves(solid, own), points)
        wave = amplitude[..., None] * np.sin(2 * np.pi * (places + phase[..., None]))
        return np.tile((REST + wave) - REST, (1, 3, 1))

    swung, pull_back = trace(swing, points) if trial.gradients else (swing(points), None)
    every_body, cycle = [robot.body for robot in scenes.robots], cases.first.cycle_on(where[0])
    aim, every = replace(_aim(cases.first, where, True), placed=scenes.first.placed), trial.record_every
    rollout = Rollout(every_body, _sizes(regions), swung, cycle, where, aim, trial.compute, every, scenes.starts)
    if pull_back is None:
        return result_of(rollout, rollout.run(trial.progress), {})
    moved = rollout.differentiate(trial.gradients, MEMORY, trial.progress)
    return result_of(rollout, moved, {name: pull_back(each.swing)[0] for name, each in moved.slopes.items()})


def _between(cases: Cases, points: Floats) -> LatticeRobotResult:
    """Simulate mixtures of tissues and of nothing at N points in each of W cases: W N results."""
    count, parts = len(points), []
    for each, told in cases.parts(np.arange(count * len(cases.robots)), 0, 1):
        parts.append((each, _mixed(told, points[each % count], each // count)))
    return _assembled(cases, parts, np.full(count, ""), points.shape[1])


def _mixed(cases: Cases, points: Floats, which: Ints) -> LatticeRobotResult:
    """What mixtures do: that of each point, shape (N, P), in one of the cases, shape (N,)."""
    robot, trial, grid = cases.first, cases.trial, cases.first.grid
    terrains = [cases.terrains[case] for case in which.tolist()]

    def mixture(case: Case, points: Any) -> tuple[Any, ...]:
        return _mixture(*case, points, trial.sharpness)

    owners = cases.of(which)
    (swung, driven, *values), pull_back = trace(partial(of_each, owners, mixture), points)
    numbers, each = dict(zip(MIXED, values, strict=True)), np.arange(grid.count)
    plain = LatticeBody(
        grid.places, robot.palette.materials[:1] * grid.count, each, grid.voxel_size, each, links=robot.links
    )
    rows = ({name: found[row] for name, found in numbers.items()} for row in range(len(points)))
    bodies = [robot.palette.body(plain, row) for row in rows]
    rollout = Rollout(
        bodies,
        _sizes(each),
        swung,
        robot.cycle_on(terrains[0]),
        terrains,
        _aim(robot, terrains, False),
        trial.compute,
        trial.record_every,
        None,
        driven,
    )
    if not trial.gradients:
        return result_of(rollout, rollout.run(trial.progress), {})
    moved, gradients = rollout.differentiate(trial.gradients, MEMORY, trial.progress), {}
    for name, slopes in moved.slopes.items():
        by = (slopes.materials[field] for field in MIXED)
        gradients[name] = pull_back(slopes.swing, slopes.driven, *by)[0]
    return result_of(rollout, moved, gradients)


def _aim(robot: "FreeformRobot", terrains: Sequence[Terrain], is_solid: bool) -> Aim:
    """What motions on terrains are measured by: each light is what should be come near, where the robot has no target.

    It travels along x, so that ahead and to the left are x and y. A light lies from the middle of the voxels of a robot
    that can be built; of a mixture, whose cells count as much as they are there, from its centre of mass.
    """
    lights = [terrain.light for terrain in terrains]
    if robot.target is not None or None in lights:
        return robot.aim
    return replace(robot.aim, target=np.array(lights), is_light=is_solid)


def _mixture(robot: "FreeformRobot", terrain: Terrain, points: Any, sharpness: float) -> tuple[Any, ...]:
    """Swing of the sizes of mixtures, how much each cell is driven, and the numbers of the materials."""
    fields, palette = robot.parametrisation(points), robot.palette
    weights = chosen(fields.tissue, CHOICE * (1.0 + sharpness))
    muscle = (weights * palette.muscles).sum(axis=2)
    swing = fields.swing * (muscle * robot.actuation.amplitude)[..., None]
    if robot.gains:
        swing = swing * _factors(robot, fields)[..., None]
        length = np.sqrt((swing * swing).sum(axis=-1, keepdims=True) + RESOLUTION**2)
        swing = swing / np.maximum(length / robot.gains.limit, 1.0)
    moved = (swing[..., None, :] * WAVE).sum(axis=3)
    numbers = palette.mixtures(projected(fields.presence, sharpness), weights)
    given = material_friction(terrain, taken=WITHOUT_PROPS)  # as mixtures meet no props
    numbers |= {name: 0.0 * muscle + friction for name, friction in given.items()}
    return np.tile(moved, (1, 3, 1)), muscle, *(numbers[name] for name in MIXED)


def _factors(robot: "FreeformRobot", fields: Fields) -> Floats:
    """Factor of the amplitude of each cell of mixtures, shape (V,), or (N, V) where cells share channels.

    Cells have the factors of the channels that would drive them in the robot that can be built.
    """
    assert robot.gains is not None
    factors = np.array(robot.gains.factors)
    if robot.actuation.channels is None:
        return factors
    plain = Fields(*(value_of(each) for each in (fields.presence, fields.tissue, fields.swing)))
    rows = (channels_of_cells(robot.solid_at(plain, row), swing) for row, swing in enumerate(plain.swing))
    return factors[np.stack(list(rows))]


def _sizes(regions: NDArray[Any]) -> Channels:
    """The channels of regions whose voxels swell alike along all axes."""
    axes = [Quantity.SCALE + axis for axis in range(3)]
    return Channels(np.tile(regions, 3), np.repeat(axes, len(regions)), np.full(3 * len(regions), REST))


def projected(presence: Any, sharpness: float) -> Any:
    """Presence pushed towards 0 and 1, the more the sharper; a half stays one.

    Source: Wang, Lazarov & Sigmund, Struct. Multidisc. Optim. 43, 2011, eq. 9.
    """
    if sharpness == 0:
        return presence
    scale = 2 * math.tanh(sharpness / 2)
    return 0.5 + np.tanh(sharpness * (presence - 0.5)) / scale


def chosen(weights: Any, sharpness: float) -> Any:
    """Parts of tissues, which add up to 1, of their weights, shape (..., T): all of the heaviest, if sharp enough."""
    raised = np.exp(sharpness * (weights - value_of(weights).max(axis=-1, keepdims=True)))
    return raised / raised.sum(axis=-1, keepdims=True)
