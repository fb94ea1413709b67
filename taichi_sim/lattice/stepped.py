"""The stepped driver: scalars, a kernel per stage of a time step (GPU; on a CPU for tests and gradients)."""

from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_sim.lanes import Real
from taichi_sim.lattice import contact, memory
from taichi_sim.lattice import fused_kernel as kernel
from taichi_sim.lattice.stepped_kernels import stepped_kernels
from taichi_sim.lattice.tables import PackedProgram, Tables
from taichi_sim.runtime import ti

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

    def run(
        self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float,
        tick: Callable[[float], None],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Run a program from its step 0; returns (steps done, diverged, poses, strains), robots first."""
        lanes = np.zeros((self.batch, kernel.LANE_COLUMNS), np.int32)
        lanes[:, kernel.LANE_EVENT], lanes[:, kernel.LANE_LAST_EVENT] = program.first[:-1], program.first[1:]
        lanes[:, kernel.LANE_LENGTH] = program.lengths
        lanes[:, kernel.LANE_STATE] = np.where(alive, kernel.LANE_ACTIVE, kernel.LANE_DIVERGED)
        slots, links = max(program.slots, 1), max(len(self.tables.link_ends), 1)
        poses = self._device(np.full((self.batch, slots, len(self.tables.group), 7), np.nan, self.real.numpy))
        strains = self._device(np.full((self.batch, slots, links), np.nan, self.real.numpy))
        launch = _Launcher(self, program, dt, edge, gravity, lanes, poses, strains)
        last, step = int(program.lengths.max()), 0
        launch.rebuild_lists()
        while step <= last:
            end = min(step + STEPS_PER_CHECK, last + 1)
            before = launch.save()
            for t in range(step, end):
                launch.step(t)
            if launch.lists_are_full():
                launch.restore(before)
                continue
            step = end
            tick(min(step / max(last, 1), 1.0))
        self._memory = self._host(launch.memory)
        lanes = self._host(launch.lanes)
        diverged = lanes[:, kernel.LANE_STATE] == kernel.LANE_DIVERGED
        steps = lanes[:, kernel.LANE_STEP].copy()
        return steps, diverged, self._host(poses)[:, : program.slots], self._host(strains)[:, : program.slots]


class _Launcher:
    """The arrays of one run on the device, and the kernels that work on them."""

    def __init__(self, driver: SteppedDriver, program: PackedProgram, dt: float, edge: float, gravity: float,
                 lanes: np.ndarray, poses: Any, strains: Any) -> None:  # fmt: skip
        t, self._driver, self._put = driver.tables, driver, driver._device
        self._kernels = stepped_kernels(driver.real)
        self._dt, self._edge, self._gravity, self._poses, self._strains = dt, edge, gravity, poses, strains
        self._link, self._voxel, self._rest = self._put(t.link), self._put(t.voxel), self._put(t.rest)
        self._surface, self._excluded, self._start = (
            self._put(t.surface),
            self._put(t.excluded),
            self._put(driver._start),
        )
        self._marks, self._values = self._put(program.marks), self._put(program.values.astype(driver.real.numpy))
        self._full = self._put(np.zeros(1, np.int32))
        self.memory, self.lanes = self._put(driver._memory), self._put(lanes)
        self._reserve()

    def _reserve(self) -> None:
        surface, batch = max(len(self._driver.tables.surface_voxels), 1), self._driver.batch
        self._plan = self._put(self._driver._plan)
        self._partner = self._put(np.zeros((int(self._driver._plan[memory.PAIRS]), surface, batch), np.int32))
        self._count = self._put(np.zeros((surface, batch), np.int32))

    def step(self, t: int) -> None:
        """One time step of all robots; the last call only ends them."""
        k, m, plan, lanes = self._kernels, self.memory, self._plan, self.lanes
        k.begin(t, self._edge, self._gravity, m, plan, self._link, self._rest, lanes, self._marks, self._values,
                self._poses, self._strains)  # fmt: skip
        if self._driver._plan[memory.CONTACT_ON]:
            self._watch(from_watch=0)
            k.collide(m, plan, self._surface, lanes, self._partner, self._count)
        k.links(self._edge, m, plan, self._link, self._voxel, lanes)
        k.voxels(self._dt, self._edge, m, plan, self._link, self._voxel, self._start, lanes)

    def _watch(self, from_watch: int) -> None:
        self._kernels.watch(
            contact.WATCH_RADIUS * self._edge, contact.REBUILD_DISTANCE * self._edge, from_watch, self.memory,
            self._plan, self._surface, self._excluded, self.lanes, self._partner, self._count, self._full,
        )  # fmt: skip

    def rebuild_lists(self) -> None:
        """Build all lists from the positions at which they were built last: a list is a function of those."""
        if self._driver._plan[memory.CONTACT_ON]:
            self._watch(from_watch=1)
            while self.lists_are_full():
                self._grow()

    def lists_are_full(self) -> bool:
        """Whether a voxel had more partners than there is room for."""
        return bool(self._driver._host(self._full)[0])

    def save(self) -> tuple[np.ndarray, np.ndarray]:
        """Copies of state and marks."""
        return self._driver._host(self.memory).copy(), self._driver._host(self.lanes).copy()

    def restore(self, saved: tuple[np.ndarray, np.ndarray]) -> None:
        """Go back to saved copies, with more room."""
        self.memory, self.lanes = self._put(saved[0]), self._put(saved[1])
        self._grow()

    def _grow(self) -> None:
        self._driver._plan[memory.PAIRS] *= 2
        self._full = self._put(np.zeros(1, np.int32))
        self._reserve()
        self._watch(from_watch=1)
