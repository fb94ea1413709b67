"""The stepped driver: scalars, a kernel per stage of a time step (GPU; on a CPU for tests and gradients)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sim.autodiff.lanes import Real
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.fused import CONTACTS_PER_STEP
from taichi_sim.lattice.drivers.marks import Marks, Recordings
from taichi_sim.lattice.drivers.stepped_kernels import stepped_kernels
from taichi_sim.lattice.drivers.stepped_reverse_kernels import reverse_kernels
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.runtime import ti

PARTNERS_PER_VOXEL = 24  # room for listed neighbours at first; it grows when needed
STEPS_PER_CHECK = 250  # steps between looks at the room, and so the steps that are done again when it was too small


class SteppedDriver:
    """State of a batch, laid out [slot, robot]: NumPy between runs, the device's memory during a run."""

    def __init__(self, tables: Tables, batch: int, precision: str, switches: tuple[bool, bool], on_cpu: bool) -> None:
        """Allocate the memory and fill in the constants; ``switches`` are those of floor and self-contact."""
        self.tables, self.batch, self._on_cpu = tables, batch, on_cpu
        self.real = Real(precision, 1)
        self.layout = tables.layout(forces=(len(tables.link_ends), 12))
        self.memory: np.ndarray = np.zeros((self.layout.slots, batch), self.real.numpy)
        for section, values in tables.initial_sections():
            self.write(section, values)
        self.plan = tables.plan(self.layout, *switches)
        self.plan[memory.PAIRS] = PARTNERS_PER_VOXEL
        self.forget_neighbours()

    def write(self, section: int, values: np.ndarray) -> None:
        """Set a section from values of shape (B, items, components)."""
        first = self.layout.starts[section]
        self.memory[first : first + values[0].size] = values.reshape(self.batch, -1).T

    def read(self, section: int) -> np.ndarray:
        """A copy of a section, shape (B, items, components)."""
        return self.memory[self.layout.span(section)].T.reshape(self.batch, *self.layout.rows[section]).copy()

    def forget_neighbours(self) -> None:
        """Have the neighbour lists built anew before the next step."""
        self.memory[self.layout.starts[memory.MONITOR] + memory.MOVED] = np.inf
        self.memory[self.layout.span(memory.LISTED)] = np.nan

    def save(self) -> tuple[np.ndarray, ...]:
        """A copy of all that lasts from run to run."""
        return (self.memory.copy(),)

    def restore(self, saved: tuple[np.ndarray, ...]) -> None:
        """Go back to what was saved; a run builds its lists anew."""
        self.memory[...] = saved[0]

    @property
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""
        lists = (1 + int(self.plan[memory.PAIRS])) * len(self.tables.surface_voxels) * 4
        return 2 * self.layout.slots * self.memory.itemsize + lists

    def device(self, array: np.ndarray) -> Any:
        """The array where the kernels run."""
        if self._on_cpu:
            return array
        on_device = ti.ndarray(ti.i32 if array.dtype == np.int32 else self.real.scalar, array.shape)
        on_device.from_numpy(np.ascontiguousarray(array))
        return on_device

    def host(self, array: Any) -> np.ndarray:
        """The array in NumPy."""
        return array if self._on_cpu else array.to_numpy()

    def begin(self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float) -> "SteppedRun":
        """Start a program at its step 0."""
        return SteppedRun(self, program, alive, (dt, edge, gravity))


@dataclass(frozen=True, eq=False)
class SteppedRecord:
    """States of the robots before each of the steps from ``first`` on, and the contacts of each, on the device.

    Attributes:
        first: step of the first state.
        states: shape (room * state slots, B).
        log: touching pairs of surface voxels, shape (room, contacts, B, 2).
        logged: number of contacts of each step, shape (room, B).
    """

    first: int
    states: Any
    log: Any
    logged: Any


