"""The stepped driver: scalars, a kernel per stage of a time step (GPU; on a CPU for tests and gradients)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_sim.autodiff.lanes import Real
from taichi_sim.lattice.drivers import fused_kernel as kernel
from taichi_sim.lattice.drivers.fused import CONTACTS_PER_STEP
from taichi_sim.lattice.drivers.stepped_kernels import stepped_kernels
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.runtime import ti

if TYPE_CHECKING:
    from taichi_sim.lattice.drivers.stepped_reverse import SteppedReverse

PARTNERS_PER_VOXEL = 24  # room for watched partners at first; it grows when needed
STEPS_PER_CHECK = 250  # steps between looks at the room, and so the steps that are done again when it was too small


class SteppedDriver:
    """State of a batch, laid out [slot, robot]: NumPy between runs, the device's memory during a run."""

    def __init__(
        self, tables: Tables, batch: int, precision: str, floor: bool, self_contact: bool, on_cpu: bool
    ) -> None:
        """Allocate the memory and fill in the constants."""
        self.tables, self.batch, self._on_cpu = tables, batch, on_cpu
        self.real = Real(precision, 1)
        self.layout = tables.layout(forces=(len(tables.link_ends), 12))
        self._memory: np.ndarray = np.zeros((self.layout.slots, batch), self.real.numpy)
        for section, values in tables.initial_sections():
            self.write(section, values)
        self._start: np.ndarray = tables.start.astype(self.real.numpy)
        self._plan = tables.plan(self.layout, floor, self_contact)
        self._plan[memory.PAIRS] = PARTNERS_PER_VOXEL
        self.forget_watch()

    def write(self, section: int, values: np.ndarray) -> None:
        """Set a section from values of shape (B, items, components)."""
        first = self.layout.starts[section]
        self._memory[first : first + values[0].size] = values.reshape(self.batch, -1).T

    def read(self, section: int) -> np.ndarray:
        """A copy of a section, shape (B, items, components)."""
        return self._memory[self.layout.span(section)].T.reshape(self.batch, *self.layout.rows[section]).copy()

    def forget_watch(self) -> None:
        """Have the watch lists built anew before the next step."""
        self._memory[self.layout.starts[memory.MONITOR] + memory.MOVED] = np.inf
        self._memory[self.layout.span(memory.WATCH)] = np.nan

    def save(self) -> tuple[np.ndarray, ...]:
        """A copy of all that lasts from run to run."""
        return (self._memory.copy(),)

    def restore(self, saved: tuple[np.ndarray, ...]) -> None:
        """Go back to what was saved; a run builds its lists anew."""
        self._memory[...] = saved[0]

    @property
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""
        lists = (1 + int(self._plan[memory.PAIRS])) * len(self.tables.surface_voxels) * 4
        return 2 * self.layout.slots * self._memory.itemsize + lists

    def _device(self, array: np.ndarray) -> Any:
        """The array where the kernels run."""
        if self._on_cpu:
            return array
        on_device = ti.ndarray(ti.i32 if array.dtype == np.int32 else self.real.scalar, array.shape)
        on_device.from_numpy(np.ascontiguousarray(array))
        return on_device

    def _host(self, array: Any) -> np.ndarray:
        return array if self._on_cpu else array.to_numpy()

    def begin(self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float) -> "SteppedRun":
        """Start a program at its step 0."""
        return SteppedRun(self, program, alive, dt, edge, gravity)


@dataclass(frozen=True, eq=False)
class SteppedRecord:
    """States of the robots before each of the steps from ``first`` on, and the contacts of each, on the device.

    Attributes:
        first: step of the first state.
        room: states.
        states: shape (room * state slots, B).
        log: touching pairs of surface voxels, shape (room, contacts, B, 2).
        logged: number of contacts of each step, shape (room, B).
    """

    first: int
    room: int
    states: Any
    log: Any
    logged: Any


