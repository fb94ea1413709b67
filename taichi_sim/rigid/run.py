"""A run of a batch: its inputs, the robots' memory part by part, and the results that are read off it."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from taichi_sim.autodiff.lanes import Real
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.compute import Compute
from taichi_sim.ground.relief import GroundTables
from taichi_sim.rigid import slots
from taichi_sim.rigid.kernels import gradient_kernel, rollout_kernel
from taichi_sim.rigid.model.settings import EARTH, Physics
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.pose import momenta, poses, velocities
from taichi_sim.rigid.state import Frames, RigidResult, State
from taichi_sim.runtime import GRAIN
from taichi_sim.store import EVERY, Store

Given = Mapping[str, Floats]
TOUCH_TOLERANCE = {"f64": 1e-12, "f32": 2e-6}  # of a robot's reach: well above what is rounded
WEIGHTS = 100.0  # 1/(N s), of what weight does in a step: a part of the tolerance, up to all of it


@dataclass(frozen=True, eq=False)
class Run:
    """A batch that is about to run.

    Attributes:
        trees: one for all robots, or one each.
        world: ground, gravity and time.
        given: ``weights`` (B, S, M) or ``commands`` (B, K, M), the other without entries; ``lights``, and the fields of
            ``State``; with a first axis of one where all robots share them.
        numbers: parameters of trees and senses, as the sections of memory that they fill.
        settings: numbers that all robots share, by their places in ``slots``.
        plan: places of sections.
        real: what a real is.
        compute: where the run is computed.
        at_once: robots of a part.
        described: whether robots start as their trees describe them.
        ground: grids of uneven ground, of all robots or of each; None for the level floor.
    """

    trees: Sequence[Tree]
    world: Physics
    given: Given
    numbers: Mapping[int, Floats]
    settings: np.ndarray
    plan: NDArray[np.int32]
    real: Real
    compute: Compute
    at_once: int
    described: bool
    ground: GroundTables | None = None

    @property
    def batch(self) -> int:
        """Number of robots."""
        grids = 1 if self.ground is None else len(self.ground.grid)
        return max(len(self.trees), grids, *map(len, self.given.values()))

    def parts(self) -> Iterator["Part"]:
        """Robots that run together, ready to start."""
        for first in range(0, self.batch, self.at_once):
            yield Part(self, np.arange(first, min(first + self.at_once, self.batch)))

    def memory(self, robots: Ints) -> Floats:
        """Memory of some robots at the start, (slots, robots)."""
        given = {name: _rows(values, robots) for name, values in self.given.items()}
        found = np.zeros((int(self.plan[slots.SLOTS]), len(robots)))
        for first, values in {
            slots.POSITION: given["position"],
            slots.ORIENTATION: given["orientation"],
            slots.LIGHT: given["lights"],
            slots.SLIP_STRENGTH: _rows(self._of_masses(self.world.slip_strength), robots),
            slots.IMPULSE_TOLERANCE: _rows(self._of_masses(self._impulse_tolerance), robots),
            slots.TOUCH_TOLERANCE: self._touch_tolerances(robots),
            **{self.plan[section]: _rows(values, robots) for section, values in self.numbers.items()},
            self.plan[slots.WEIGHT]: given["weights"],
            self.plan[slots.COMMAND]: given["commands"],
        }.items():
            flat = values.reshape(len(robots), -1)
            found[first : first + flat.shape[1]] = flat.T
        found[slots.CLOSEST], found[slots.DIVERGED] = 1e30, -1
        bodies = bodies_of(found, self.plan)
        carried, places, moving = self._carried(robots, given)
        for slot, values in ((slots.CARRIED, carried), (slots.OWN, places), (slots.MOVING, moving)):
            bodies[:, slot : slot + values.shape[-1]] = values.transpose(1, 2, 0)
        hinged = self.trees[0].hinged
        bodies[hinged, slots.ANGLE], bodies[hinged, slots.LAST_RATE] = given["angles"].T, given["rates"].T
        return found

    @property
    def wet(self) -> bool:
        """Whether there is water."""
        return self.ground is not None and self.ground.water

    @property
    def granular(self) -> bool:
        """Whether there is sand."""
        return self.ground is not None and self.ground.granular

    @property
    def moving(self) -> slice:
        """Bodies that may move: all but a base that is fixed to the world."""
        return slice(1 if self.trees[0].fixed else 0, None)

    def _of_masses(self, law: Callable[[float], float]) -> Floats:
        """What follows from the mass of all that moves of a robot, by trees."""
        masses = self.numbers[slots.PARAMETER][:, self.moving, slots.MASS]
        return np.array([law(math.fsum(each)) for each in masses])

    def _impulse_tolerance(self, mass: float) -> float:
        """How far impulses on points of a robot may be from their bounds [N s]: less, where it is so light.

        The studies' solver has one tolerance for all.
        """
        tolerance = float(self.settings[slots.TOLERANCE])
        light = self.world.integration == "momentum" and mass > 0
        return tolerance * min(1.0, WEIGHTS * self.world.time_step * mass * EARTH) if light else tolerance

    def _touch_tolerances(self, robots: Ints) -> Floats:
        """How high above the ground points of robots may be that still touch it [m]; none in the studies' engine."""
        if self.world.integration == "velocity":
            return np.zeros(len(robots))
        trees = [self.trees[n] for n in robots] if len(self.trees) > 1 else self.trees
        reaches = np.broadcast_to([tree.reach for tree in trees], len(robots))
        return TOUCH_TOLERANCE[self.real.precision] * reaches

    def _carried(self, robots: Ints, given: Given) -> tuple[Floats, Floats, Floats]:
        """Arrays (B, bodies, ...): what bodies carry (momenta or velocities), their places and their velocities."""
        by_momentum, state = self.world.integration == "momentum", [given[each.name] for each in fields(State)]
        if len(self.trees) == 1:
            return _of_tree(self.trees[0], State(*state), by_momentum)
        rows = [State(*(values[n : n + 1] for values in state)) for n in range(len(robots))]
        each = [_of_tree(self.trees[n], row, by_momentum) for n, row in zip(robots, rows, strict=True)]
        carried, places, moving = (np.concatenate(parts) for parts in zip(*each, strict=True))
        return carried, places, moving

    def grids(self, robots: Ints) -> tuple[np.ndarray, NDArray[np.int32]]:
        """Grids of uneven ground, and where that of each robot begins; of no meaning for the level floor."""
        if self.ground is None:
            return np.zeros(1, self.real.numpy), np.zeros(1, np.int32)
        return self.ground.relief.astype(self.real.numpy, copy=False), _rows(self.ground.grid, robots)

    def result(self, found: Floats, frames: Floats | None = None) -> RigidResult:
        """Result of memory, (slots, B), and of what was recorded, (numbers, B)."""
        plan, hinged = self.plan, self.trees[0].hinged
        diverged = found[slots.DIVERGED] >= 0
        steps = np.where(diverged, found[slots.DIVERGED], plan[slots.STEPS]).astype(np.int64)
        found = np.where(diverged, np.nan, found)
        bodies = bodies_of(found, plan)
        recorded: Frames | None = None
        if frames is not None:
            each = frames.reshape(plan[slots.FRAMES], plan[slots.FRAME_WIDTH], -1).transpose(0, 2, 1)
            times: Floats = np.arange(len(each), dtype=float) * plan[slots.EVERY] * self.world.time_step
            ends = np.cumsum([3, 4, len(hinged), plan[slots.SENSORS]])
            recorded = Frames(times, *np.split(each, ends, axis=-1))
        return RigidResult(
            position=found[slots.POSITION : slots.POSITION + 3].T,
            orientation=found[slots.ORIENTATION : slots.ORIENTATION + 4].T,
            angles=bodies[hinged, slots.ANGLE].T,
            velocities=np.ascontiguousarray(bodies[:, slots.MOVING : slots.MOVING + 6].transpose(2, 0, 1)),
            readings=found[plan[slots.READING] : plan[slots.READING] + plan[slots.SENSORS]].T,
            closest=np.sqrt(found[slots.CLOSEST]),
            work=found[slots.WORK] if self.world.integration == "momentum" else np.full(len(steps), np.nan),
            status=np.where(diverged, "diverged", "ok"),
            steps=steps,
            residual=found[slots.RESIDUAL],
            frames=recorded,
        )


