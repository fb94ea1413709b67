"""Derivatives of what a run comes to by all that it was given.

Contacts, joints at their stops and motors at their limits act as they did in the run; where they begin or end to, the
motion has kinks and jumps, which derivatives do not see.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichi_sim import runtime
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import slots
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.state import RigidResult
from taichi_sim.rigid.tables import parameters_of, points_of

if TYPE_CHECKING:
    from taichi_sim.rigid.memory import Store
    from taichi_sim.rigid.part import Part, Setup

_SHIFT = 1e-5  # part of a number by which descriptions are shifted; they are polynomials of low degree


@dataclass(frozen=True, eq=False)
class RigidGradient:
    """Cotangents: derivatives of a cost by what a run was given.

    Attributes:
        weights: of controllers, (B, S, M).
        commands: (B, K, M).
        lights: places of the light, (B, 3) [1/m].
        masses: of bodies in the tree's order, (B, bodies) [1/kg].
        parameters: of bodies, (B, bodies, P), as ``tables.parameters_of`` orders them.
        points: of points that touch the ground, (B, points, 4): centre and radius.
        position: of the base at the start, (B, 3) [1/m].
        orientation: of the base at the start, (B, 4).
        angles: at the start, (B, H) [1/rad].
        places: of bodies on their own at the start, (B, bodies, 3) [1/m]; zero unless they may drift.
        carried: velocities, or momenta, of bodies at the start, (B, bodies, 6); all other derivatives hold them fixed.
        described: whether robots started as their trees describe them.
    """

    weights: Floats
    commands: Floats
    lights: Floats
    masses: Floats
    parameters: Floats
    points: Floats
    position: Floats
    orientation: Floats
    angles: Floats
    places: Floats
    carried: Floats
    described: bool

    def by_design(self, tree_of: Callable[[float], Tree], value: float) -> Floats:
        """Derivatives by a number that robots are described by, (B,): of each robot, if its tree is that of the number.

        Args:
            tree_of: the tree that the number gives.
            value: the number.

        Raises:
            ValueError: for a run with a ``start``, which would have to follow the number.
        """
        if not self.described:
            raise ValueError("start: derivatives by a design are those of robots that start as described; give None")
        shift = _SHIFT * max(abs(value), 1e-3)
        lower, upper = (_numbers(tree_of(value + side * shift)) for side in (-1, 1))
        slopes = [(high - low) / (2 * shift) for low, high in zip(lower, upper, strict=True)]
        mine = (self.parameters, self.points, self.places, self.position)
        found = [(x * slope).reshape(len(x), -1).sum(1) for x, slope in zip(mine, slopes, strict=True)]
        return np.asarray(sum(found), float)


def _numbers(tree: Tree) -> tuple[Floats, ...]:
    places = np.array([body.position for body, _ in tree.ordered], float)
    return parameters_of(tree), points_of(tree), places, places[0]


class RigidTape:
    """A run that can be reversed.

    Attributes:
        result: what it came to.
    """

    def __init__(self, result: RigidResult, setup: "Setup", parts: "Sequence[tuple[Part, Store, int]]") -> None:
        """Keep the memory of a run."""
        self.result, self._setup, self._parts = result, setup, parts

    @runtime.exclusive
    def pull_back(
        self,
        *,
        position: Floats | None = None,
        orientation: Floats | None = None,
        readings: Floats | None = None,
        angles: Floats | None = None,
    ) -> RigidGradient:
        """Derivatives of a cost by what the run was given, from those by what it came to; NaN of diverged robots.

        Args:
            position: derivatives by the base's place at the end, (B, 3).
            orientation: by its orientation, (B, 4).
            readings: by the sensors' last readings, (B, S); those of touch sensors have none.
            angles: by the hinges' angles at the end, (B, H).

        Raises:
            ValueError: for other shapes.
        """
        plan, tree, batch = self._setup.plan, self._setup.trees[0], self._setup.given.batch
        counts = self._setup.tables.counts
        sensors = counts.touches + counts.lights
        body_slots = plan[slots.BODY] + slots.BODY_WIDTH * np.arange(counts.bodies)
        seeds = np.zeros((int(plan[slots.SLOTS]), batch))
        for name, value, places in (
            ("position", position, slots.POSITION + np.arange(3)),
            ("orientation", orientation, slots.ORIENTATION + np.arange(4)),
            ("readings", readings, plan[slots.READING] + np.arange(sensors)),
            ("angles", angles, body_slots[tree.hinged] + slots.ANGLE),
        ):
            if value is not None:
                if np.shape(value) != (batch, len(places)):
                    raise ValueError(f"{name}: shape {np.shape(value)} is not allowed; give ({batch}, {len(places)})")
                seeds[places] = np.asarray(value, float).T
        found = self._go_back(seeds)
        found[:, self.result.status != "ok"] = np.nan
        return self._gradient(found)

    def _go_back(self, seeds: Floats) -> Floats:
        """Cotangents of all slots, (slots, B)."""
        runtime.start(self._setup.compute)
        found, first = [], 0
        for part, tape, count in self._parts:
            cotangents = part.store(len(seeds))
            mine = np.zeros((len(seeds), part.blocks * part.real.width))
            mine[:, :count] = seeds[:, first : first + count]
            cotangents.write(mine)
            part.go_back(tape, cotangents)
            found.append(cotangents.read()[:, :count])
            first += count
        return np.concatenate(found, -1)

    def _gradient(self, found: Floats) -> RigidGradient:
        """Cotangents of slots by their meaning."""
        plan, tree, counts = self._setup.plan, self._setup.trees[0], self._setup.tables.counts
        sensors = counts.touches + counts.lights

        def section(first: int, *shape: int) -> Floats:
            return found[first : first + int(np.prod(shape))].T.reshape(found.shape[1], *shape)

        parameters = section(plan[slots.PARAMETER], counts.bodies, slots.PARAMETER_WIDTH)
        bodies = section(plan[slots.BODY], counts.bodies, slots.BODY_WIDTH)
        neural = counts.commands == 0
        return RigidGradient(
            weights=section(plan[slots.WEIGHT], sensors if neural else 0, counts.motors),
            commands=section(plan[slots.COMMAND], counts.commands, counts.motors),
            lights=section(slots.LIGHT, 3),
            masses=parameters[..., slots.MASS],
            parameters=parameters,
            points=section(plan[slots.POINT_PARAMETER], counts.points, slots.POINT_PARAMETER_WIDTH),
            position=section(slots.POSITION, 3),
            orientation=section(slots.ORIENTATION, 4),
            angles=bodies[:, tree.hinged, slots.ANGLE],
            places=bodies[..., slots.OWN : slots.OWN + 3],
            carried=bodies[..., slots.CARRIED : slots.CARRIED + 6],
            described=self._setup.described,
        )
