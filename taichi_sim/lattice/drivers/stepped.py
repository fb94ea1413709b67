"""The stepped driver: scalars, a thread per link or voxel (GPU; on a CPU for tests and gradients)."""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from taichi_sim.autodiff.lanes import Real
from taichi_sim.lattice.drivers.driver import CONTACTS_PER_STEP, Checkpoint, Driver, Reverse, Run
from taichi_sim.lattice.drivers.marks import Recordings
from taichi_sim.lattice.drivers.snapshots import snapshot_kernels
from taichi_sim.lattice.drivers.stepped_kernels import Has, Near, Record, stepped_kernels, threads_for
from taichi_sim.lattice.drivers.stepped_reverse_kernels import reverse_kernels
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.columns import Medium
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.lattice.stages.undo import Undo
from taichi_sim.runtime import device_array, ti

PARTNERS_PER_VOXEL = 24  # room for listed neighbours at first; it grows when needed
STEPS_PER_CHECK = 250  # steps between looks at the room, and so the steps that are done again when it was too small


class SteppedReverse(Reverse):
    """The way back by a kernel per step."""

    def __init__(self, run: "SteppedRun", recorded: Recordings, finals: np.ndarray) -> None:
        """Start at the end of a run; the arguments are those of :meth:`Run.reverse`."""
        super().__init__(run, recorded, finals)
        lengths = run.program.lengths
        self._steps = {int(lengths.max()), *lengths.tolist(), *run.program.marks[:, 0].tolist()}

    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""
        record = self.record(low, high)
        items = record.log.shape[1], int(self.driver.plan[memory.GROUPS]) * QUANTITY_COUNT
        self._kernels = reverse_kernels(*self.driver.kind(max(items)))  # the log may have grown
        memories = Undo(self.values, None, record.states, None, self.cotangents, None, None)
        self._meet(memories, high, high - low)
        for step in range(high - 1, low - 1, -1):
            self._kernels.step(step - low, memories, self.run.shared, self.marks.lanes, record)
            self._meet(memories, step, step - low)
            self.stop(step)

    def _meet(self, memories: Undo, step: int, n: int) -> None:
        """Do what is due at a step, once; n is its place in the record."""
        if step in self._steps:
            self._steps.remove(step)
            self._kernels.recall(n, memories, self.run.shared)
            self._kernels.marks(n, step, self.layout.slots, memories, self.run.shared, self.marks)


