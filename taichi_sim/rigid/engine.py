"""``RigidEngine``: batches of articulated robots on ground."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Unpack

import numpy as np

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import numbers
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.ground.relief import GroundTables, Relief, ground_tables
from taichi_sim.rigid import slots
from taichi_sim.rigid.feedback import Feedback, roll
from taichi_sim.rigid.gradient import RigidTape
from taichi_sim.rigid.model.settings import Network, Physics
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.run import Run
from taichi_sim.rigid.session import RigidSession
from taichi_sim.rigid.stages.friction import ENDLESS
from taichi_sim.rigid.state import RigidResult, State
from taichi_sim.rigid.tables import (
    Ints,
    Senses,
    eyes_of,
    parameters_of,
    patches_of,
    plan_of,
    points_of,
    portions_of,
    sand_of,
    water_of,
)

BLOCKS_AT_ONCE = 32  # a thread: so many that threads rarely wait for each other
ROBOTS_AT_ONCE = 1 << 15  # on a GPU
COMPLIANCE = {"f64": 2e-9, "f32": 2e-6}  # s/kg, of normals: decides between equal solutions
TOLERANCE = {"f64": 1e-12, "f32": 1e-7}
ROUNDINGS = 300  # of a diagonal entry [1/kg]: least compliance; with 30, rounding leaves some robots unsolved
VISCOUS_PHASES, COULOMB_PHASES = 2, 8  # solutions of a step; Coulomb's cone is found by repetition
FAR_AWAY = [[1e9, 0.0, 0.0]]  # a light that is nowhere
NEAREST_LIGHT = 1e-6  # m


class RigidEngine:
    """Simulator of a batch of articulated robots that share a structure and may differ in all else.

    Args:
        trees: one tree for all robots, or one for each robot.
        world: ground, gravity and time.
        senses: sensors of the robots.
        network: how neurons turn readings of the sensors into commands.
        ground: uneven ground instead of the plane z = 0, one for all robots, or one for each robot, maybe with water
            or sand; only with a coefficient of friction do its factors of friction count, and only there are they
            allowed.
        width: robots side by side on a CPU, 1, 2, 4, 8, 16 or 32; results do not depend on it.
        **compute: precision (default ``"f64"``), device and threads, as of :class:`Compute`.

    Raises:
        ValueError: for trees of different structure or anything else that is not allowed.
    """

    def __init__(
        self,
        trees: Tree | Sequence[Tree],
        world: Physics | None = None,
        senses: Senses | None = None,
        network: Network | None = None,
        *,
        ground: Relief | Sequence[Relief] | None = None,
        width: int | None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        self.trees = [trees] if isinstance(trees, Tree) else list(trees)
        if not self.trees:
            raise ValueError("trees: an empty list is not allowed; give at least one tree")
        self.world, self.senses, self.network = world or Physics(), senses or Senses(), network or Network()
        self.compute, self.width = Compute.given(compute), width
        self._reliefs = [] if ground is None else [ground] if isinstance(ground, Relief) else list(ground)
        self._ground = None if ground is None else self._tables()
        self._wet = self._ground is not None and self._ground.water
        self._granular = self._ground is not None and self._ground.granular
        first = self._plan(self.tree)
        for n, tree in enumerate(self.trees[1:], 1):
            if tree.fixed != self.tree.fixed or not np.array_equal(first, self._plan(tree)):
                raise ValueError(f"trees: number {n} has another structure than the first; give trees of one structure")
        self._numbers = {
            slots.PARAMETER: np.stack([parameters_of(tree) for tree in self.trees]),
            slots.POINT_PARAMETER: np.stack([points_of(tree) for tree in self.trees]),
            slots.LIGHT_PARAMETER: eyes_of(self.senses)[None],
        }
        if self._wet:
            if not self.tree.portions():
                raise ValueError("ground: water would move nothing, as no body has solids; give solids with a mass")
            drag = self.world.pressure_drag, self.world.friction_drag
            self._numbers[slots.WATER] = np.stack([water_of(relief, self.world.gravity) for relief in self._reliefs])
            self._numbers[slots.PORTION] = np.stack([portions_of(tree, *drag) for tree in self.trees])

        if self._granular:
            self._numbers[slots.SAND] = np.stack([sand_of(relief) for relief in self._reliefs])
            self._numbers[slots.PATCH] = np.stack([patches_of(tree) for tree in self.trees])

    def _plan(self, tree: Tree, commands: int = 0) -> Ints:
        """The plan of a tree's memory."""
        return plan_of(tree, self.senses, commands, wet=self._wet, granular=self._granular)

    @property
    def tree(self) -> Tree:
        """Tree of the first robot, whose structure all robots share."""
        return self.trees[0]

    def _tables(self) -> GroundTables:
        """Tables of uneven ground."""
        if not self._reliefs:
            raise ValueError("ground: an empty list is not allowed; give at least one relief, or None")
        if np.isinf(self.world.friction) and any(relief.friction is not None for relief in self._reliefs):
            raise ValueError("ground: factors of friction are not allowed with infinite friction; give a coefficient")
        if any(self.world.gravity_across) and any(relief.water is not None for relief in self._reliefs):
            raise ValueError(
                "gravity_across: not allowed with water, whose surface is level; give gravity along z alone"
            )
        return ground_tables("ground", self._reliefs)

    def rest(self) -> State:
        """Return the state of all robots at rest, as their trees describe them."""
        count, none = len(self.trees), np.zeros((len(self.trees), len(self.tree.hinges)))
        position = np.array([tree.ordered[0][0].position for tree in self.trees], float)
        return State(position, np.tile([1.0, 0, 0, 0], (count, 1)), none, np.zeros((count, 6)), none)

    def standing(self) -> State:
        """Return the state of all robots at rest on uneven ground, as far above it as their trees are above z = 0.

        Raises:
            ValueError: for another number of trees than of reliefs, both more than one.
        """
        rest, counts = self.rest(), {len(self.trees), max(1, len(self._reliefs))}
        batch = max(counts)
        if counts - {1, batch}:
            raise ValueError(f"ground: {len(self._reliefs)} reliefs for {len(self.trees)} trees; give one, or one each")
        names = [each.name for each in fields(rest)]
        every = {name: np.resize(values := getattr(rest, name), (batch, values.shape[1])) for name in names}
        for n, relief in enumerate(self._reliefs * (batch // max(1, len(self._reliefs)))):
            centres, radii = self.trees[n % len(self.trees)].balls()
            every["position"][n, 2] += relief.rise_of_balls(centres, radii) - (radii - centres[:, 2]).max()
        return State(**every)

    @runtime.exclusive
    def run(
        self,
        steps: int,
        *,
        weights: Floats | None = None,
        commands: Floats | None = None,
        hold: int = 1,
        lights: Floats | None = None,
        start: State | None = None,
        record_every: int | None = None,
        feedback: Feedback | None = None,
    ) -> RigidResult:
        """Simulate all robots with controllers or commands.

        Args:
            steps: number of time steps.
            weights: weights of the controllers, (B, S, M); sensors in the order of ``senses``.
            commands: instead of weights, commands to all motors over time, (B, K, M), each kept for ``hold`` steps, the
                last one to the end.
            hold: steps that a command is kept.
            lights: place of each robot's light, (B, 3) [m]; far away if None.
            start: where robots start; at rest, as their trees describe them, if None.
            record_every: record every so many steps; nothing if None.
            feedback: decides commands as they are due, instead of those that are given, from what robots feel.

        Raises:
            ValueError: for arrays of other shapes or numbers that are not allowed.
        """
        run = self._start(steps, weights, commands, hold, lights, start, record_every)
        rolled = roll(run, _decided(feedback, commands), recording=record_every is not None)
        found = [(each.recorded(), each.part.state()) for each in rolled]
        frames, memory = (np.concatenate(each, -1) for each in zip(*found, strict=True))
        return run.result(memory, None if record_every is None else frames)

    @runtime.exclusive
    def record(
        self,
        steps: int,
        *,
        weights: Floats | None = None,
        commands: Floats | None = None,
        hold: int = 1,
        lights: Floats | None = None,
        start: State | None = None,
        feedback: Feedback | None = None,
    ) -> RigidTape:
        """Simulate, and keep all states, so that ``RigidTape.pull_back`` can give derivatives: about a megabyte for
        1,000 steps of a quadruped in f32.

        Args:
            steps: as of ``run``, like all others.
            weights: of the controllers.
            commands: instead of these.
            hold: steps that a command is kept.
            lights: place of each robot's light.
            start: where robots start.
            feedback: decides commands; derivatives go through it, too.

        Raises:
            ValueError: for what is not allowed, and Coulomb friction, whose cone has no derivative here.
        """
        if np.isfinite(self.world.friction):
            raise ValueError(f"friction: {self.world.friction!r} has no derivatives; give inf")
        run = self._start(steps, weights, commands, hold, lights, start)
        return RigidTape(run, _decided(feedback, commands))

    @runtime.exclusive
    def session(self, *, batch: int = 1, lights: Floats | None = None, start: State | None = None) -> RigidSession:
        """Start robots that are given their commands as they go, see ``RigidSession.advance``.

        Args:
            batch: number of robots, if nothing else tells.
            lights: as of ``run``.
            start: as of ``run``.

        Raises:
            ValueError: for arrays of other shapes or numbers that are not allowed.
        """
        commands = np.zeros((batch, 1, self.tree.motors))
        return RigidSession(self._start(1, None, commands, 1, lights, start))

    def _start(
        self,
        steps: int,
        weights: Floats | None,
        commands: Floats | None,
        hold: int,
        lights: Floats | None,
        start: State | None,
        record_every: int | None = None,
    ) -> Run:
        """Check what a run is given, and start Taichi."""
        checks.integer("steps", steps, 0)
        checks.integer("hold", hold, 1)
        every = max(1, steps) if record_every is None else checks.integer("record_every", record_every, 1)
        given = self._given(weights, commands, lights, start or self.rest())
        threads = runtime.start(self.compute).thread_count
        plan = self._plan(self.tree, given["commands"].shape[1])
        plan[[slots.HOLD, slots.STEPS, slots.EVERY, slots.FRAMES]] = hold, steps, every, steps // every + 1
        plan[slots.UNTIL] = steps
        plan[slots.PHASES] = VISCOUS_PHASES if np.isinf(self.world.friction) else COULOMB_PHASES
        on_cpu, precision = self.compute.device == "cpu", self.compute.precision
        width = NATIVE_WIDTH[precision] if self.width is None else self.width
        real = Real(precision, width if on_cpu else 1)
        at_once = real.width * BLOCKS_AT_ONCE * threads if on_cpu else ROBOTS_AT_ONCE
        settings = self._settings(real)
        described = start is None
        run = Run(self.trees, self.world, given, self._numbers, settings, plan, real, self.compute, at_once, described)
        return replace(run, ground=self._ground)

    def _given(
        self, weights: Floats | None, commands: Floats | None, lights: Floats | None, start: State
    ) -> dict[str, Floats]:
        """Check the arrays of a run, and return them by name."""
        motors, hinges, sensors = self.tree.motors, len(self.tree.hinges), self.senses.count
        if weights is not None and commands is not None:
            raise ValueError("commands: not allowed beside weights; give one of them")
        if commands is not None and np.ndim(commands) == 3 and np.shape(commands)[1] == 0:
            raise ValueError("commands: none over time are not allowed; give at least one")
        found = {"weights": np.zeros((1, 0, 0)), "commands": np.zeros((1, 1 if weights is None else 0, motors))}
        if weights is not None:
            found["weights"] = numbers("weights", weights, "B", sensors, motors)
        elif commands is not None:
            found["commands"] = numbers("commands", commands, "B", "K", motors)
        found["lights"] = numbers("lights", FAR_AWAY if lights is None else lights, "B", 3)
        shapes = {"position": 3, "orientation": 4, "angles": hinges, "velocity": 6, "rates": hinges}
        found |= {name: numbers(name, getattr(start, name), "B", size) for name, size in shapes.items()}
        rows = {**{name: len(values) for name, values in found.items()}, "trees": len(self.trees)}
        rows["ground"] = 1 if self._ground is None else len(self._ground.grid)
        batch = max(rows.values())
        for name, count in rows.items():
            if count not in (1, batch):
                raise ValueError(f"{name}: {count} rows are not allowed; give one, or {batch} as others have")
        if not np.allclose(np.linalg.norm(found["orientation"], axis=1), 1, atol=1e-6):
            raise ValueError("orientation: not allowed; give unit quaternions (w, x, y, z)")
        if np.linalg.norm(found["lights"] - found["position"], axis=1).min() < NEAREST_LIGHT:
            raise ValueError("lights: a light on the robot is not allowed; give a place away from its start")
        return found

    def _settings(self, real: Real) -> np.ndarray:
        """Numbers that all robots of a run share, in the order of their places in ``slots``."""
        world, network, scalar = self.world, self.network, real.numpy
        push_out = scalar(world.error_reduction) / scalar(world.time_step)
        least = 0.0 if world.integration == "velocity" else ROUNDINGS * np.finfo(scalar).eps  # none in the studies'
        ground = push_out, min(world.friction, ENDLESS), COMPLIANCE[real.precision], least
        neurons = network.memory, network.gain, *network.touch_values
        rest = 0 if self.tree.fixed else 1, TOLERANCE[real.precision]
        return np.array([world.time_step, *ground, *neurons, *rest, *world.gravity_across, world.gravity], scalar)


def _decided(feedback: Feedback | None, commands: Floats | None) -> Feedback | None:
    """Feedback, which needs commands to replace."""
    if feedback is not None and commands is None:
        raise ValueError("feedback: not allowed without commands; give those that it replaces")
    return feedback