class SteppedRun:
    """A program on its way: the arrays of a run on the device, and the kernels that work on them."""

    def __init__(
        self, driver: SteppedDriver, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float
    ) -> None:
        """Put every robot at the start of the program."""
        t, self.driver, self._put = driver.tables, driver, driver._device
        lanes = np.zeros((driver.batch, kernel.LANE_COLUMNS), np.int32)
        lanes[:, kernel.LANE_EVENT], lanes[:, kernel.LANE_LAST_EVENT] = program.first[:-1], program.first[1:]
        lanes[:, kernel.LANE_LENGTH] = program.lengths
        lanes[:, kernel.LANE_STATE] = np.where(alive, kernel.LANE_ACTIVE, kernel.LANE_DIVERGED)
        slots, links = max(program.slots, 1), max(len(t.link_ends), 1)
        self.poses = self._put(np.full((driver.batch, slots, len(t.group), 7), np.nan, driver.real.numpy))
        self.strains = self._put(np.full((driver.batch, slots, links), np.nan, driver.real.numpy))
        self.sizes = self._put(np.full((driver.batch, slots, len(t.group_region), 3), np.nan, driver.real.numpy))
        self._kernels, self.program = stepped_kernels(driver.real, t.fluid), program
        self.constants = dt, edge, gravity
        self._link, self._voxel, self._rest = self._put(t.link), self._put(t.voxel), self._put(t.rest)
        self._square, self._corner = self._put(t.square), self._put(t.corner)
        self._surface, self._excluded, self._start = (
            self._put(t.surface),
            self._put(t.excluded),
            self._put(driver._start),
        )
        self._marks, self.values = self._put(program.marks), self._put(program.values.astype(driver.real.numpy))
        self._full = self._put(np.zeros(1, np.int32))
        self.memory, self.lanes = self._put(driver._memory), self._put(lanes)
        self.at, self.total = 0, int(program.lengths.max())
        self._no_record = self.new_record(0, 0, 1)
        self._reserve()
        self.rebuild_lists()

    def new_record(self, first: int, room: int, contacts: int) -> SteppedRecord:
        """Memory on the device for so many states from step ``first`` on, and so many contacts of each."""
        batch, slots = self.driver.batch, self.driver.layout.state_slots
        states: np.ndarray = np.zeros((max(room * slots, 1), batch), self.driver.real.numpy)
        log = np.zeros((max(room, 1), contacts, batch, 2), np.int32)
        logged = np.zeros((max(room, 1), batch), np.int32)
        return SteppedRecord(first, room, self._put(states), self._put(log), self._put(logged))

    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: SteppedRecord | None = None
    ) -> None:
        """Go on to a step, or to the end; keep every state if asked for."""
        last = self.total + 1 if until is None else until
        while self.at < last:
            end = min(self.at + STEPS_PER_CHECK, last)
            before = self.save()
            for t in range(self.at, end):
                self.step(t, record)
            if self.lists_are_full():
                self.memory, self.lanes = self._put(before[0]), self._put(before[1])
                self._grow()
                continue
            self.at = end
            if tick:
                tick(min(end / max(self.total, 1), 1.0))
        if record is not None:
            self._kernels.keep(last - record.first, self.memory, self._plan, record.states, record.logged)

    def checkpoint(self) -> tuple[np.ndarray, ...]:
        """Copies of all that changes from step to step."""
        return (*self.save(), np.array(self.at))

    def restore(self, checkpoint: tuple[np.ndarray, ...]) -> None:
        """Go back to a checkpoint."""
        memory, lanes, at = checkpoint
        self.memory, self.lanes, self.at = self._put(memory.copy()), self._put(lanes.copy()), int(at)
        self.rebuild_lists()

    @property
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""
        d = self.driver
        return d.batch * (d.layout.state_slots * d._memory.itemsize + 8 * CONTACTS_PER_STEP + 4)

    @property
    def most_states(self) -> int:
        """Steps of all robots that a record can hold."""
        d = self.driver
        return memory.MOST_SLOTS // (d.batch * d.layout.state_slots)

    @property
    def reverse_bytes(self) -> int:
        """Bytes that reversing takes besides."""
        return 3 * self.driver._memory.nbytes

    def reverse(self, recorded: tuple[np.ndarray, np.ndarray, np.ndarray], finals: np.ndarray) -> "SteppedReverse":
        """Cotangents at the end of the run, ready to go back."""
        from taichi_sim.lattice.drivers.stepped_reverse import SteppedReverse

        return SteppedReverse(self, recorded, finals)

    def finish(self) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """After the last step: (steps done, diverged, (poses, strains, rest sizes of groups)), robots first."""
        host, slots = self.driver._host, self.program.slots
        self.driver._memory = host(self.memory)
        lanes = host(self.lanes)
        diverged = lanes[:, kernel.LANE_STATE] == kernel.LANE_DIVERGED
        poses, strains, sizes = (host(array)[:, :slots] for array in (self.poses, self.strains, self.sizes))
        return lanes[:, kernel.LANE_STEP].copy(), diverged, (poses, strains, sizes)

    def _reserve(self) -> None:
        surface, batch = max(len(self.driver.tables.surface_voxels), 1), self.driver.batch
        self._plan = self._put(self.driver._plan)
        self._partner = self._put(np.zeros((int(self.driver._plan[memory.PAIRS]), surface, batch), np.int32))
        self._count = self._put(np.zeros((surface, batch), np.int32))

    def step(self, t: int, record: "SteppedRecord | None" = None) -> None:
        """One time step of all robots; the last call only ends them."""
        k, m, plan, lanes = self._kernels, self.memory, self._plan, self.lanes
        dt, edge, gravity = self.constants
        kept, n = (record, t - record.first) if record else (self._no_record, -1)
        if record:
            k.keep(n, m, plan, kept.states, kept.logged)
        k.begin(
            t,
            edge,
            gravity,
            m,
            plan,
            self._link,
            self._rest,
            lanes,
            self._marks,
            self.values,
            self.poses,
            self.strains,
            self.sizes,
        )
        if self.driver._plan[memory.CONTACT_ON]:
            self._watch(from_watch=0)
            k.collide(m, plan, self._surface, lanes, self._partner, self._count, n, kept.log, kept.logged)
        k.links(edge, m, plan, self._link, self._voxel, lanes)
        if self.driver._plan[memory.SQUARES]:
            k.squares(m, plan, self._square, self._voxel, lanes)
        k.voxels(dt, edge, m, plan, self._link, self._voxel, self._corner, self._start, lanes)

    def _watch(self, from_watch: int) -> None:
        edge = self.constants[1]
        self._kernels.watch(
            contact.WATCH_RADIUS * edge,
            contact.REBUILD_DISTANCE * edge,
            from_watch,
            self.memory,
            self._plan,
            self._surface,
            self._excluded,
            self.lanes,
            self._partner,
            self._count,
            self._full,
        )

    def rebuild_lists(self) -> None:
        """Build all lists from the positions at which they were built last: a list is a function of those."""
        if self.driver._plan[memory.CONTACT_ON]:
            self._watch(from_watch=1)
            while self.lists_are_full():
                self._grow()

    def lists_are_full(self) -> bool:
        """Whether a voxel had more partners than there is room for."""
        return bool(self.driver._host(self._full)[0])

    def save(self) -> tuple[np.ndarray, np.ndarray]:
        """Copies of state and marks."""
        return self.driver._host(self.memory).copy(), self.driver._host(self.lanes).copy()

    def _grow(self) -> None:
        self.driver._plan[memory.PAIRS] *= 2
        self._full = self._put(np.zeros(1, np.int32))
        self._reserve()
        self._watch(from_watch=1)
