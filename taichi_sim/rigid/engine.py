"""``RigidEngine``: batches of articulated robots on flat ground."""

from collections.abc import Sequence
from typing import Unpack

import numpy as np

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.rigid import batch, slots
from taichi_sim.rigid.gradient import RigidTape
from taichi_sim.rigid.model.settings import Network, World
from taichi_sim.rigid.model.shapes import is_whole
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.part import Part, Setup
from taichi_sim.rigid.session import RigidSession
from taichi_sim.rigid.stages.friction import ENDLESS
from taichi_sim.rigid.state import Frames, RigidResult, State
from taichi_sim.rigid.tables import Senses, eyes_of, parameters_of, points_of, tables_of

BLOCKS_AT_ONCE = 32  # a thread: so many that threads rarely wait for each other
ROBOTS_AT_ONCE = 1 << 15  # on a GPU
COMPLIANCE = {"f64": 2e-9, "f32": 2e-6}  # s/kg, of normals: decides between equal solutions
TOLERANCE = {"f64": 1e-12, "f32": 1e-7}


class RigidEngine:
    """Simulates robots that share a structure and differ in everything else.

    Args:
        trees: one tree for all robots, or one for each robot.
        world: ground, gravity and time.
        senses: what they sense.
        network: how neurons turn that into commands.
        width: robots side by side on a CPU, 1, 2, 4, 8, 16 or 32; results do not depend on it.
        **compute: precision (default ``"f64"``), device and threads, as of :class:`Compute`.

    Raises:
        ValueError: for trees of different structure or anything else that is not allowed.
    """

    def __init__(
        self,
        trees: Tree | Sequence[Tree],
        world: World | None = None,
        senses: Senses | None = None,
        network: Network | None = None,
        *,
        width: int | None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        self.trees = [trees] if isinstance(trees, Tree) else list(trees)
        if not self.trees:
            raise ValueError("trees: an empty list is not allowed; give at least one tree")
        self.world, self.senses, self.network = world or World(), senses or Senses(), network or Network()
        self.compute, self.width = Compute.given(compute), width
        first = tables_of(self.trees[0], self.senses, 0)
        for n, tree in enumerate(self.trees[1:], 1):
            if tree.fixed != self.tree.fixed or not first.same_structure(tables_of(tree, self.senses, 0)):
                raise ValueError(f"trees: number {n} has another structure than the first; give trees of one structure")
        self._parameters = np.stack([parameters_of(tree) for tree in self.trees])
        self._points = np.stack([points_of(tree) for tree in self.trees])

    @property
    def tree(self) -> Tree:
        """The first tree, whose structure all have."""
        return self.trees[0]

    def rest(self) -> State:
        """All robots as their trees describe them, at rest."""
        count, hinges = len(self.trees), len(self.tree.hinges)
        position = np.array([tree.ordered[0][0].position for tree in self.trees], float)
        return State(
            position,
            np.tile([1.0, 0, 0, 0], (count, 1)),
            np.zeros((count, hinges)),
            np.zeros((count, 6)),
            np.zeros((count, hinges)),
        )

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
    ) -> RigidResult:
        """Simulate.

        Args:
            steps: time steps.
            weights: of the controllers, (B, S, M); sensors in the order of ``senses``.
            commands: instead of these, commands to all motors over time, (B, K, M), each kept for ``hold`` steps, the
                last one to the end.
            hold: steps that a command is kept.
            lights: place of each robot's light, (B, 3) [m]; far away if None.
            start: where robots start; at rest, as their trees describe them, if None.
            record_every: record every so many steps; nothing if None.

        Raises:
            ValueError: for arrays of other shapes or numbers that are not allowed.
        """
        setup = self._setup(steps, weights, commands, hold, lights, start, record_every)
        found = []
        for chosen in setup.chunks():
            part = self._part(setup, chosen)
            frames = part.run(recording=record_every is not None)
            found.append((part.memory.read()[:, : len(chosen)], frames[:, : len(chosen)]))
        memories, frames = (np.concatenate(each, -1) for each in zip(*found, strict=True))
        return self._result(memories, frames, setup, record_every)

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

        Raises:
            ValueError: for what is not allowed, and Coulomb friction, whose cone has no derivative here.
        """
        if np.isfinite(self.world.friction):
            raise ValueError(f"friction: {self.world.friction!r} has no derivatives; give infinity, viscous slip alone")
        setup = self._setup(steps, weights, commands, hold, lights, start, None)
        parts, memories = [], []
        for chosen in setup.chunks():
            part = self._part(setup, chosen)
            tape = part.store(int(setup.plan[slots.KEPT]) * (steps + 1))
            part.run(tape=tape)
            parts.append((part, tape, len(chosen)))
            memories.append(part.memory.read()[:, : len(chosen)])
        return RigidTape(self._result(np.concatenate(memories, -1), np.empty((0, 0)), setup, None), setup, parts)

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
        setup = self._setup(1, None, commands, 1, lights, start, None)
        parts = [(self._part(setup, chosen), chosen) for chosen in setup.chunks()]
        return RigidSession(setup, parts, lambda found: self._result(found, np.empty((0, 0)), setup, None))

    def _setup(
        self,
        steps: int,
        weights: Floats | None,
        commands: Floats | None,
        hold: int,
        lights: Floats | None,
        start: State | None,
        record_every: int | None,
    ) -> Setup:
        """Check what a run is given, and start Taichi."""
        if not is_whole(steps) or steps < 0:
            raise ValueError(f"steps: {steps!r} is not allowed; give a whole number, at least 0")
        for name, value in (("record_every", record_every), ("hold", hold)):
            if value is not None and (not is_whole(value) or value < 1):
                raise ValueError(f"{name}: {value!r} is not allowed; give a whole number, at least 1")
        given = batch.check(self.trees, self.senses.count, weights, commands, lights, start or self.rest())
        threads = runtime.start(self.compute).thread_count
        tables = tables_of(self.tree, self.senses, given.commands.shape[1])
        plan = tables.counts.plan(hold, steps, record_every or max(1, steps))
        on_cpu, precision = self.compute.device == "cpu", self.compute.precision
        width = NATIVE_WIDTH[precision] if self.width is None else self.width
        real = Real(precision, width if on_cpu else 1)
        at_once = real.width * BLOCKS_AT_ONCE * threads if on_cpu else ROBOTS_AT_ONCE
        return Setup(self.trees, given, tables, plan, self.compute, real, start is None, at_once)

    def _part(self, setup: Setup, chosen: Ints) -> Part:
        """Some robots, ready to start; the last real is filled up with the first robots again."""
        real, blocks = setup.real, -(-len(chosen) // setup.real.width)
        padded = np.resize(chosen, blocks * real.width)
        sections = {
            slots.PARAMETER: self._parameters,
            slots.POINT_PARAMETER: self._points,
            slots.LIGHT_PARAMETER: eyes_of(self.senses)[None],
        }
        several = len(self.trees) > 1
        numbers = {key: values[padded] if len(values) > 1 else values for key, values in sections.items()}
        trees = [self.trees[n] for n in padded] if several else self.trees
        part = Part(setup, blocks, self._settings(real), self.world)
        filled = np.zeros((int(setup.plan[slots.SLOTS]), len(padded)))
        batch.fill(filled, setup.plan, setup.given.rows(padded), trees, numbers, self.world.integration == "momentum")
        part.memory.write(filled)
        return part

    def _settings(self, real: Real) -> np.ndarray:
        """Numbers that all robots of a run share, by their places in ``slots``."""
        world, network = self.world, self.network
        found: np.ndarray = np.zeros(slots.SETTINGS, real.numpy)
        for place, value in {
            slots.TIME_STEP: world.time_step,
            slots.GRAVITY: world.gravity,
            slots.SLIP_STRENGTH: world.time_step / world.slip,
            slots.FRICTION: min(world.friction, ENDLESS),
            slots.COMPLIANCE: COMPLIANCE[real.precision],
            slots.TOLERANCE: TOLERANCE[real.precision],
            slots.MEMORY: network.memory,
            slots.GAIN: network.gain,
            slots.APART: network.touch_values[0],
            slots.TOUCHING: network.touch_values[1],
            slots.FLOATING: 0 if self.tree.fixed else 1,
        }.items():
            found[place] = value
        found[slots.PUSH_OUT] = real.numpy(world.error_reduction) / found[slots.TIME_STEP]
        return found

    def _result(self, found: np.ndarray, frames: np.ndarray, setup: Setup, record_every: int | None) -> RigidResult:
        """Arrays of a result from memory after a run."""
        plan, counts, tree = setup.plan, setup.tables.counts, self.tree
        diverged = found[slots.DIVERGED] >= 0
        found = np.where(diverged & (np.arange(len(found)) != slots.DIVERGED)[:, None], np.nan, found)
        bodies = plan[slots.BODY] + slots.BODY_WIDTH * np.arange(counts.bodies)
        angles = found[[bodies[n] + slots.ANGLE for n in tree.hinged]].T.reshape(found.shape[1], -1)
        sensors = counts.touches + counts.lights
        steps = np.where(diverged, found[slots.DIVERGED], plan[slots.STEPS]).astype(np.int64)
        recorded: Frames | None = None
        if record_every is not None:
            each = frames.reshape(int(plan[slots.FRAMES]), int(plan[slots.FRAME]), -1).transpose(0, 2, 1)
            times: Floats = np.arange(len(each), dtype=float) * record_every * self.world.time_step
            ends = np.cumsum([3, 4, counts.hinges, sensors])
            recorded = Frames(times, *np.split(each, ends, axis=-1))
        return RigidResult(
            position=found[slots.POSITION : slots.POSITION + 3].T,
            orientation=found[slots.ORIENTATION : slots.ORIENTATION + 4].T,
            angles=angles,
            velocities=np.stack([found[b + slots.MOVING : b + slots.MOVING + 6].T for b in bodies], 1),
            readings=found[plan[slots.READING] : plan[slots.READING] + sensors].T,
            closest=np.sqrt(found[slots.CLOSEST]),
            status=np.where(diverged, "diverged", "ok"),
            steps=steps,
            residual=found[slots.RESIDUAL],
            frames=recorded,
        )
