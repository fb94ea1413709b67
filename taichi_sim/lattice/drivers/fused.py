"""Memory and launches of the fused driver (see ``fused_kernel`` and ``fused_reverse_kernel``)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real, choose_width
from taichi_sim.lattice.drivers import fused_kernel as kernel
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.fused_reverse_kernel import reverse_kernel
from taichi_sim.lattice.drivers.marks import Marks, Recordings
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.neighbours import NOWHERE, REBUILDS, Lists
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.runtime import aligned

# A block of lanes takes about this many times as long as a single robot in scalars (measured).
BLOCK_COST = {"f32": 1.7, "f64": 2.2}
# Block-steps in a launch: it costs about 0.3 ms itself, and short ones keep progress and Ctrl-C responsive.
STEPS_PER_LAUNCH, LEAST_STEPS = 1000, 50
STEPS_PER_REVERSE = 250
CONTACTS_PER_STEP = 256  # room for touching pairs of a block in a record at first; it grows when needed
PAIRS_PER_VOXEL = 8  # room for listed pairs at first; it grows when needed


class FusedDriver:
    """State of a batch in NumPy, laid out [block, slot, lane], and the loop that advances it."""

    def __init__(
        self,
        tables: Tables,
        batch: int,
        precision: str,
        threads: int,
        switches: tuple[bool, bool],
        width: int | None = None,
    ) -> None:
        """Allocate the memory and fill in the constants; ``switches`` are those of floor and self-contact."""
        self.tables, self.batch = tables, batch
        self.real = Real(precision, width or choose_width(batch, precision, threads, BLOCK_COST[precision]))
        width = self.real.width
        self.blocks = -(-batch // width)
        lanes = np.arange(self.blocks * width).reshape(self.blocks, width)
        self.robot = np.minimum(lanes, batch - 1)  # lanes without a robot repeat the last one
        self.has_robot = lanes < batch
        self.layout = tables.layout(forces=(tables.ring, 6))
        self.memory = self.real.array((self.blocks, self.layout.slots))
        self.parked = self.real.array((self.blocks, self.layout.state_slots))
        for section, values in tables.initial_sections():
            self.write(section, values)
        self.shared = tables.shared(tables.plan(self.layout, *switches), self.real.numpy)
        surface, bunch = max(len(tables.surface_voxels), 1), NATIVE_WIDTH[precision]
        scratch = aligned((self.blocks, 3, -(-surface // bunch), bunch), self.real.numpy)
        near, bits = aligned((self.blocks, bunch), np.int32), aligned((1, width), np.int32)
        bits[0] = np.left_shift(1, np.arange(width))
        no_pairs = np.zeros((self.blocks, 2, 0), np.int32)
        self.lists = Lists(
            row=np.zeros((self.blocks, 2, surface + 1), np.int32),
            partner=no_pairs,
            mask=no_pairs,
            info=np.zeros((self.blocks, kernel.INFO_COLUMNS), np.int32),
            bits=self.real.reals(bits),
            touched=np.zeros((self.blocks, surface), np.int32),
            fresh=np.zeros((self.blocks, surface), np.int32),
            scratch=scratch,
            scratch_scalar=scratch,
            near=near,
            near_scalar=near,
            bunch=bunch,
        )
        self.reserve(PAIRS_PER_VOXEL * surface)
        self.forget_neighbours()

    def reserve(self, pairs: int) -> None:
        """Make room for so many listed pairs a block, keeping the present ones."""
        partner, mask = (np.zeros((self.blocks, 2, pairs), np.int32) for _ in range(2))
        kept = self.lists.partner.shape[2]
        partner[:, :, :kept], mask[:, :, :kept] = self.lists.partner, self.lists.mask
        self.lists = self.lists._replace(partner=partner, mask=mask)
        self.shared.plan[memory.PAIRS] = pairs

    def section(self, section: int, of: np.ndarray | None = None) -> np.ndarray:
        """A view of a section of a memory, shape (blocks, items, components, lanes)."""
        whole = self.memory if of is None else of
        return whole[:, self.layout.span(section)].reshape(self.blocks, *self.layout.rows[section], -1)

    def write(self, section: int, values: np.ndarray) -> None:
        """Set a section from values of shape (B, items, components)."""
        self.section(section)[:, : values.shape[1]] = np.moveaxis(values[self.robot], 1, -1)

    def read(self, section: int) -> np.ndarray:
        """A copy of a section, shape (B, items, components)."""
        lanes_last = self.section(section)
        return np.moveaxis(lanes_last, -1, 1).reshape(-1, *lanes_last.shape[1:3])[: self.batch].copy()

    def forget_neighbours(self) -> None:
        """Have the neighbour lists built anew before the next step."""
        self.section(memory.MONITOR)[:, 0, memory.MOVED] = np.inf
        self.section(memory.LISTED)[...] = np.nan

    def save(self, slots: int | None = None) -> tuple[np.ndarray, ...]:
        """Copies of all that lasts from run to run; only the first slots of the memory if asked for."""
        lists = self.lists
        return tuple(a.copy() for a in (self.memory[:, :slots], lists.row, lists.partner, lists.mask, lists.info))

    def restore(self, saved: tuple[np.ndarray, ...]) -> None:
        """Go back to what was saved."""
        slots, row, partner, mask, info = saved
        self.memory[:, : slots.shape[1]], self.lists.row[...], self.lists.info[...] = slots, row, info
        self.lists.partner[:, :, : partner.shape[2]], self.lists.mask[:, :, : mask.shape[2]] = partner, mask

    @property
    def rebuilds(self) -> int:
        """How often the lists of the first block were built."""
        return int(self.lists.info[0, REBUILDS])

    @property
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""
        lists = self.lists
        parts = (
            self.memory,
            self.parked,
            lists.scratch,
            lists.fresh,
            lists.touched,
            lists.row,
            lists.partner,
            lists.mask,
        )
        return int(sum(a.nbytes for a in parts) / self.robot.size)

    def begin(self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float) -> "FusedRun":
        """Start a program at its step 0."""
        return FusedRun(self, program, alive, (dt, edge, gravity))


@dataclass(frozen=True, eq=False)
class Record:
    """States of the blocks before each of the steps ``first`` to ``first`` + room - 2, and the contacts of each.

    Attributes:
        first: step of the first state.
        states: shape (blocks * room, state slots, lanes).
        room: states a block.
        contacts: touching pairs (surface voxel, surface voxel, bits of lanes), shape (blocks, contacts, 3).
        start: first contact of each step, shape (blocks, room).
    """

    first: int
    states: np.ndarray
    room: int
    contacts: np.ndarray
    start: np.ndarray


class FusedRun:
    """A program on its way: the robots' places in it, and what they have recorded so far."""

    def __init__(
        self, driver: FusedDriver, program: PackedProgram, alive: np.ndarray, constants: tuple[float, float, float]
    ) -> None:
        """Put every robot at the start of the program; the constants are time step, edge and gravity."""
        self.driver, self.program, self.constants = driver, program, constants
        d, tables = driver, driver.tables
        runs = alive[d.robot] & d.has_robot
        d.parked[...] = d.memory[:, : d.layout.state_slots]
        d.lists.info[:, [kernel.STEP, kernel.NEXT_MARK, kernel.STATE]] = 0, 0, kernel.RUNNING
        self.marks = Marks(
            marking.lane_table(program, d.robot, np.where(runs, marking.ACTIVE, marking.DIVERGED)),
            program.marks,
            program.values.astype(d.real.numpy),
            *marking.unrecorded(program, d.batch, tables, d.real.numpy),
        )
        self.total = max(int(program.lengths.max()), 1)
        # What kernels get that keep no record.
        self._no_record = Record(0, d.real.array((1, 1)), 0, np.zeros((1, 1, 3), np.int32), np.zeros((1, 1), np.int32))

    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: Record | None = None
    ) -> bool:
        """Go on to a step, or to the end; returns whether all contacts found room in the record."""
        driver, info = self.driver, self.driver.lists.info
        last = NOWHERE if until is None else until
        info[:, kernel.LOGGED], info[:, kernel.KEPT] = 0, -1
        while ((info[:, kernel.STATE] != kernel.FINISHED) & (info[:, kernel.STEP] < last)).any():
            self._launch(last, record)
            full = info[:, kernel.STATE] == kernel.OUT_OF_PAIRS
            if full.any():
                driver.reserve(2 * int(driver.shared.plan[memory.PAIRS]))
                info[full, kernel.STATE] = kernel.RUNNING
            if tick:
                tick(float(info[:, kernel.STEP].mean()) / self.total)
        return record is None or bool((info[:, kernel.LOGGED] <= record.contacts.shape[1]).all())

    def finish(self) -> tuple[np.ndarray, np.ndarray, Recordings]:
        """After the last step: (steps done, diverged, (poses, strains, rest sizes of groups)), robots first."""
        self._unpark()
        flat = self.marks.lanes.reshape(-1, marking.LANE_COLUMNS)[: self.driver.batch]
        diverged = flat[:, marking.STATE] == marking.DIVERGED
        poses, strains, sizes = (a[:, : self.program.slots] for a in self.marks[3:6])
        return flat[:, marking.STEP].copy(), diverged, (poses, strains, sizes)

    def checkpoint(self) -> tuple[np.ndarray, ...]:
        """Copies of all that changes from step to step."""
        return *self.driver.save(self.driver.layout.starts[memory.FORCE]), self.marks.lanes.copy()

    def restore(self, checkpoint: tuple[np.ndarray, ...]) -> None:
        """Go back to a checkpoint."""
        *saved, lanes = checkpoint
        self.driver.restore(tuple(saved))
        self.marks.lanes[...] = lanes

    @property
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""
        return self.driver.parked.nbytes + self.driver.blocks * (12 * CONTACTS_PER_STEP + 4)

    @property
    def most_states(self) -> int:
        """Steps of all robots that a record can hold."""
        return memory.MOST_SLOTS // (self.driver.blocks * self.driver.layout.state_slots)

    @property
    def reverse_bytes(self) -> int:
        """Bytes that reversing takes besides."""
        return 3 * self.driver.memory.nbytes

    def reverse(self, recorded: Recordings, finals: np.ndarray) -> "FusedReverse":
        """Cotangents at the end of the run, ready to go back."""
        return FusedReverse(self, recorded, finals)

    def _unpark(self) -> None:
        """Give every robot that ended its own last state back."""
        d = self.driver
        ended = self.marks.lanes[..., marking.STATE] == marking.ENDED
        np.copyto(d.memory[:, : d.layout.state_slots], d.parked, where=ended[:, None, :])
        if len(d.tables.surface_voxels):
            moves = d.section(memory.VOXEL)[:, d.tables.surface_voxels, :3] - d.section(memory.LISTED)
            x, y, z = np.moveaxis(moves, 2, 0)
            moved = (x * x + y * y + z * z).max(axis=1)
            moved = np.where(np.isnan(moved), np.inf, moved)  # never built
            np.copyto(d.section(memory.MONITOR)[:, 0, memory.MOVED], moved, where=ended)

    def _launch(self, until: int, record: Record | None) -> None:
        d, width, edge = self.driver, self.driver.real.width, self.constants[1]
        flat, kept = d.memory.reshape(-1, width), record or self._no_record
        kernel.fused_kernel(d.real, record is not None, d.tables.fluid)(
            d.blocks,
            d.layout.slots,
            max(STEPS_PER_LAUNCH // d.blocks, LEAST_STEPS),
            until,
            *self.constants,
            contact.NEIGHBOUR_RADIUS * edge,
            contact.REBUILD_DISTANCE * edge,
            d.real.reals(flat),
            flat,
            d.parked.reshape(-1, width),
            *d.shared[:9],
            *d.lists[:-1],
            *self.marks[:6],
            kept.first,
            d.real.reals(kept.states.reshape(-1, width)),
            kept.room,
            kept.contacts,
            kept.start,
        )


class FusedReverse:
    """Cotangents of a batch on their way back through a run."""

    def __init__(self, run: FusedRun, recorded: Recordings, finals: np.ndarray) -> None:
        """Start at the end of a run.

        Args:
            run: that is done.
            recorded: cotangents of poses (B, S, V, 7), strains (B, S, L) and rest sizes of groups (B, S, G, 3).
            finals: cotangents of last states (B, V, 13).
        """
        self.run, self.driver, driver, dtype = run, run.driver, run.driver, run.driver.real.numpy
        self.layout = driver.tables.layout(forces=(len(driver.tables.group), 6))
        self._cotangents = driver.real.array((driver.blocks, self.layout.slots))
        self._values = driver.real.array((driver.blocks, self.layout.slots))  # only its forces lie elsewhere
        shared = self.layout.starts[memory.FORCE]
        self._values[:, :shared] = driver.memory[:, :shared]
        self._upcoming = np.full(driver.blocks, int(run.program.lengths.max()), np.int32)
        self.events: np.ndarray = np.zeros(run.program.values.shape, dtype)
        seeds = {name: marking.filled(x, dtype) for name, x in marking.named(recorded, finals)}
        self._marks = run.marks._replace(lanes=marking.lanes_back(run.marks.lanes), by_value=self.events, **seeds)
        self._contacts = CONTACTS_PER_STEP
        self._states: np.ndarray | None = None

    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""
        record = self._record(low, high)
        while True:
            middle = max(high - STEPS_PER_REVERSE, low)
            self._launch(record, middle, high)
            if middle == low:
                return
            high = middle

    def _record(self, low: int, high: int) -> Record:
        """Run forward and keep every state."""
        driver, room = self.driver, high - low + 1
        if self._states is None or len(self._states) < driver.blocks * room:
            self._states = None  # before the larger one is made
            self._states = driver.real.array((driver.blocks * room, driver.layout.state_slots))
        start = self.run.checkpoint()
        while True:
            contacts = np.zeros((driver.blocks, self._contacts * room, 3), np.int32)
            record = Record(low, self._states, room, contacts, np.zeros((driver.blocks, room), np.int32))
            if self.run.advance(high, record=record):
                return record
            self._contacts *= 2
            self.run.restore(start)

    def _launch(self, record: Record, low: int, high: int) -> None:
        driver, real = self.driver, self.driver.real
        flat = [a.reshape(-1, real.width) for a in (self._values, self._cotangents, record.states)]
        reverse_kernel(real, driver.tables.fluid)(
            driver.blocks,
            self.layout.slots,
            high,
            low,
            record.first,
            record.room,
            *self.run.constants,
            *(view for array in flat for view in (real.reals(array), array)),
            *driver.shared[:9],
            driver.lists.bits,
            record.contacts,
            record.start,
            self._upcoming,
            *self._marks,
        )

    def read(self, section: int) -> np.ndarray:
        """Cotangents of a section of the memory, shape (B, items, components)."""
        count, width = self.layout.rows[section]
        lanes_last = self._cotangents[:, self.layout.span(section)].reshape(self.driver.blocks, count, width, -1)
        return np.moveaxis(lanes_last, -1, 1).reshape(-1, count, width)[: self.driver.batch].astype(float)
