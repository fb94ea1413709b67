"""Memory and launches of the fused driver (see ``fused_kernel`` and ``fused_reverse_kernel``)."""

from collections.abc import Callable

import numpy as np

from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real, choose_width
from taichi_sim.lattice.drivers import fused_kernel as kernel
from taichi_sim.lattice.drivers import fused_reverse_kernel as backwards
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.driver import CONTACTS_PER_STEP, Checkpoint, Driver, Reverse, Run
from taichi_sim.lattice.drivers.fused_kernel import Record
from taichi_sim.lattice.drivers.marks import Recordings
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
PAIRS_PER_VOXEL = 8  # room for listed pairs at first; it grows when needed


class FusedReverse(Reverse):
    """The way back by launches of the reverse kernel."""

    def __init__(self, run: "FusedRun", recorded: Recordings, finals: np.ndarray) -> None:
        """Start at the end of a run; the arguments are those of :meth:`Run.reverse`."""
        super().__init__(run, recorded, finals)
        self._upcoming = np.full(self.driver.blocks, int(run.program.lengths.max()), np.int32)

    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""
        driver, record = self.driver, self.record(low, high)
        reals = driver.real.reals
        while True:
            middle = max(high - STEPS_PER_REVERSE, low)
            backwards.reverse_kernel(driver.real, driver.tables.fluid)(
                backwards.Launch(driver.blocks, self.layout.slots, high, middle),
                backwards.Memories(reals(self.values), self.values, reals(self.cotangents), self.cotangents),
                self.run.shared,
                backwards.Turns(driver.lists.bits, self._upcoming),
                record,
                self.marks,
            )
            if middle == low:
                return
            high = middle


