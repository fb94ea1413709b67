"""Memory and launches of the packed driver (see ``packed_kernel``)."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real
from taichi_sim.base.arrays import aligned
from taichi_sim.lattice.drivers import packed_contact as contacts
from taichi_sim.lattice.drivers import packed_kernel as kernel
from taichi_sim.lattice.drivers import packed_reverse_kernel as backwards
from taichi_sim.lattice.drivers.driver import CONTACTS_PER_STEP, Checkpoint, Driver, Reverse, Run
from taichi_sim.lattice.drivers.marks import NOWHERE, Recordings
from taichi_sim.lattice.drivers.packed_contact import Pairs, Record
from taichi_sim.lattice.drivers.packed_lanes import SPREAD_ROW
from taichi_sim.lattice.drivers.packed_reverse_kernel import BACK_WIDTH
from taichi_sim.lattice.drivers.packed_tables import PackedTables
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.runtime import one_thread

STEPS_PER_LAUNCH, LEAST_STEPS = 1000, 50
STEPS_PER_REVERSE = 250
PAIRS_PER_VOXEL = 4  # room for listed pairs at first; it grows when needed


@cache
def lanes(precision: str) -> int:
    """Voxels of a vector: half as many in single precision where a machine lacks vectors of 512 bits (10 % faster)."""
    cpu = Path("/proc/cpuinfo")
    wide = not cpu.exists() or "avx512f" in cpu.read_text()
    return NATIVE_WIDTH[precision] if wide else 8


class PackedReverse(Reverse):
    """The way back by launches of the reverse kernel."""

    def __init__(self, run: "PackedRun", recorded: Recordings, finals: np.ndarray) -> None:
        """Start at the end of a run; the arguments are those of :meth:`Run.reverse`."""
        super().__init__(run, recorded, finals)
        driver, real = run.driver, run.driver.real
        packs, links = len(driver.packed.packs.voxel), len(driver.packed.packs.link)
        left, gauges = (real.array((driver.batch * n,)) for n in ((links + 1) * BACK_WIDTH, packs * 3))
        parts = [a.reshape(-1) for a in (self.values, self.cotangents, left, gauges)]
        groups, self._given = real.array(driver.groups.shape[:2]), real.array(driver.groups.shape[:2])
        groups[...] = driver.groups
        upcoming = np.full(driver.batch, int(run.program.lengths.max()), np.int32)
        columns = (*driver.views(groups), *driver.views(self._given))
        reals = (self.values, parts[0], self.cotangents, parts[1], left, parts[2], gauges, parts[3])
        self._memories = backwards.Memories._make([*reals, *columns, upcoming])
        self._shared = run.shared._replace(plan=driver.packed.plan(self.layout, driver.switches))

    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""
        driver, record = self.driver, self.record(low, high)
        while True:
            middle = max(high - STEPS_PER_REVERSE, self.next_stop(low, high))
            backwards.packed_reverse_kernel(driver.real, driver.tables.medium, driver.serial)(
                backwards.Launch(driver.batch, self.layout.slots, driver.scalars.slots, high, middle),
                self._memories,
                self._shared,
                self.run.groups,
                driver.packed.lanes,
                record,
                self.marks,
            )
            self.stop(middle)
            if middle == low:
                return
            high = middle

    def of_section(self, section: int, view: np.ndarray) -> np.ndarray:
        """Cotangents of a section, a view of the memory, in shape (B, items, components)."""
        if section == memory.VOXEL:
            return self.driver.packed.read(view, section).astype(float)
        if section == memory.BEAM:
            found = np.zeros(self.driver.tables.beam.shape)
        else:
            found = self.driver.group_section(section, self._given).astype(float)
        if section != memory.CHANNEL:
            self.driver.packed.add(view, section, found)
        return found


class PackedRun(Run):
    """A program on its way by launches of the kernel."""

    reverse_type = PackedReverse

    def __init__(
        self, driver: "PackedDriver", program: PackedProgram, alive: np.ndarray, constants: tuple[float, float, float]
    ) -> None:
        """Put every robot at the start of the program; the constants are time step, edge and gravity."""
        super().__init__(driver, program, alive, constants)
        info, tables, dtype = driver.pairs.info, driver.packed, driver.real.numpy
        info[:, [contacts.STEP, contacts.NEXT_MARK]] = 0
        info[:, contacts.STATE] = np.where(alive, contacts.RUNNING, contacts.FINISHED)
        self.groups = self.shared._replace(plan=driver.group_plan)
        self.shared = self.shared._replace(
            link=tables.link, voxel=tables.voxel, start=driver.tables.start.astype(dtype)
        )
        # Made once: to hand over other arrays takes a launch longer than some steps.
        self._memories = kernel.Memories(self.memory, self.memory.reshape(-1), *driver.views(driver.groups))
        real, numbers = driver.real, (driver.batch, driver.layout.slots, driver.scalars.slots)
        steps = max(STEPS_PER_LAUNCH // driver.batch, LEAST_STEPS)
        self._numbers = *numbers, steps, contact.REBUILD_DISTANCE * self.edge
        self._kernels = [
            kernel.packed_kernel(real, kept, driver.tables.medium, driver.serial) for kept in (False, True)
        ]
        flat = {"poses": self.marks.poses.reshape(-1), "strains": self.marks.strains.reshape(-1)}
        self._flat_marks = self.marks._replace(**flat)
        self._unrecorded = Record()
        self._record: Record | None = None
        self._handed: Any = None
        self._at = 0  # every robot has come there, or ended

    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: Record | None = None
    ) -> None:
        """Go on to a step, or to the end; keep every state, and that at the end, in a record if one is given."""
        info, last = self.driver.pairs.info, NOWHERE if until is None else until
        if record is not None:
            info[:, contacts.LOGGED], info[:, contacts.KEPT] = 0, -1
        while self._at < last:
            self._launch(last, record)
            if self._has_come_to(last):
                self._at = last
            else:
                self._make_room()
            if tick:
                tick(float(info[:, contacts.STEP].mean()) / self.total)

    def _has_come_to(self, step: int) -> bool:
        """Whether every robot has come to a step, or ended before it."""
        info = self.driver.pairs.info
        steps = info[:, contacts.STEP]
        return bool(steps.min() >= step or ((steps >= step) | (info[:, contacts.STATE] == contacts.FINISHED)).all())

    def _make_room(self) -> None:
        """Let robots go on whose lists of pairs are full."""
        driver, info = self.driver, self.driver.pairs.info
        full = info[:, contacts.STATE] == contacts.OUT_OF_PAIRS
        if full.any():
            driver.reserve(3 * driver.pairs.listed.shape[2] // 2)
            info[full, contacts.STATE] = contacts.RUNNING

    def _launch(self, until: int, record: Record | None) -> None:
        driver = self.driver
        # What it returns is kept, so that the next launch does not look at the same arrays again.
        self._handed = self._kernels[record is not None](
            kernel.Launch(*self._numbers, until),
            self._memories,
            self.shared,
            self.groups,
            driver.packed.lanes,
            driver.pairs,
            self._flat_marks,
            record or self._unrecorded,
        )

    def checkpoint(self) -> Checkpoint:
        """Copies of all that changes from step to step."""
        return *self.driver.save(), self.marks.lanes.copy()

    def restore(self, checkpoint: Checkpoint) -> None:
        """Go back to a checkpoint."""
        *saved, lanes = checkpoint
        self.driver.restore(tuple(saved))
        self.marks.lanes[...] = lanes
        self._at = 0

    def new_record(self, first: int, room: int, contacts: int) -> Record:
        """Memory for so many states from step ``first`` on, and so many contacts of each; used again."""
        batch, real = self.driver.batch, self.driver.real
        kept = self._record
        if kept is None or room > kept.start.shape[1] or contacts * kept.start.shape[1] > kept.contacts.shape[1]:
            kept = self._record = self._handed = None  # before the larger one is made
            states = aligned((batch * room * self.driver.state_slots, real.width), real.numpy)
            groups = real.array((batch * room * self.driver.channel_slots,))
            log, start = np.zeros((batch, contacts * room, 2), np.int32), np.zeros((batch, room), np.int32)
            kept = Record(True, first, states, states.reshape(-1), groups, groups, log, start)
            self._record = kept
        return kept._replace(first=first)

    def fits(self, record: Record) -> bool:
        """Whether all contacts found room in a record."""
        return bool((self.driver.pairs.info[:, contacts.LOGGED] <= record.contacts.shape[1]).all())

    @property
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""
        driver = self.driver
        reals = (driver.state_slots + driver.channel_slots) * driver.real.width
        return driver.batch * (reals * driver.memory.itemsize + 8 * CONTACTS_PER_STEP + 4)


class PackedDriver(Driver):
    """A batch of robots whose voxels, links and groups lie in native vectors."""

    run_type = PackedRun

    def __init__(
        self, tables: Tables, batch: int, precision: str, switches: tuple[bool, bool], places: np.ndarray
    ) -> None:
        """Allocate the memory and fill in the constants.

        Args:
            tables: of the batch.
            batch: number of robots B.
            precision: ``"f32"`` or ``"f64"``.
            switches: those of floor and self-contact.
            places: of voxels on the lattice, engine order, shape (V, 3).
        """
        self.tables, self.batch, self.real = tables, batch, Real(precision, lanes(precision))
        self.packed = packed = PackedTables(tables, places, self.real)
        self.blocks, self.robot = batch, np.arange(batch)[:, None]
        self.has_robot = np.ones((batch, 1), bool)
        self.layout, self.scalars, self.state_slots = packed.layout, packed.scalars, packed.state_slots
        self.switches = switches
        self.plan = packed.plan(packed.layout, switches)
        self.group_plan = packed.group_plan(switches)
        self.memory = self.zeros(self.layout.slots)
        self.groups = self.real.array((batch, self.scalars.slots))
        packs, dtype = len(packed.packs.voxel), self.real.numpy
        place = self.real.array((batch * -(-max(len(tables.surface_voxels), 1) // self.real.width) * 3,))
        self.pairs = Pairs(
            listed=np.zeros((batch, 2, 0), np.int32),
            near=np.zeros((batch, contacts.NEAR_COLUMNS, 0), np.int32),
            seen=aligned((batch * packs * 3, self.real.width), dtype),
            place=place,
            place_scalar=place.reshape(-1),
            sizes=self.real.array((batch * packed.group_packs,)),
            drift=aligned((batch, self.real.width), dtype),
            touched=np.zeros((batch, packs), np.int32),
            changing=np.zeros((batch, len(packed.lanes.spreads) // SPREAD_ROW), np.int32),
            info=np.zeros((batch, contacts.INFO_COLUMNS), np.int32),
        )
        self.reserve(PAIRS_PER_VOXEL * max(len(tables.surface_voxels), 1))
        packed.put_nobody(self.section(memory.VOXEL))
        for section, values in tables.initial_sections():
            self.write(section, values)
        self.forget_neighbours(self.memory)

    def zeros(self, slots: int) -> np.ndarray:
        """Vector memory of so many slots a robot, shape (B, slots, lanes)."""
        return self.real.array((self.batch, slots))

    def host_memory(self, array: np.ndarray) -> np.ndarray:
        """A vector memory in NumPy, shape (B, slots, lanes)."""
        return array.reshape(self.batch, -1, self.real.width)

    @property
    def backward_layout(self) -> memory.Memory:
        """The memory on the way back."""
        return self.packed.backward

    def reserve(self, pairs: int) -> None:
        """Make room for so many listed pairs a robot, keeping the present ones; short lists are made anew."""
        kept = self.pairs.listed.shape[2]
        # In packs; those that are not full end with pairs of the first voxel with itself, which do not count.
        listed = np.zeros((self.batch, 2, -(-pairs // self.real.width) * self.real.width), np.int32)
        listed[:, :, :kept] = self.pairs.listed
        near = np.zeros((self.batch, contacts.NEAR_COLUMNS, pairs + self.real.width), np.int32)
        self.pairs = self.pairs._replace(listed=listed, near=near)
        self.pairs.drift[...] = np.inf

    @property
    def serial(self) -> bool:
        """Whether kernels run in the thread that launches them: there is one thread, or one robot to take."""
        return self.batch == 1 or one_thread()

    @property
    def channel_slots(self) -> int:
        """Slots of the channels of a robot's groups."""
        span = self.scalars.span(memory.CHANNEL)
        return span.stop - span.start

    def views(self, groups: np.ndarray) -> tuple[np.ndarray, ...]:
        """A memory of groups as reals, as scalars, and as scalars [slot, lane]."""
        return groups.reshape(-1, self.real.width), groups.reshape(-1), groups.reshape(-1, self.real.width)

    def group_section(self, section: int, of: np.ndarray | None = None) -> np.ndarray:
        """A copy of a section of groups or rest lengths, shape (B, items, components)."""
        whole = (self.groups if of is None else of).reshape(self.batch, -1, self.real.width)
        count = len(self.tables.rest if section == memory.REST else self.tables.group_region)
        width = self.scalars.rows[section][1]
        packs = whole[:, self.scalars.span(section)].reshape(
            self.batch, -(-count // self.real.width), -1, self.real.width
        )
        items = np.moveaxis(packs, 3, 2).reshape(self.batch, -1, packs.shape[2])[:, :count]
        return items.reshape(self.batch, -1, width)

    def fill(self, view: np.ndarray, section: int, values: np.ndarray) -> None:
        """Set the view of a section, none of groups, from values of shape (B, items, components)."""
        self.packed.write(view, section, values)

    def write(self, section: int, values: np.ndarray) -> None:
        """Set a section from values of shape (B, items, components)."""
        if section in (memory.VOXEL, memory.LINK, memory.STRAIN, memory.PRINT):
            self.fill(self.section(section), section, values)
            return
        if section in (memory.CONSTANT, memory.BEAM):
            self.fill(self.section(section), section, values)
        if section == memory.BEAM:
            return
        packs, width, count = self.packed.group_packs, self.real.width, len(self.tables.group_region)
        items = np.zeros((self.batch, packs * width, values[0].size // count), self.real.numpy)
        items[:, :count] = values.reshape(self.batch, count, -1)
        lanes = np.moveaxis(items.reshape(self.batch, packs, width, -1), 2, 3)
        self.groups[:, self.scalars.span(section)] = lanes.reshape(self.batch, -1, width)

    def read(self, section: int) -> np.ndarray:
        """A copy of a section, shape (B, items, components)."""
        if section in (memory.VOXEL, memory.LINK):
            return self.packed.read(self.section(section), section)
        return self.group_section(section).copy()

    def save(self) -> Checkpoint:
        """Copies of all that lasts from run to run; the short lists of pairs follow from it."""
        pairs, state = self.pairs, self.memory[:, : self.layout.starts[memory.FORCE]]
        listed = pairs.listed[:, :, : pairs.info[:, contacts.LISTED].max()]
        kept = (state, self.groups, listed, pairs.changing, pairs.info, np.array(self.radius))
        return tuple(a.copy() for a in kept)

    def restore(self, saved: Checkpoint) -> None:
        """Go back to what was saved."""
        pairs = self.pairs
        state, self.groups[...], listed, pairs.changing[...], pairs.info[...], radius = saved
        if listed.shape[2] > pairs.listed.shape[2]:  # as saved by another engine, whose room has grown
            self.reserve(listed.shape[2])
            pairs = self.pairs
        self.memory[:, : state.shape[1]], pairs.listed[:, :, : listed.shape[2]] = state, listed
        pairs.drift[...] = np.inf
        if float(radius) < self.radius:  # what has been listed may lack pairs that will touch
            self.forget_neighbours(self.memory)

    @property
    def rebuilds(self) -> int:
        """How often the lists of the first robot were built."""
        return int(self.pairs.info[0, contacts.REBUILDS])

    @property
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""
        return int(sum(a.nbytes for a in (self.memory, self.groups, *self.pairs)) / self.batch)