class Part:
    """Robots that run together: their memory, and the arguments that all kernels take.

    Args:
        run: whose robots they are.
        robots: their numbers; the last real is filled up with the first of them again.
    """

    def __init__(self, run: Run, robots: Ints) -> None:
        self.robots, self._real, self._plan = robots, run.real, run.plan
        self._on_cpu = run.compute.device == "cpu"
        self._blocks = -(-len(robots) // run.real.width)
        self.padded = np.resize(robots, self._blocks * run.real.width)
        self.memory = self.store(int(self._plan[slots.SLOTS]))
        self.memory.write(run.memory(self.padded))
        listed = np.zeros((self._blocks, max(1, int(self._plan[slots.POINTS]))), np.int32)
        drifting, grain = run.world.integration == "velocity", GRAIN if self._on_cpu else 1
        self._kind = run.real, grain, drifting, run.ground is not None, run.wet, run.granular
        self._shared = self._plan, listed, run.settings, *run.grids(self.padded)

    def store(self, count: int) -> Store:
        """Memory for so many slots of each robot."""
        return Store(self._real, count, self._blocks, self._on_cpu)

    def state(self, places: slice | Ints = EVERY) -> Floats:
        """Memory of the robots, all slots or some, (slots, robots)."""
        return self.memory.read(places)[:, : len(self.robots)]

    def frames(self) -> Store:
        """Memory for all that is recorded of a run."""
        return self.store(int(self._plan[slots.FRAME_WIDTH] * self._plan[slots.FRAMES]))

    def tape(self) -> Store:
        """Memory for the states before all steps of a run."""
        return self.store(int(self._plan[slots.KEPT]) * (int(self._plan[slots.STEPS]) + 1))

    def run(self, frames: Store | None = None, tape: Store | None = None) -> None:
        """Go on from the plan's first step until its last one; what is recorded and kept goes where there is room."""
        kernel = rollout_kernel(*self._kind, frames is not None, tape is not None)
        memories = (self.memory, frames or self.store(1), tape or self.store(1))
        kernel(self._blocks, *(each.argument for each in memories), *self._shared)

    def command(self, number: int, commands: Floats) -> None:
        """Replace one of the commands over time of all motors, (robots, M)."""
        motors = commands.shape[1]
        first = int(self._plan[slots.COMMAND]) + number * motors
        given = np.resize(commands, (len(self.padded), motors)).T
        self.memory.write(given, slice(first, first + motors))

    def go_back(self, tape: Store, seeds: Floats) -> Floats:
        """Cotangents of all slots at the plan's first step from those at its last one, (slots, robots)."""
        motion, cotangents = (self.store(len(seeds)) for _ in range(2))
        mine = np.zeros((len(seeds), len(self.padded)))
        mine[:, : len(self.robots)] = seeds
        cotangents.write(mine)
        memories = (self.memory, motion, cotangents, tape)
        gradient_kernel(*self._kind)(self._blocks, *(each.argument for each in memories), *self._shared)
        return cotangents.read()[:, : len(self.robots)]


def bodies_of(memory: Floats, plan: NDArray[np.int32]) -> Floats:
    """The slots of bodies in a memory (slots, B), as a view (bodies, slots of a body, B)."""
    width = slots.BODY_WIDTH * plan[slots.BODIES]
    return memory[plan[slots.BODY] : plan[slots.BODY] + width].reshape(plan[slots.BODIES], slots.BODY_WIDTH, -1)


def _rows(array: np.ndarray, robots: Ints) -> np.ndarray:
    """Rows of some robots, where one row may serve all."""
    return array[robots] if len(array) > 1 else np.repeat(array, len(robots), 0)


def _of_tree(tree: Tree, state: State, by_momentum: bool) -> tuple[Floats, Floats, Floats]:
    places, turns = poses(tree, state.position, state.orientation, state.angles)
    moving = velocities(tree, places, turns, state.velocity, state.rates)
    if not by_momentum:
        return moving, places, moving
    carried = momenta(tree, places, turns, moving)
    if not tree.fixed:  # as ``stages.motion.shift_moments`` has them
        masses = tree.masses[:, None]
        arms = places - places[..., :1, :]
        centre, velocity = ((masses * x).sum(-2, keepdims=True) / masses.sum() for x in (arms, moving[..., 3:]))
        carried[..., :3] -= np.cross(centre, carried[..., 3:]) + np.cross(arms - centre, masses * velocity)
    return carried, places, moving