class FusedRun(Run):
    """A program on its way by launches of the kernel."""

    reverse_type = FusedReverse

    def __init__(
        self, driver: "FusedDriver", program: PackedProgram, alive: np.ndarray, constants: tuple[float, float, float]
    ) -> None:
        """Put every robot at the start of the program; the constants are time step, edge and gravity."""
        super().__init__(driver, program, alive, constants)
        driver.parked[...] = driver.memory[:, : driver.layout.state_slots]
        driver.lists.info[:, [kernel.STEP, kernel.NEXT_MARK, kernel.STATE]] = 0, 0, kernel.RUNNING
        self._states: np.ndarray | None = None

    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: Record | None = None
    ) -> None:
        """Go on to a step, or to the end; keep every state, and that at the end, in a record if one is given."""
        driver, info = self.driver, self.driver.lists.info
        last = NOWHERE if until is None else until
        info[:, kernel.LOGGED], info[:, kernel.KEPT] = 0, -1
        while ((info[:, kernel.STATE] != kernel.FINISHED) & (info[:, kernel.STEP] < last)).any():
            self._launch(last, record)
            full = info[:, kernel.STATE] == kernel.OUT_OF_PAIRS
            if full.any():
                driver.reserve(2 * int(driver.plan[memory.PAIRS]))
                info[full, kernel.STATE] = kernel.RUNNING
            if tick:
                tick(float(info[:, kernel.STEP].mean()) / self.total)

    def _launch(self, until: int, record: Record | None) -> None:
        driver, edge = self.driver, self.edge
        steps = max(STEPS_PER_LAUNCH // driver.blocks, LEAST_STEPS)
        radius, distance = contact.NEIGHBOUR_RADIUS * edge, contact.REBUILD_DISTANCE * edge
        kernel.fused_kernel(driver.real, record is not None, driver.tables.fluid)(
            kernel.Launch(driver.blocks, driver.layout.slots, steps, until, radius, distance),
            kernel.Memories(driver.real.reals(self.memory), self.memory, driver.put_memory(driver.parked)),
            self.shared,
            driver.lists,
            self.marks,
            record or Record(),
        )

    def finish(self) -> tuple[np.ndarray, np.ndarray, Recordings]:
        """After the last step: robots that ended get their own last states back; then as for any run."""
        d = self.driver
        ended = self.marks.lanes[..., marking.STATE] == marking.ENDED
        np.copyto(d.memory[:, : d.layout.state_slots], d.parked, where=ended[:, None, :])
        if len(d.tables.surface_voxels):
            moves = d.section(memory.VOXEL)[:, d.tables.surface_voxels, :3] - d.section(memory.LISTED)
            x, y, z = np.moveaxis(moves, 2, 0)
            moved = (x * x + y * y + z * z).max(axis=1)
            moved = np.where(np.isnan(moved), np.inf, moved)  # never built
            np.copyto(d.section(memory.MONITOR)[:, 0, memory.MOVED], moved, where=ended)
        return super().finish()

    def checkpoint(self) -> Checkpoint:
        """Copies of all that changes from step to step."""
        return *self.driver.save(self.driver.layout.starts[memory.FORCE]), self.marks.lanes.copy()

    def restore(self, checkpoint: Checkpoint) -> None:
        """Go back to a checkpoint."""
        *saved, lanes = checkpoint
        self.driver.restore(tuple(saved))
        self.marks.lanes[...] = lanes

    def new_record(self, first: int, room: int, contacts: int) -> Record:
        """Memory for so many states from step ``first`` on, and so many contacts of each; its states are used again."""
        blocks, slots, _ = self.driver.parked.shape
        real, count = self.driver.real, blocks * room * slots
        if self._states is None or len(self._states) < count:
            self._states = None  # before the larger one is made
            self._states = real.array((count,))
        log, start = np.zeros((blocks, contacts * room, 3), np.int32), np.zeros((blocks, room), np.int32)
        return Record(True, first, real.reals(self._states), self._states, room, log, start)

    def fits(self, record: Record) -> bool:
        """Whether all contacts found room in a record."""
        return bool((self.driver.lists.info[:, kernel.LOGGED] <= record.contacts.shape[1]).all())

    @property
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""
        return int(self.driver.parked.nbytes) + self.driver.blocks * (12 * CONTACTS_PER_STEP + 4)


class FusedDriver(Driver):
    """A batch in blocks of native vector lanes, with the neighbour lists of the blocks."""

    run_type = FusedRun

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
        real = Real(precision, width or choose_width(batch, precision, threads, BLOCK_COST[precision]))
        super().__init__(tables, batch, real, real.width, (tables.ring, 6), switches)
        self.parked = self.zeros(self.layout.state_slots)
        surface, bunch = max(len(tables.surface_voxels), 1), NATIVE_WIDTH[precision]
        scratch = aligned((self.blocks, 3, -(-surface // bunch), bunch), real.numpy)
        near, bits = aligned((self.blocks, bunch), np.int32), aligned((1, real.width), np.int32)
        bits[0] = np.left_shift(1, np.arange(real.width))
        no_pairs = np.zeros((self.blocks, 2, 0), np.int32)
        self.lists = Lists(
            row=np.zeros((self.blocks, 2, surface + 1), np.int32),
            partner=no_pairs,
            mask=no_pairs,
            info=np.zeros((self.blocks, kernel.INFO_COLUMNS), np.int32),
            bits=real.reals(bits),
            touched=np.zeros((self.blocks, surface), np.int32),
            fresh=np.zeros((self.blocks, surface), np.int32),
            scratch=scratch,
            scratch_scalar=scratch,
            near=near,
            near_scalar=near,
            bunch=bunch,
        )
        self.reserve(PAIRS_PER_VOXEL * surface)

    def reserve(self, pairs: int) -> None:
        """Make room for so many listed pairs a block, keeping the present ones."""
        partner, mask = (np.zeros((self.blocks, 2, pairs), np.int32) for _ in range(2))
        kept = self.lists.partner.shape[2]
        partner[:, :, :kept], mask[:, :, :kept] = self.lists.partner, self.lists.mask
        self.lists = self.lists._replace(partner=partner, mask=mask)
        self.plan[memory.PAIRS] = pairs

    def save(self, slots: int | None = None) -> Checkpoint:
        """Copies of all that lasts from run to run; only the first slots of the memory if asked for."""
        lists = self.lists
        return tuple(a.copy() for a in (self.memory[:, :slots], lists.row, lists.partner, lists.mask, lists.info))

    def restore(self, saved: Checkpoint) -> None:
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
        row, partner, mask, _, _, touched, fresh, scratch = self.lists[:8]
        parts = (self.memory, self.parked, row, partner, mask, touched, fresh, scratch)
        return int(sum(a.nbytes for a in parts) / self.robot.size)