class SteppedRun:
    """A program on its way: the arrays of a run on the device, and the kernels that work on them."""

    def __init__(
        self, driver: SteppedDriver, program: PackedProgram, alive: np.ndarray, constants: tuple[float, float, float]
    ) -> None:
        """Put every robot at the start of the program; the constants are time step, edge and gravity."""
        t, dtype, self.driver, self._put = driver.tables, driver.real.numpy, driver, driver.device
        self.program, self.constants, self._kernels = program, constants, stepped_kernels(driver.real, t.fluid)
        lanes = marking.lane_table(
            program, np.arange(driver.batch)[None], np.where(alive, marking.ACTIVE, marking.DIVERGED)
        )
        recorded = marking.unrecorded(program, driver.batch, t, dtype)
        self.marks = Marks(*map(self._put, (lanes, program.marks, program.values.astype(dtype), *recorded)))
        self.shared = t.shared(driver.plan, dtype, self._put)
        self._full = self._put(np.zeros(1, np.int32))
        self.memory = self._put(driver.memory)
        self.at, self.total = 0, int(program.lengths.max())
        self._no_record = self.new_record(0, 0, 1)
        self._reserve()
        self._list_again()

    def new_record(self, first: int, room: int, contacts: int) -> SteppedRecord:
        """Memory on the device for so many states from step ``first`` on, and so many contacts of each."""
        batch, slots = self.driver.batch, self.driver.layout.state_slots
        states: np.ndarray = np.zeros((max(room * slots, 1), batch), self.driver.real.numpy)
        log = np.zeros((max(room, 1), contacts, batch, 2), np.int32)
        logged = np.zeros((max(room, 1), batch), np.int32)
        return SteppedRecord(first, self._put(states), self._put(log), self._put(logged))

    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: SteppedRecord | None = None
    ) -> None:
        """Go on to a step, or to the end; keep every state if asked for."""
        last = self.total + 1 if until is None else until
        while self.at < last:
            end = min(self.at + STEPS_PER_CHECK, last)
            before = self._save()
            for step in range(self.at, end):
                self._step(step, record)
            if self._lists_are_full():
                self._load(*before)
                self._grow()
                continue
            self.at = end
            if tick:
                tick(min(end / max(self.total, 1), 1.0))
        if record is not None:
            self._kernels.keep(last - record.first, self.memory, self.shared.plan, record.states, record.logged)

    def checkpoint(self) -> tuple[np.ndarray, ...]:
        """Copies of all that changes from step to step."""
        return (*self._save(), np.array(self.at))

    def restore(self, checkpoint: tuple[np.ndarray, ...]) -> None:
        """Go back to a checkpoint."""
        memory, lanes, at = checkpoint
        self._load(memory.copy(), lanes.copy())
        self.at = int(at)
        self._list_again()

    @property
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""
        d = self.driver
        return d.batch * (d.layout.state_slots * d.memory.itemsize + 8 * CONTACTS_PER_STEP + 4)

    @property
    def most_states(self) -> int:
        """Steps of all robots that a record can hold."""
        return memory.MOST_SLOTS // (self.driver.batch * self.driver.layout.state_slots)

    @property
    def reverse_bytes(self) -> int:
        """Bytes that reversing takes besides."""
        return 3 * self.driver.memory.nbytes

    def reverse(self, recorded: Recordings, finals: np.ndarray) -> "SteppedReverse":
        """Cotangents at the end of the run, ready to go back."""
        return SteppedReverse(self, recorded, finals)

    def finish(self) -> tuple[np.ndarray, np.ndarray, Recordings]:
        """After the last step: (steps done, diverged, (poses, strains, rest sizes of groups)), robots first."""
        host = self.driver.host
        self.driver.memory, lanes = host(self.memory), host(self.marks.lanes)[0]
        poses, strains, sizes = (host(a)[:, : self.program.slots] for a in self.marks[3:6])
        return lanes[:, marking.STEP].copy(), lanes[:, marking.STATE] == marking.DIVERGED, (poses, strains, sizes)

    def _save(self) -> tuple[np.ndarray, np.ndarray]:
        """Copies of state and lanes."""
        return self.driver.host(self.memory).copy(), self.driver.host(self.marks.lanes).copy()

    def _load(self, state: np.ndarray, lanes: np.ndarray) -> None:
        self.memory, self.marks = self._put(state), self.marks._replace(lanes=self._put(lanes))

    def _reserve(self) -> None:
        surface, batch = max(len(self.driver.tables.surface_voxels), 1), self.driver.batch
        self.shared = self.shared._replace(plan=self._put(self.driver.plan))
        self._partner = self._put(np.zeros((int(self.driver.plan[memory.PAIRS]), surface, batch), np.int32))
        self._count = self._put(np.zeros((surface, batch), np.int32))

    def _step(self, step: int, record: SteppedRecord | None) -> None:
        """One time step of all robots; the last call only ends them."""
        k, m, t, lanes = self._kernels, self.memory, self.shared, self.marks.lanes
        dt, edge, gravity = self.constants
        kept, n = (record, step - record.first) if record else (self._no_record, -1)
        if record:
            k.keep(n, m, t.plan, kept.states, kept.logged)
        k.begin(step, edge, gravity, m, t.plan, t.link, t.rest, *self.marks[:6])
        if self.driver.plan[memory.CONTACT_ON]:
            self._list_neighbours(again=0)
            k.collide(m, t.plan, t.surface, lanes, self._partner, self._count, n, kept.log, kept.logged)
        k.links(edge, m, t.plan, t.link, t.voxel, lanes)
        if self.driver.plan[memory.SQUARES]:
            k.squares(m, t.plan, t.square, t.voxel, lanes)
        k.voxels(dt, edge, m, t.plan, t.link, t.voxel, t.corner, t.start, lanes)

    def _list_neighbours(self, again: int) -> None:
        edge, t = self.constants[1], self.shared
        radius, distance = contact.NEIGHBOUR_RADIUS * edge, contact.REBUILD_DISTANCE * edge
        given = (self.memory, t.plan, t.surface, t.excluded, self.marks.lanes, self._partner, self._count, self._full)
        self._kernels.list_neighbours(radius, distance, again, *given)

    def _list_again(self) -> None:
        """Build all lists from the positions at which they were built last: a list is a function of those."""
        if self.driver.plan[memory.CONTACT_ON]:
            self._list_neighbours(again=1)
            while self._lists_are_full():
                self._grow()

    def _lists_are_full(self) -> bool:
        """Whether a voxel had more neighbours than there is room for."""
        return bool(self.driver.host(self._full)[0])

    def _grow(self) -> None:
        self.driver.plan[memory.PAIRS] *= 2
        self._full = self._put(np.zeros(1, np.int32))
        self._reserve()
        self._list_neighbours(again=1)


