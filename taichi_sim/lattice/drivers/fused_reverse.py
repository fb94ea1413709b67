"""Memory and launches of the reverse of the fused driver (see ``reverse_kernel``)."""

import numpy as np

from taichi_sim.lattice.drivers import fused_reverse_kernel as kernel
from taichi_sim.lattice.drivers.fused import CONTACTS_PER_STEP, FusedRun, Record
from taichi_sim.lattice.drivers.fused_kernel import LANE_DIVERGED, LANE_STATE
from taichi_sim.lattice.stages import memory

STEPS_PER_LAUNCH = 250


def filled(array: np.ndarray) -> np.ndarray:
    """The array, or one of a single zero instead of an empty one: kernels take no others."""
    return array if array.size else np.zeros((1,) * array.ndim, array.dtype)


class FusedReverse:
    """Cotangents of a batch on their way back through a run."""

    def __init__(self, run: FusedRun, recorded: tuple[np.ndarray, np.ndarray, np.ndarray], finals: np.ndarray) -> None:
        """Start at the end of a run.

        Args:
            run: that is done.
            recorded: cotangents of poses (B, S, V, 7), strains (B, S, L) and rest sizes of groups (B, S, G, 3).
            finals: cotangents of last states (B, V, 13).
        """
        driver, program = run.driver, run.program
        self.run, self.driver = run, driver
        real = driver.real
        self.layout = driver.tables.layout(forces=(len(driver.tables.group), 6))
        self._cotangents = real.array((driver.blocks, self.layout.slots))
        self._values = real.array((driver.blocks, self.layout.slots))  # only its forces lie elsewhere
        shared = self.layout.starts[memory.FORCE]
        self._values[:, :shared] = driver._memory[:, :shared]
        self._lanes = np.zeros((driver.blocks, real.width, kernel.LANE_COLUMNS), np.int32)
        robot = driver._robot
        self._lanes[..., kernel.LANE_EVENT] = program.first[robot + 1]
        self._lanes[..., kernel.LANE_FIRST_EVENT] = program.first[robot]
        self._lanes[..., kernel.LANE_LENGTH] = program.lengths[robot]
        self._lanes[..., kernel.LANE_ROBOT] = robot
        lives = run.lanes[..., LANE_STATE] != LANE_DIVERGED
        self._lanes[..., kernel.LANE_STATE] = np.where(lives, kernel.LANE_WAITING, kernel.LANE_DEAD)
        self._info = np.full(driver.blocks, int(program.lengths.max()), np.int32)
        self.events: np.ndarray = np.zeros(program.values.shape, real.numpy)
        self._seeds = [filled(np.ascontiguousarray(x, real.numpy)) for x in (*recorded, finals)]
        self._contacts = CONTACTS_PER_STEP
        self._states: np.ndarray | None = None

    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""
        record = self._record(low, high)
        while True:
            middle = max(high - STEPS_PER_LAUNCH, low)
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
            log = np.zeros((driver.blocks, self._contacts * room, 3), np.int32)
            record = Record(low, room, self._states, log, np.zeros((driver.blocks, room), np.int32))
            if self.run.advance(high, record=record):
                return record
            self._contacts *= 2
            self.run.restore(start)

    def _launch(self, record: Record, low: int, high: int) -> None:
        driver, t, width = self.driver, self.driver.tables, self.driver.real.width
        dt, edge, gravity = self.run.constants
        real = driver.real
        kernel.reverse_kernel(real, t.fluid)(
            driver.blocks,
            self.layout.slots,
            high,
            low,
            record.first,
            record.room,
            dt,
            edge,
            gravity,
            real.reals(self._values.reshape(-1, width)),
            self._values.reshape(-1, width),
            real.reals(self._cotangents.reshape(-1, width)),
            self._cotangents.reshape(-1, width),
            real.reals(record.states.reshape(-1, width)),
            record.states.reshape(-1, width),
            driver._plan,
            t.link,
            t.voxel,
            t.rest,
            t.square,
            t.surface,
            real.reals(driver._bits),
            record.log,
            record.log_first,
            self._lanes,
            self._info,
            self.run.program.marks,
            self.run.values,
            self.events,
            *self._seeds,
        )

    def read(self, section: int) -> np.ndarray:
        """Cotangents of a section of the memory, shape (B, items, components)."""
        count, width = self.layout.rows[section]
        lanes_last = self._cotangents[:, self.layout.span(section)].reshape(self.driver.blocks, count, width, -1)
        return np.moveaxis(lanes_last, -1, 1).reshape(-1, count, width)[: self.driver.batch].astype(float)
