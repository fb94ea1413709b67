"""Memory and launches of the fused driver (see ``fused_kernel``)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real, choose_width
from taichi_sim.lattice.drivers import fused_kernel as kernel
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.runtime import aligned

if TYPE_CHECKING:
    from taichi_sim.lattice.drivers.fused_reverse import FusedReverse

# A block of lanes takes about this many times as long as a single robot in scalars (measured).
BLOCK_COST = {"f32": 1.7, "f64": 2.2}
# Block-steps in a launch: it costs about 0.3 ms itself, and short ones keep progress and Ctrl-C responsive.
STEPS_PER_LAUNCH, LEAST_STEPS = 1000, 50
CONTACTS_PER_STEP = 256  # room for touching pairs of a block in a record at first; it grows when needed
PAIRS_PER_VOXEL = 8  # room for watched pairs at first; it grows when needed


class FusedDriver:
    """State of a batch in NumPy, laid out [block, slot, lane], and the loop that advances it."""

    def __init__(
        self,
        tables: Tables,
        batch: int,
        precision: str,
        threads: int,
        floor: bool,
        self_contact: bool,
        width: int | None = None,
    ) -> None:
        """Allocate the memory and fill in the constants."""
        self.tables, self.batch = tables, batch
        self.real = Real(precision, width or choose_width(batch, precision, threads, BLOCK_COST[precision]))
        width = self.real.width
        self.blocks = -(-batch // width)
        lanes = np.arange(self.blocks * width).reshape(self.blocks, width)
        self._robot = np.minimum(lanes, batch - 1)  # lanes without a robot repeat the last one
        self._has_robot = lanes < batch
        self.layout = tables.layout(forces=(tables.ring, 6))
        self._memory = self.real.array((self.blocks, self.layout.slots))
        self._parked = self.real.array((self.blocks, self.layout.state_slots))
        for section, values in tables.initial_sections():
            self.write(section, values)
        surface, bunch = max(len(tables.surface_voxels), 1), NATIVE_WIDTH[precision]
        self._scratch = aligned((self.blocks, 3, -(-surface // bunch), bunch), self.real.numpy)
        self._near = aligned((self.blocks, bunch), np.int32)
        self._fresh = np.zeros((self.blocks, surface), np.int32)
        self._touched = np.zeros((self.blocks, surface), np.int32)
        self._row = np.zeros((self.blocks, 2, surface + 1), np.int32)
        self._info = np.zeros((self.blocks, kernel.INFO_COLUMNS), np.int32)
        self._bits = aligned((1, width), np.int32)
        self._bits[0] = np.left_shift(1, np.arange(width))
        self._start: np.ndarray = tables.start.astype(self.real.numpy)
        self._plan = tables.plan(self.layout, floor, self_contact)
        self._partner = self._mask = np.zeros((self.blocks, 2, 0), np.int32)
        self._reserve(PAIRS_PER_VOXEL * surface)
        self.forget_watch()

    def _reserve(self, pairs: int) -> None:
        """Make room for so many watched pairs a block, keeping the present ones."""
        partner, mask = (np.zeros((self.blocks, 2, pairs), np.int32) for _ in range(2))
        kept = self._partner.shape[2]
        partner[:, :, :kept], mask[:, :, :kept] = self._partner, self._mask
        self._partner, self._mask = partner, mask
        self._plan[memory.PAIRS] = pairs

    def _section(self, section: int) -> np.ndarray:
        """A view of a section, shape (blocks, items, components, lanes)."""
        return self._memory[:, self.layout.span(section)].reshape(self.blocks, *self.layout.rows[section], -1)

    def write(self, section: int, values: np.ndarray) -> None:
        """Set a section from values of shape (B, items, components)."""
        self._section(section)[:, : values.shape[1]] = np.moveaxis(values[self._robot], 1, -1)

    def read(self, section: int) -> np.ndarray:
        """A copy of a section, shape (B, items, components)."""
        lanes_last = self._section(section)
        return np.moveaxis(lanes_last, -1, 1).reshape(-1, *lanes_last.shape[1:3])[: self.batch].copy()

    def forget_watch(self) -> None:
        """Have the watch lists built anew before the next step."""
        self._section(memory.MONITOR)[:, 0, memory.MOVED] = np.inf
        self._section(memory.WATCH)[...] = np.nan

    def save(self) -> tuple[np.ndarray, ...]:
        """Copies of all that lasts from run to run."""
        return tuple(a.copy() for a in (self._memory, self._row, self._partner, self._mask, self._info))

    def restore(self, saved: tuple[np.ndarray, ...]) -> None:
        """Go back to what was saved."""
        memory, row, partner, mask, info = saved
        self._memory[...], self._row[...], self._info[...] = memory, row, info
        self._partner[:, :, : partner.shape[2]], self._mask[:, :, : mask.shape[2]] = partner, mask

    @property
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""
        arrays = (
            self._memory,
            self._parked,
            self._scratch,
            self._fresh,
            self._touched,
            self._row,
            self._partner,
            self._mask,
        )
        return int(sum(a.nbytes for a in arrays) / self._robot.size)

    def begin(self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float) -> "FusedRun":
        """Start a program at its step 0."""
        return FusedRun(self, program, alive, dt, edge, gravity)


@dataclass(frozen=True, eq=False)
class Record:
    """States of the blocks before each of the steps ``first`` to ``first`` + room - 2, and the contacts of each.

    Attributes:
        first: step of the first state.
        room: states a block.
        states: shape (blocks * room, state slots, lanes).
        log: touching pairs (surface voxel, surface voxel, bits of lanes), shape (blocks, contacts, 3).
        log_first: first contact of each step, shape (blocks, room).
    """

    first: int
    room: int
    states: np.ndarray
    log: np.ndarray
    log_first: np.ndarray


class FusedRun:
    """A program on its way: the robots' places in it, and what they have recorded so far."""

    def __init__(
        self, driver: FusedDriver, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float
    ) -> None:
        """Put every robot at the start of the program."""
        self.driver, self.program, self.constants = driver, program, (dt, edge, gravity)
        d, info = driver, driver._info
        self.lanes = np.zeros((d.blocks, d.real.width, kernel.LANE_COLUMNS), np.int32)
        self.lanes[..., kernel.LANE_EVENT] = program.first[d._robot]
        self.lanes[..., kernel.LANE_LAST_EVENT] = program.first[d._robot + 1]
        self.lanes[..., kernel.LANE_LENGTH] = program.lengths[d._robot]
        self.lanes[..., kernel.LANE_ROBOT] = d._robot
        runs = alive[d._robot] & d._has_robot
        self.lanes[..., kernel.LANE_STATE] = np.where(runs, kernel.LANE_ACTIVE, kernel.LANE_DIVERGED)
        d._parked[...] = d._memory[:, : d.layout.state_slots]
        info[:, [kernel.INFO_STEP, kernel.INFO_NEXT_MARK, kernel.INFO_STATE]] = 0, 0, kernel.RUNNING
        slots, links = max(program.slots, 1), max(len(d.tables.link_ends), 1)
        self.poses: np.ndarray = np.full((d.batch, slots, len(d.tables.group), 7), np.nan, d.real.numpy)
        self.strains: np.ndarray = np.full((d.batch, slots, links), np.nan, d.real.numpy)
        self.sizes: np.ndarray = np.full((d.batch, slots, len(d.tables.group_region), 3), np.nan, d.real.numpy)
        self.values: np.ndarray = program.values.astype(d.real.numpy)
        self.total = max(int(program.lengths.max()), 1)
        # What kernels get that keep no record.
        self._no_record = Record(0, 0, d.real.array((1, 1)), np.zeros((1, 1, 3), np.int32), np.zeros((1, 1), np.int32))

    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: Record | None = None
    ) -> bool:
        """Go on to a step, or to the end; returns whether all contacts found room in the record."""
        driver, info = self.driver, self.driver._info
        last = kernel.NOWHERE if until is None else until
        info[:, kernel.INFO_LOGGED], info[:, kernel.INFO_KEPT] = 0, -1
        while ((info[:, kernel.INFO_STATE] != kernel.FINISHED) & (info[:, kernel.INFO_STEP] < last)).any():
            self._launch(last, record)
            full = info[:, kernel.INFO_STATE] == kernel.OUT_OF_PAIRS
            if full.any():
                driver._reserve(2 * int(driver._plan[memory.PAIRS]))
                info[full, kernel.INFO_STATE] = kernel.RUNNING
            if tick:
                tick(float(info[:, kernel.INFO_STEP].mean()) / self.total)
        return record is None or bool((info[:, kernel.INFO_LOGGED] <= record.log.shape[1]).all())

    def finish(self) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """After the last step: (steps done, diverged, (poses, strains, rest sizes of groups)), robots first."""
        self._unpark()
        flat = self.lanes.reshape(-1, kernel.LANE_COLUMNS)[: self.driver.batch]
        diverged = flat[:, kernel.LANE_STATE] == kernel.LANE_DIVERGED
        slots = self.program.slots
        recorded = self.poses[:, :slots], self.strains[:, :slots], self.sizes[:, :slots]
        return flat[:, kernel.LANE_STEP].copy(), diverged, recorded

    def checkpoint(self) -> tuple[np.ndarray, ...]:
        """Copies of all that changes from step to step."""
        d = self.driver
        return tuple(
            a.copy()
            for a in (d._memory[:, : d.layout.starts[memory.FORCE]], d._row, d._partner, d._mask, d._info, self.lanes)
        )

    def restore(self, checkpoint: tuple[np.ndarray, ...]) -> None:
        """Go back to a checkpoint."""
        d = self.driver
        state, row, partner, mask, info, lanes = checkpoint
        d._memory[:, : state.shape[1]], d._row[...], d._info[...], self.lanes[...] = state, row, info, lanes
        d._partner[:, :, : partner.shape[2]], d._mask[:, :, : mask.shape[2]] = partner, mask

    @property
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""
        d = self.driver
        return d._parked.nbytes + d.blocks * (12 * CONTACTS_PER_STEP + 4)

    @property
    def most_states(self) -> int:
        """Steps of all robots that a record can hold."""
        d = self.driver
        return memory.MOST_SLOTS // (d.blocks * d.layout.state_slots)

    @property
    def reverse_bytes(self) -> int:
        """Bytes that reversing takes besides."""
        return 3 * self.driver._memory.nbytes

    def reverse(self, recorded: tuple[np.ndarray, np.ndarray, np.ndarray], finals: np.ndarray) -> "FusedReverse":
        """Cotangents at the end of the run, ready to go back."""
        from taichi_sim.lattice.drivers.fused_reverse import FusedReverse

        return FusedReverse(self, recorded, finals)

    def _unpark(self) -> None:
        """Give every robot that ended its own last state back."""
        d = self.driver
        ended = self.lanes[..., kernel.LANE_STATE] == kernel.LANE_ENDED
        np.copyto(d._memory[:, : d.layout.state_slots], d._parked, where=ended[:, None, :])
        if len(d.tables.surface_voxels):
            moves = d._section(memory.VOXEL)[:, d.tables.surface_voxels, :3] - d._section(memory.WATCH)
            moved = (
                moves[:, :, 0] * moves[:, :, 0] + moves[:, :, 1] * moves[:, :, 1] + moves[:, :, 2] * moves[:, :, 2]
            ).max(axis=1)
            moved = np.where(np.isnan(moved), np.inf, moved)  # never built
            np.copyto(d._section(memory.MONITOR)[:, 0, memory.MOVED], moved, where=ended)

    def _launch(self, until: int, record: Record | None) -> None:
        d, t, width = self.driver, self.driver.tables, self.driver.real.width
        dt, edge, gravity = self.constants
        steps = max(STEPS_PER_LAUNCH // d.blocks, LEAST_STEPS)
        kept = record or self._no_record
        kernel.fused_kernel(d.real, record is not None, t.fluid)(
            d.blocks,
            d.layout.slots,
            steps,
            until,
            dt,
            edge,
            gravity,
            contact.WATCH_RADIUS * edge,
            contact.REBUILD_DISTANCE * edge,
            d.real.reals(d._memory.reshape(-1, width)),
            d._memory.reshape(-1, width),
            d._parked.reshape(-1, width),
            d._plan,
            t.link,
            t.voxel,
            t.rest,
            t.square,
            t.corner,
            t.surface,
            t.excluded,
            d._start,
            d.real.reals(d._bits),
            d._scratch,
            d._scratch,
            d._near,
            d._near,
            d._touched,
            d._fresh,
            d._row,
            d._partner,
            d._mask,
            d._info,
            self.lanes,
            self.program.marks,
            self.values,
            self.poses,
            self.strains,
            self.sizes,
            kept.first,
            d.real.reals(kept.states.reshape(-1, width)),
            kept.room,
            kept.log,
            kept.log_first,
        )