class SteppedRun(Run):
    """A program on its way: the arrays of a run on the device, and the kernels that work on them."""

    reverse_type = SteppedReverse

    def __init__(
        self, driver: "SteppedDriver", program: PackedProgram, alive: np.ndarray, constants: tuple[float, float, float]
    ) -> None:
        """Put every robot at the start of the program; the constants are time step, edge and gravity."""
        super().__init__(driver, program, alive, constants)
        self._kernels = stepped_kernels(*driver.kind())
        self._at = 0
        self._aside: tuple[Any, Any] | None = None
        self._record: Record | None = None
        self._no_record = self.new_record(0, 0, 1)
        self._reserve()
        self._list_again()

    def new_record(self, first: int, room: int, contacts: int) -> Record:
        """Memory for so many states from step ``first`` on, and so many contacts of each; used again."""
        batch, slots, blank = self.driver.batch, self.driver.layout.state_slots, self.driver.blank
        kept = self._record
        if kept is None or room > kept.logged.shape[0] or contacts > kept.log.shape[1]:
            kept = self._record = None  # before the larger one is made
            room = max(room, 1)
            states = blank((room * slots, batch), self.driver.real.numpy)
            log, logged = blank((room, contacts, batch, 2), np.int32), blank((room, batch), np.int32)
            kept = self._record = Record(first, states, log, logged)
        return kept._replace(first=first)

    def fits(self, record: Record) -> bool:
        """Whether all contacts found room in a record."""
        return bool(self.driver.host(record.logged).max(initial=0) <= record.log.shape[1])

    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: Record | None = None
    ) -> None:
        """Go on to a step, or to the end; keep every state, and that at the end, in a record if one is given."""
        last = int(self.program.lengths.max()) + 1 if until is None else until
        while self._at < last:
            end = min(self._at + STEPS_PER_CHECK, last)
            self._put_aside()
            for step in range(self._at, end):
                self._step(step, record)
            if self._lists_are_full():
                self._take_back()
                self._grow()
                continue
            self._at = end
            if tick:
                tick(min(end / self.total, 1.0))
        if record is not None:
            self._kernels.keep(last - record.first, self.memory, self.shared, record)

    def finish(self) -> tuple[np.ndarray, np.ndarray, Recordings]:
        """After the last step: the driver gets the memory back; then as for any run."""
        self.driver.memory = self.driver.host_memory(self.memory)
        return super().finish()

    def checkpoint(self) -> Checkpoint:
        """Copies, where the kernels run, of all that changes from step to step."""
        kept = tuple(self.driver.like(array) for array in self._changing)
        self._copy(self._changing, kept)
        return (*kept, np.array(self._at))

    def restore(self, checkpoint: Checkpoint) -> None:
        """Go back to a checkpoint."""
        *kept, at = checkpoint
        self._copy(kept, self._changing)
        self._at = int(at)
        self._list_again()

    @property
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""
        d = self.driver
        return int(d.batch * (d.layout.state_slots * d.memory.itemsize + 8 * CONTACTS_PER_STEP + 4))

    @property
    def _changing(self) -> tuple[Any, Any]:
        """What changes from step to step: state and lanes."""
        return self.memory, self.marks.lanes

    def _copy(self, arrays: Iterable[Any], into: Iterable[Any]) -> None:
        """Copy arrays into others, where the kernels run."""
        for array, other in zip(arrays, into, strict=True):
            self.driver.copy(array, other)

    def _put_aside(self) -> None:
        """Copy state and lanes where they are, for when a list turns out to be full."""
        if self.driver.plan[memory.CONTACT_ON]:
            if self._aside is None:
                self._aside = self.driver.like(self.memory), self.driver.like(self.marks.lanes)
            self._copy(self._changing, self._aside)

    def _take_back(self) -> None:
        assert self._aside is not None  # only lists are ever full, and only with contacts are there lists
        self._copy(self._aside, self._changing)

    def _step(self, step: int, record: Record | None) -> None:
        """One time step of all robots; the last call only ends them."""
        kept, n = (record, step - record.first) if record else (self._no_record, -1)
        if record:
            self._kernels.keep(n, self.memory, self.shared, kept)
        self._kernels.step(step, n, self.memory, self.shared, self.marks, self._near, kept)

    def _reserve(self) -> None:
        """Make room for neighbours; whoever calls builds the lists."""
        driver = self.driver
        surface, batch = max(len(driver.tables.surface_voxels), 1), driver.batch
        shapes = (int(driver.plan[memory.PAIRS]), surface, batch), (surface, batch), (1,)
        self._near = Near(*(driver.blank(shape, np.int32) for shape in shapes))
        self.shared = self.shared._replace(plan=driver.put(driver.plan))

    def _list_again(self) -> None:
        """Build all lists from the positions at which they were built last: a list is a function of those."""
        if self.driver.plan[memory.CONTACT_ON]:
            self._kernels.list_again(self.memory, self.shared, self._near)
            while self._lists_are_full():
                self._grow()

    def _lists_are_full(self) -> bool:
        """Whether a voxel had more neighbours than there is room for."""
        return bool(self.driver.host(self._near.full)[0])

    def _grow(self) -> None:
        self.driver.plan[memory.PAIRS] *= 2
        self._reserve()
        self._kernels.list_again(self.memory, self.shared, self._near)


