"""The robots of a batch, each in its world: variants of one robot that differ in little enough share one."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from robots.batches import batch_key, grouped, of_each
from robots.world import MATERIAL_FRICTION, Terrain
from taichi_sim.base.arrays import Floats, Ints

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

_SMOOTH = dict.fromkeys(MATERIAL_FRICTION, 0.0)
_OWN = "body", "drives", "moduli", "seed", "name", "own_measures"  # fields looked at by parts, or not at all


@dataclass(frozen=True, eq=False)
class Scenes:
    """Which robot each of N robots of a batch is, and where it moves.

    Attributes:
        robots: each as it is on its terrain; those of one of the groups of :func:`sharing`.
        terrains: of each.
        lights: where the light of each is, from where its centre starts [m], shape (N, 2); None without lights.
        aimed: whether its light is what each should come near.
    """

    robots: "tuple[LatticeRobot, ...]"
    terrains: tuple[Terrain, ...]
    lights: Floats | None
    aimed: bool

    @classmethod
    def of(cls, robots: "Sequence[LatticeRobot]", terrains: Sequence[Terrain]) -> Self:
        """The scenes of robots, each on its terrain; of the same one on the same terrain they keep one."""
        pairs = list(zip(robots, terrains, strict=True))
        places = [robot.light_in(terrain) for robot, terrain in pairs]
        lights = None if not places or None in places else np.array(places, float)
        distinct = {(id(robot), id(terrain)): (robot, terrain) for robot, terrain in pairs}
        there = {which: robot.on(terrain) for which, (robot, terrain) in distinct.items()}
        every = tuple(there[id(robot), id(terrain)] for robot, terrain in pairs)
        return cls(every, tuple(terrains), lights, lights is not None and robots[0].target is None)

    def rows(self, which: Ints) -> "Scenes":
        """The scenes of some of the robots."""
        lights = None if self.lights is None else self.lights[which]
        numbers = which.tolist()
        robots, terrains = (tuple(each[n] for n in numbers) for each in (self.robots, self.terrains))
        return Scenes(robots, terrains, lights, self.aimed)

    @property
    def first(self) -> "LatticeRobot":
        """The first robot, for what all of them share."""
        return self.robots[0]

    @property
    def starts(self) -> Floats | None:
        """Voxel centres at the start, with noise and among props [m], shape (N, V, 3); None as the body has them."""
        if self.first.starts(1) is None:
            return None
        found: Floats = of_each(self.robots, lambda robot, rows: robot.starts(len(rows)), self.robots)
        return found


def sharing(robots: "Sequence[LatticeRobot]", terrains: Sequence[Terrain]) -> list[list[int]]:
    """Numbers of the robots on their terrains that can share a batch, group by group.

    Robots agree in all but the friction of their materials, the gains of their drives and the seed of the noise where
    they start; terrains in all but slope, ground, light and friction, and in whether there is water and whether the
    ground yields. Level and uneven ground share one: the laws of either give robots on level ground the same bits, in
    about the same time. Among props, friction agrees, too; in water the sizes that gains reach, as they set its steps.
    """
    distinct = {id(robot): robot for robot in robots}
    known = {number: _shared(robot) for number, robot in distinct.items()} if len(distinct) > 1 else {}
    pairs = zip(robots, terrains, strict=True)
    return grouped(
        (
            known.get(id(robot)),
            robot.size_range if terrain.is_wet else None,
            robot.light_in(terrain) is None,
            batch_key(terrain, robot.body.materials),
        )
        for robot, terrain in pairs
    )


def _shared(robot: "LatticeRobot") -> Hashable:
    """All that robots must have in common to share a batch, as a key to compare."""
    body = robot.body
    materials = tuple(replace(material, **_SMOOTH) for material in body.materials)  # type: ignore[arg-type]
    drives = tuple(replace(drive, gains=None) for drive in robot.drives)
    lattice = tuple(np.asarray(getattr(body, each.name)).tobytes() for each in fields(body) if each.name != "materials")
    settings = tuple(getattr(robot, each.name) for each in fields(robot) if each.name not in _OWN)
    noise = None if robot.reflexes is None else robot.seed  # that of senses is one for all
    return materials, drives, lattice, tuple(robot.free_moduli.items()), settings, robot.cycle.time_step, noise