class SteppedReverse:
    """Cotangents of a batch on their way back through a run."""

    def __init__(self, run: SteppedRun, recorded: Recordings, finals: np.ndarray) -> None:
        """Start at the end of a run; arguments as for ``FusedReverse``."""
        driver, program, dtype = run.driver, run.program, run.driver.real.numpy
        self.run, self.driver, put = run, driver, driver.device
        self.layout = driver.tables.layout(forces=(len(driver.tables.group), 6))
        values: np.ndarray = np.zeros((self.layout.slots, driver.batch), dtype)
        shared = self.layout.starts[memory.FORCE]
        values[:shared] = driver.host(run.memory)[:shared]
        self._values, self._cotangents = put(values), put(np.zeros_like(values))
        self._steps = {int(program.lengths.max()), *program.lengths.tolist(), *program.marks[:, 0].tolist()}
        seeds = {name: put(marking.filled(x, dtype)) for name, x in marking.named(recorded, finals)}
        lanes = marking.lanes_back(driver.host(run.marks.lanes))
        found: np.ndarray = np.zeros(program.values.shape, dtype)
        self._marks = run.marks._replace(lanes=put(lanes), by_value=put(found), **seeds)
        self._contacts = CONTACTS_PER_STEP
        self._kernels = reverse_kernels(driver.real, driver.tables.fluid)

    @property
    def events(self) -> np.ndarray:
        """Cotangents of (base, rate) of each of the program's marks."""
        return self.driver.host(self._marks.by_value)

    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""
        record = self._record(low, high)
        self._meet(record, high)
        for step in range(high - 1, low - 1, -1):
            self._undo_step(record, step)
            self._meet(record, step)

    def _record(self, low: int, high: int) -> SteppedRecord:
        start = self.run.checkpoint()
        while True:
            record = self.run.new_record(low, high - low + 1, self._contacts)
            self.run.advance(high, record=record)
            if self.driver.host(record.logged).max(initial=0) <= self._contacts:
                return record
            self._contacts *= 2
            del record  # before the larger one is made
            self.run.restore(start)

    def _undo_step(self, record: SteppedRecord, step: int) -> None:
        k, t, n, lanes = self._kernels, self.run.shared, step - record.first, self._marks.lanes
        dt, edge, gravity = self.run.constants
        memories = self._values, record.states, self._cotangents
        k.recall(n + 1, edge, gravity, *memories[:2], t.plan, t.rest)
        k.voxels(n, dt, edge, *memories, t.plan, t.link, t.voxel, lanes)
        k.links(n, edge, *memories, t.plan, t.link, t.voxel, lanes)
        if self.driver.plan[memory.SQUARES]:
            k.squares(n, *memories, t.plan, t.square, t.voxel, lanes)
        if self.driver.plan[memory.CONTACT_ON]:
            k.contacts(n, *memories, t.plan, t.surface, lanes, record.log, record.logged)
        k.groups(n, edge, gravity, *memories, t.plan, t.rest, lanes)

    def _meet(self, record: SteppedRecord, step: int) -> None:
        """Do what is due at a step, once."""
        if step not in self._steps:
            return
        self._steps.remove(step)
        k, t, n = self._kernels, self.run.shared, step - record.first
        _, edge, gravity = self.run.constants
        k.recall(n, edge, gravity, self._values, record.states, t.plan, t.rest)
        memories = self._values, record.states, self._cotangents
        k.marks(n, step, self.layout.slots, edge, *memories, t.plan, t.link, *self._marks)

    def read(self, section: int) -> np.ndarray:
        """Cotangents of a section of the memory, shape (B, items, components)."""
        part = self.driver.host(self._cotangents)[self.layout.span(section)]
        return part.T.reshape(self.driver.batch, *self.layout.rows[section]).astype(float)