class SteppedDriver(Driver):
    """A batch in one block with a lane per robot, in the device's memory during a run."""

    run_type = SteppedRun

    def __init__(self, tables: Tables, batch: int, precision: str, switches: tuple[bool, bool], on_cpu: bool) -> None:
        """Allocate the memory and fill in the constants; ``switches`` are those of floor and self-contact."""
        self._on_cpu = on_cpu
        super().__init__(tables, batch, Real(precision, 1), batch, (len(tables.link_ends), 12), switches)
        self.plan[memory.PAIRS] = PARTNERS_PER_VOXEL

    def save(self) -> Checkpoint:
        """A copy of all that lasts from run to run."""
        return (self.memory.copy(),)

    def restore(self, saved: Checkpoint) -> None:
        """Go back to what was saved; a run builds its lists anew."""
        self.memory[...] = saved[0]

    @property
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""
        lists = (1 + int(self.plan[memory.PAIRS])) * len(self.tables.surface_voxels) * 4
        copies = 1 + (not self._on_cpu) + bool(self.plan[memory.CONTACT_ON])  # in NumPy, on the device, put aside
        return copies * self.layout.slots * self.memory.itemsize + lists

    def kind(self, at_least: int = 0) -> tuple[Real, Medium, int | None, Has]:
        """What its kernels are compiled for.

        They are the real, surroundings, threads for at least so many items of a robot, and which stages a step has.
        """
        counts = (memory.VOXELS, memory.LINKS, memory.SURFACE, memory.SQUARES)
        items = self.batch * max(at_least, 1, *(int(self.plan[count]) for count in counts))
        has = Has(bool(self.plan[memory.CONTACT_ON]), bool(self.plan[memory.SQUARES]))
        return self.real, self.tables.medium, None if self._on_cpu else threads_for(items), has

    def put(self, array: np.ndarray) -> Any:
        """The array where the kernels run."""
        if self._on_cpu:
            return array
        on_device = self.blank(array.shape, array.dtype)
        on_device.from_numpy(np.ascontiguousarray(array))
        return on_device

    def blank(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """Allocate zeros where the kernels run; nothing is copied there."""
        return np.zeros(shape, dtype) if self._on_cpu else device_array(self._type(dtype), shape)

    def blank_memory(self, slots: int) -> Any:
        """Allocate a memory of zeros where the kernels run; nothing is copied there."""
        return self.blank((self.blocks * slots, self.robot.shape[1]), self.real.numpy)

    def _type(self, dtype: Any) -> Any:
        """The type that a NumPy type has where the kernels run."""
        return ti.i32 if dtype == np.int32 else self.real.scalar

    def like(self, array: Any) -> Any:
        """An array of the same shape where the kernels run, of any values."""
        return np.empty_like(array) if self._on_cpu else device_array(array.dtype, array.shape)

    def copy(self, array: Any, into: Any) -> None:
        """Copy an array into another one, where the kernels run."""
        if self._on_cpu:
            into[...] = array
        else:
            into.copy_from(array)

    def snapshot(self, recorded: Any, number: int) -> np.ndarray:
        """One snapshot of recorded poses or strains, shape (B, V, 7) or (B, L); only it travels."""
        if self._on_cpu:
            return super().snapshot(recorded, number)
        shape = recorded.shape
        part = self.blank((shape[0], *shape[2:]), self.real.numpy)
        snapshot_kernels(self.real, len(shape))[0](number, recorded, part)
        return self.host(part)

    def add_to_snapshot(self, recorded: Any, number: int, values: np.ndarray) -> None:
        """Add to one snapshot of recorded poses or strains, shape (B, V, 7) or (B, L); only it travels."""
        if self._on_cpu:
            super().add_to_snapshot(recorded, number, values)
        else:
            part = self.put(values.astype(self.real.numpy))
            snapshot_kernels(self.real, len(recorded.shape))[1](number, recorded, part)

    def bytes_of(self, array: Any) -> int:
        """Bytes of an array where the kernels run."""
        if isinstance(array, np.ndarray):
            return array.nbytes
        size = 4 if array.dtype == ti.i32 else np.dtype(self.real.numpy).itemsize
        return math.prod(array.shape) * size

    def host(self, array: Any) -> np.ndarray:
        """An array from where the kernels run, in NumPy."""
        found: np.ndarray = array if self._on_cpu else array.to_numpy()
        return found
