"""Derivatives of a run's results by everything that it was given.

Contacts, joints at their stops and motors at their limits act as they did in the run; where they begin or end to, the
motion has kinks and jumps, which derivatives do not see.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from taichi_sim import runtime
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import slots
from taichi_sim.rigid.feedback import Feedback, felt_slots, go_back, roll
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.run import Run, bodies_of
from taichi_sim.rigid.tables import parameters_of, patches_of, points_of, portions_of

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
        rates: of rotors and springs at the start, (B, H) [s/rad]; bodies' motion lies in ``carried``.
        places: of bodies on their own at the start, (B, bodies, 3) [1/m]; zero unless they may drift.
        carried: velocities, or momenta, of bodies at the start, (B, bodies, 6); all other derivatives hold them fixed.
        described: whether robots started as their trees describe them.
        portions: of portions in water, (B, portions, 17), as ``tables.portions_of`` orders them.
        patches: of the surface of points on sand, (B, points, 9), as ``tables.patches_of`` orders them.
        drag: coefficients of pressure drag and friction drag; None without water.
        granular: whether there was sand.
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
    rates: Floats
    places: Floats
    carried: Floats
    described: bool
    portions: Floats
    patches: Floats
    drag: tuple[float, float] | None = None
    granular: bool = False

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
        lower, upper = (self._numbers(tree_of(value + side * shift)) for side in (-1, 1))
        slopes = [(high - low) / (2 * shift) for low, high in zip(lower, upper, strict=True)]
        mine = (self.parameters, self.points, self.places, self.position, self.portions, self.patches)
        found = [(x * slope).reshape(len(x), -1).sum(1) for x, slope in zip(mine, slopes, strict=True)]
        return np.asarray(sum(found), float)

    def between_trees(self, lower: Sequence[Tree], upper: Sequence[Tree], moved: Floats) -> Floats:
        """Change of the cost, to first order, from one tree to another of each robot, (B,).

        Args:
            lower: the trees of the B robots, near those that they had.
            upper: as many others.
            moved: how far the base starts from where it starts with the former, (B, 3) [m].
        """
        found = (self.position * moved).sum(1)
        mine = (self.parameters, self.points, self.places, None, self.portions, self.patches)
        for n, trees in enumerate(zip(lower, upper, strict=True)):
            of_lower, of_upper = map(self._numbers, trees)
            for slopes, low, high in zip(mine, of_lower, of_upper, strict=True):
                if slopes is not None:
                    found[n] += (slopes[n] * (high - low)).sum()
            base, base_after = (np.array(tree.ordered[0][0].position, float) for tree in trees)
            beyond = moved[n] - (base_after - base)  # what uneven ground adds: all bodies start as much higher
            found[n] += (self.places[n] * beyond).sum()
        return np.asarray(found, float)

    def _numbers(self, tree: Tree) -> tuple[Floats, ...]:
        places = np.array([body.position for body, _ in tree.ordered], float)
        portions = np.zeros((0, slots.PORTION_WIDTH)) if self.drag is None else portions_of(tree, *self.drag)
        patches = patches_of(tree) if self.granular else np.zeros((0, slots.PATCH_WIDTH))
        return parameters_of(tree), points_of(tree), places, places[0], portions, patches


class RigidTape:
    """A run that can be reversed.

    Attributes:
        result: what it came to.
    """

    def __init__(self, run: Run, feedback: Feedback | None = None) -> None:
        """Simulate, and keep all states."""
        self._run, self._feedback, self._rolled = run, feedback, list(roll(run, feedback, taping=True))
        self.result = run.result(np.concatenate([each.part.state() for each in self._rolled], -1))

    @runtime.exclusive
    def pull_back(
        self,
        *,
        position: Floats | None = None,
        orientation: Floats | None = None,
        readings: Floats | None = None,
        angles: Floats | None = None,
        work: Floats | None = None,
    ) -> RigidGradient:
        """Derivatives of a cost by what the run was given, from those by what it came to; NaN of diverged robots.

        Args:
            position: derivatives by the base's place at the end, (B, 3).
            orientation: by its orientation, (B, 4).
            readings: by the sensors' last readings, (B, S); those of touch sensors have none.
            angles: by the hinges' angles at the end, (B, H).
            work: by the work of all drives, (B,).

        Raises:
            ValueError: for other shapes, and by the work with the studies' integration, which counts none.
        """
        batch, places_of = self._run.batch, {**felt_slots(self._run), "work": np.array([slots.WORK])}
        if work is not None and self._run.world.integration == "velocity":
            raise ValueError("work: integration 'velocity' counts none; take 'momentum'")
        seeds = np.zeros((int(self._run.plan[slots.SLOTS]), batch))
        given = {"position": position, "orientation": orientation, "readings": readings, "angles": angles}
        given["work"] = None if work is None else np.asarray(work, float)[..., None]
        for name, value in given.items():
            places = places_of[name]
            if value is not None:
                if np.shape(value) != (batch, len(places)):
                    raise ValueError(f"{name}: shape {np.shape(value)} is not allowed; give ({batch}, {len(places)})")
                seeds[places] = np.asarray(value, float).T
        runtime.start(self._run.compute)
        found = go_back(self._run, self._rolled, seeds, self._feedback)
        found[:, self.result.status != "ok"] = np.nan
        return self._gradient(found)

    def _gradient(self, found: Floats) -> RigidGradient:
        """Cotangents of slots by their meaning."""
        plan = self._run.plan
        sensors, motors, commands, points = plan[[slots.SENSORS, slots.MOTORS, slots.COMMANDS, slots.POINTS]]

        def section(first: int, *shape: int) -> Floats:
            return found[first : first + int(np.prod(shape))].T.reshape(found.shape[1], *shape)

        parameters = section(plan[slots.PARAMETER], plan[slots.BODIES], slots.PARAMETER_WIDTH)
        if self._run.world.slip is None:  # the strength of friction grows with each kilogram
            of_mass = found[slots.SLIP_STRENGTH] * self._run.world.slip_strength(1.0)
            parameters[:, self._run.moving, slots.MASS] += of_mass[:, None]
        bodies, world = np.moveaxis(bodies_of(found, plan), -1, 0), self._run.world
        return RigidGradient(
            weights=section(plan[slots.WEIGHT], 0 if commands else sensors, motors),
            commands=section(plan[slots.COMMAND], commands, motors),
            lights=section(slots.LIGHT, 3),
            masses=parameters[..., slots.MASS],
            parameters=parameters,
            points=section(plan[slots.POINT_PARAMETER], points, slots.POINT_PARAMETER_WIDTH),
            position=section(slots.POSITION, 3),
            orientation=section(slots.ORIENTATION, 4),
            angles=bodies[:, self._run.trees[0].hinged, slots.ANGLE],
            rates=bodies[:, self._run.trees[0].hinged, slots.LAST_RATE],
            places=bodies[..., slots.OWN : slots.OWN + 3],
            carried=bodies[..., slots.CARRIED : slots.CARRIED + 6],
            described=self._run.described,
            portions=section(plan[slots.PORTION], plan[slots.PORTIONS], slots.PORTION_WIDTH),
            patches=section(plan[slots.PATCH], points * self._run.granular, slots.PATCH_WIDTH),
            granular=self._run.granular,
            drag=(world.pressure_drag, world.friction_drag) if self._run.wet else None,
        )
