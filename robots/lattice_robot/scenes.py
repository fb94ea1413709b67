"""Where the robots of a batch move: worlds that differ in ground, slope and light alone share one."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from robots.ground import Ground
from robots.world import Terrain
from taichi_sim.base.arrays import Floats, Ints

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

_OF_EACH = ("slope", "ground", "light")  # what may differ between robots of a batch
_OF_ALL = tuple(each.name for each in fields(Terrain) if each.name not in _OF_EACH)


@dataclass(frozen=True, eq=False)
class Scenes:
    """Where each of N robots of a batch moves.

    Attributes:
        terrains: of each; those of one of the groups of :func:`sharing`.
        lights: where the light of each is, from where its centre starts [m], shape (N, 2); None without lights.
        aimed: whether its light is what each should come near.
    """

    terrains: tuple[Terrain, ...]
    lights: Floats | None
    aimed: bool

    @classmethod
    def of(cls, robot: "LatticeRobot", terrains: Sequence[Terrain]) -> Self:
        """The scenes of robots on terrains."""
        places = [robot.light_in(terrain) for terrain in terrains]
        lights = None if not places or None in places else np.array(places, float)
        return cls(tuple(terrains), lights, lights is not None and robot.target is None)

    def rows(self, which: Ints) -> "Scenes":
        """Those of some of the robots."""
        lights = None if self.lights is None else self.lights[which]
        return Scenes(tuple(self.terrains[n] for n in which.tolist()), lights, self.aimed)


def sharing(robot: "LatticeRobot", terrains: Sequence[Terrain]) -> list[list[int]]:
    """Numbers of the terrains that can share a batch, group by group.

    They agree in all but slope, ground and light, and in whether there is water and whether the ground yields. Level
    and uneven ground share one: the laws of either give robots on level ground the same bits, in about the same time.
    """
    groups: dict[Any, list[int]] = {}
    for number, terrain in enumerate(terrains):
        same = tuple(getattr(terrain, name) for name in _OF_ALL)
        groups.setdefault((same, robot.light_in(terrain) is None, _laws(terrain)), []).append(number)
    return list(groups.values())


def _laws(terrain: Terrain) -> tuple[bool, bool]:
    """Whether there is water on a terrain's ground, and whether it yields."""
    if terrain.ground is None:
        return False, False
    ground = Ground(terrain.ground)
    return ground.water is not None, ground.yield_per_depth is not None
