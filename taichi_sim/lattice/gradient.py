"""Exact gradients of what a batch of robots did: reverse mode through a run, contacts and friction included.

The derivative is that of the computation itself, step by step, with the same contacts, friction states and regimes of
links as the forward engine. These switches are not differentiated: between two of them the gradient is exact, at one it
is that of one side. Over long horizons a cost is piecewise smooth, with a small jump wherever a foot begins to stick or
to slip a step earlier, and the gradient tells nothing of the jumps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichi_sim import runtime
from taichi_sim.base import checks
from taichi_sim.base.short_text import ShortText
from taichi_sim.lattice.checkpoints import FORWARD, checked_memory, make_plan
from taichi_sim.lattice.fading import fade
from taichi_sim.lattice.feedback import Feedback
from taichi_sim.lattice.material_gradient import material_gradients
from taichi_sim.lattice.program import QUANTITY_COUNT, LatticeProgram
from taichi_sim.lattice.stages import memory as places

if TYPE_CHECKING:
    from taichi_sim.lattice.drivers.driver import Reverse
    from taichi_sim.lattice.engine import LatticeEngine, LatticeResult, LatticeState


# So many robots a thread are worth one tape: more only share the memory that is allowed, and so compute more again.
ROBOTS_PER_THREAD = 8


@dataclass(frozen=True, eq=False, repr=False)
class LatticeGradient(ShortText):
    """Derivatives of a cost by everything that a run of lattice robots began with.

    Attributes:
        values, rates: by value and rate per step of every event of the program, in its order, shape (E,).
        positions: by the voxel centres at the start of the run, shape (B, V, 3).
        orientations: by the quaternions, as four free numbers, shape (B, V, 4).
        velocities, angular_velocities: by those at the start, shape (B, V, 3).
        materials: by the numbers of the materials, name of the field to shape (B, M), scale (B, M, 3); the time step is
            held fixed, and so are the velocities at the start. Channels that an earlier run has set owe them nothing.

    All are zero for robots that diverged.
    """

    values: np.ndarray
    rates: np.ndarray
    positions: np.ndarray
    orientations: np.ndarray
    velocities: np.ndarray
    angular_velocities: np.ndarray
    materials: dict[str, np.ndarray]


class Tape:
    """A recorded run that can be differentiated, as often as wanted; the engine may go on meanwhile.

    Attributes:
        result: result of the run, as ``LatticeEngine.run`` would have returned it.
        state: the state after the run.
    """

    def __init__(
        self,
        engine: "LatticeEngine",
        program: LatticeProgram,
        memory: float,
        progress: Callable[[float], None] | None = None,
        feedback: Feedback | None = None,
    ) -> None:
        """Run the program; the arguments are those of ``LatticeEngine.record``."""
        memory = checked_memory(memory)
        self._engine, self._program = engine, program
        self._initial_channels, self._start = engine.initial_channels.copy(), engine.state()
        self._run = run = engine.begin(program)
        self._course = course = engine.course(run, program, feedback)
        start = run.checkpoint()
        steps, kept = int(program.lengths.max()), run.checkpoint_bytes(start)
        self._plan = plan = make_plan(steps, run.state_bytes, kept, memory, run.reverse_bytes, run.most_states)
        self._checkpoints = {0: start}
        for mark in plan.pieces(0, steps)[1:] if steps > plan.record else []:
            course.advance(mark, tick=progress)
            self._checkpoints[mark] = run.checkpoint()
        course.advance(tick=progress)
        self.result: LatticeResult = engine.finish(run)
        self.state: LatticeState = engine.state()

    @property
    def memory(self) -> float:
        """Memory taken now and while pulling back [B]."""
        return self._plan.memory

    @runtime.exclusive
    def pull_back(
        self,
        positions: np.ndarray | None = None,
        orientations: np.ndarray | None = None,
        strains: np.ndarray | None = None,
        sizes: np.ndarray | None = None,
        state: "LatticeState | None" = None,
        progress: Callable[[float], None] | None = None,
        horizon: float | None = None,
    ) -> LatticeGradient:
        """Compute the derivatives of a cost by what the run began with, from those by the results of the run.

        Args:
            positions, orientations, strains, sizes: of the cost by those of ``result``, shapes as there; so running
                costs are functions of recorded poses and sizes.
            state: of the cost by the final ``state``.
            progress: called now and then with the fraction done, 0 to 1.
            horizon: time [s] after which derivatives have faded to 1 / e, positive; see
                :mod:`taichi_sim.lattice.fading`. None: they are exact.

        Raises:
            ValueError: for shapes that do not match, numbers that are not finite, a robot that diverged although the
                cost depends on it, or derivatives by the final state with a horizon.
        """
        if horizon is not None and state is not None:
            raise ValueError(f"horizon: {horizon!r} is not allowed with a final state; give None")
        recorded = self._pose_seeds(positions, orientations), self._strain_seeds(strains), self._size_seeds(sizes)
        for seeds in recorded:
            seeds[self._program.snapshots < 0] = 0.0
        finals = self._state_seeds(state)
        lost = np.flatnonzero(self.result.status != "ok")
        for robot in lost:
            if any(np.any(seeds[robot]) for seeds in (*recorded, finals)):
                raise ValueError(
                    f"robot {robot}: diverged at step {self.result.steps[robot]}; it has no gradient, give it zeros"
                )
        runtime.start(self._engine.compute)
        now = self._run.checkpoint()
        try:
            reverse = self._run.reverse(recorded, finals)
            if horizon is not None:
                step = self._engine.time_step / self._engine.substeps
                fade(reverse, self._program, step, checks.positive("horizon", horizon))
            self._course.take_back(reverse)
            self._undo(reverse, progress)
        finally:
            self._run.restore(now)
        return self._gradient(reverse, finals)

    def _undo(self, reverse: "Reverse", progress: Callable[[float], None] | None) -> None:
        """Go through the plan from the last piece to the first."""
        checkpoints = dict(self._checkpoints)
        steps = int(self._program.lengths.max())
        for action, low, high in self._plan.undo(0, steps):
            if action == FORWARD:
                if high not in checkpoints:
                    self._run.restore(checkpoints[low])
                    self._run.advance(high)
                    checkpoints[high] = self._run.checkpoint()
                continue
            self._run.restore(checkpoints[low])
            reverse.undo(low, high)
            checkpoints.pop(low)
            if progress:
                progress(1 - low / max(steps, 1))

    def _pose_seeds(self, positions: np.ndarray | None, orientations: np.ndarray | None) -> np.ndarray:
        """Cotangents of recorded poses in the engine's voxel order, shape (B, S, V, 7)."""
        shape = self.result.positions.shape[:3]
        seeds = np.zeros((*shape, 7))
        for name, given, part in (("positions", positions, slice(0, 3)), ("orientations", orientations, slice(3, 7))):
            if given is not None:
                seeds[..., part] = _checked(name, given, (*shape, part.stop - part.start))
        return seeds[:, :, self._engine.order]

    def _strain_seeds(self, strains: np.ndarray | None) -> np.ndarray:
        shape = self.result.strains.shape
        seeds = np.zeros(shape) if strains is None else _checked("strains", strains, shape).copy()
        return seeds

    def _size_seeds(self, sizes: np.ndarray | None) -> np.ndarray:
        """Cotangents of the rest sizes of groups, shape (B, S, G, 3)."""
        tables, shape = self._engine.tables, self.result.sizes.shape
        seeds = np.zeros((*shape[:2], len(tables.group_region), 3))
        if sizes is None:
            return seeds
        given = _checked("sizes", sizes, shape)[:, :, self._engine.order]
        for group in range(seeds.shape[2]):
            seeds[:, :, group] = np.ascontiguousarray(given[:, :, tables.group == group]).sum(axis=2)
        return seeds

    def _state_seeds(self, state: "LatticeState | None") -> np.ndarray:
        """Cotangents of the last state's poses and momenta of both kinds in the engine's order, shape (B, V, 13)."""
        batch, voxels = self._engine.batch, self._engine.body.voxel_count
        seeds = np.zeros((batch, voxels, places.STICKS))
        if state is None:
            return seeds
        for name, part in places.MOTION.items():
            given = _checked(f"state.{name}", getattr(state, name), seeds[:, :, part].shape)
            seeds[:, :, part] = given[:, self._engine.order]
        inverse = self._engine.inverse_masses
        seeds[:, :, places.MOTION["velocities"]] *= inverse[..., :1]
        seeds[:, :, places.MOTION["angular_velocities"]] *= inverse[..., 1:]
        return seeds

    def _gradient(self, reverse: "Reverse", finals: np.ndarray) -> LatticeGradient:
        engine, source = self._engine, self._run.program.source
        events = np.zeros((len(self._program.events), 2))
        np.add.at(events, source[source >= 0], reverse.events[source >= 0].astype(float))
        found = reverse.read(places.VOXEL, places.CHANNEL, places.CONSTANT, places.BEAM)
        voxel, channels, constants, beams = found
        voxel, inverse = (np.take(array, engine.place, axis=1) for array in (voxel, engine.inverse_masses))
        base = np.where(self._initial_channels, channels[..., places.BASE], 0.0)
        for part in (voxel, base, constants, beams):
            part[self.result.status != "ok"] = 0.0
        # Velocities are momenta times inverse masses: they are read so at the end, and held so at the start.
        constants[:, :, :2] += self._by_masses(self.state, finals[:, :, places.MOMENTUM :])
        constants[:, :, :2] -= self._by_masses(self._start, voxel[:, engine.order, places.MOMENTUM : places.STICKS])
        bases = base.reshape(engine.batch, -1, QUANTITY_COUNT)
        position, orientation, momentum, spin = (voxel[..., part] for part in places.MOTION.values())
        return LatticeGradient(
            values=events[:, 0],
            rates=events[:, 1] / engine.substeps,
            positions=position,
            orientations=orientation,
            velocities=momentum / inverse[..., :1],
            angular_velocities=spin / inverse[..., 1:],
            materials=material_gradients(engine.bodies, engine.tables, engine.time_step, constants, beams, bases),
        )

    def _by_masses(self, state: "LatticeState", cotangents: np.ndarray) -> np.ndarray:
        """What a cost owes to the inverse masses that turn momenta into velocities, shape (B, G, 2).

        Args:
            state: has the velocities.
            cotangents: of momenta and angular momenta in the engine's order, shape (B, V, 6).
        """
        engine, tables = self._engine, self._engine.tables
        inverse = engine.inverse_masses
        share = np.zeros((engine.batch, len(tables.group_region), 2))
        for part, velocities in enumerate((state.velocities, state.angular_velocities)):
            moved = np.nan_to_num(velocities[:, engine.order]) * cotangents[:, :, 3 * part : 3 * part + 3]
            total = moved.sum(axis=2) / inverse[..., part] ** 2
            for group in range(share.shape[1]):
                # In one order, whatever the batch: the layout of what an index picks out depends on it.
                share[:, group, part] = np.ascontiguousarray(total[:, tables.group == group]).sum(axis=1)
        return share


def _checked(name: str, given: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(given, float)
    if array.shape != shape:
        raise ValueError(f"{name}: cotangents of shape {array.shape} are not allowed; give {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: cotangents must be finite numbers")
    return array
