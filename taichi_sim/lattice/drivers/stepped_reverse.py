"""Memory, kernels and launches of the reverse of the stepped driver: scalars, a kernel per stage of a step (GPU).

The stages are those of the reverse of the fused driver. Where several threads add to the same cotangent they do so
atomically, so on a GPU the last digits of a gradient depend on their order.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from taichi_sim.autodiff.lanes import Real
from taichi_sim.lattice.drivers import fused_reverse_kernel as kernel
from taichi_sim.lattice.drivers.fused import CONTACTS_PER_STEP
from taichi_sim.lattice.drivers.fused_kernel import LANE_DIVERGED
from taichi_sim.lattice.drivers.fused_kernel import LANE_STATE as RUN_STATE
from taichi_sim.lattice.drivers.fused_reverse import filled
from taichi_sim.lattice.drivers.stepped import SteppedRecord, SteppedRun
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages import forcing_adjoint as adjoint
from taichi_sim.lattice.stages.link_adjoint import link_adjoint
from taichi_sim.lattice.stages.memory import LINKS, SQUARES, STATE_SLOTS, VOXELS
from taichi_sim.lattice.stages.voxel_adjoint import gauge_adjoint, voxel_adjoint
from taichi_sim.runtime import ti


@dataclass(frozen=True)
class ReverseKernels:
    """The kernels of a step undone, in the order in which they run."""

    recall: Any
    voxels: Any
    links: Any
    squares: Any
    contacts: Any
    groups: Any
    marks: Any


@lru_cache
def reverse_kernels(real: Real, fluid: bool) -> ReverseKernels:
    """Kernels for one precision, on the ground or in a fluid."""
    reals = ti.types.ndarray(dtype=real.scalar, ndim=2)
    ints1, ints2, ints3, ints4 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2, 3, 4))
    scalars3, scalars4 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (3, 4))

    @ti.kernel
    def recall(
        n: ti.i32, edge: real.scalar, gravity: real.scalar, m: reals, rec: reals, plan: ints1, rest_table: ints2
    ):
        """Parameters of the step that led to record n."""
        for r in range(m.shape[1]):
            adjoint.recall_channels(m, r, rec, r, n * plan[STATE_SLOTS], plan, rest_table, edge, gravity)

    @ti.kernel
    def voxels(
        n: ti.i32,
        dt: real.scalar,
        edge: real.scalar,
        m: reals,
        rec: reals,
        a: reals,
        plan: ints1,
        link_table: ints1,
        voxel_table: ints1,
        lanes: ints3,
    ):
        """Gauges and integration."""
        for v, r in ti.ndrange(plan[VOXELS], m.shape[1]):
            if lanes[0, r, kernel.LANE_STATE] == kernel.LANE_ACTIVE:
                old = n * plan[STATE_SLOTS]
                new = old + plan[STATE_SLOTS]
                if voxel_table[v * columns.VOXEL_COLUMNS + columns.GAUGE] >= 0:
                    gauge_adjoint(m, r, rec, r, new, a, v, plan, link_table, voxel_table)
                voxel_adjoint(m, r, rec, r, old, new, a, v, dt, edge, plan, voxel_table)

    @ti.kernel
    def links(
        n: ti.i32,
        edge: real.scalar,
        m: reals,
        rec: reals,
        a: reals,
        plan: ints1,
        link_table: ints1,
        voxel_table: ints1,
        lanes: ints3,
    ):
        """Beams."""
        for l, r in ti.ndrange(plan[LINKS], m.shape[1]):
            if lanes[0, r, kernel.LANE_STATE] == kernel.LANE_ACTIVE:
                link_adjoint(m, r, rec, r, n * plan[STATE_SLOTS], a, l, edge, plan, link_table, voxel_table, fluid)

    @ti.kernel
    def squares(
        n: ti.i32, m: reals, rec: reals, a: reals, plan: ints1, square_table: ints1, voxel_table: ints1, lanes: ints3
    ):
        """Pressure on the squares of closed surfaces."""
        for q, r in ti.ndrange(plan[SQUARES], m.shape[1]):
            if lanes[0, r, kernel.LANE_STATE] == kernel.LANE_ACTIVE:
                adjoint.square_adjoint(m, r, rec, r, n * plan[STATE_SLOTS], a, q, plan, square_table, voxel_table)

    @ti.kernel
    def contacts(
        n: ti.i32, m: reals, rec: reals, a: reals, plan: ints1, surface: ints1, log: ints4, logged: ints2, lanes: ints3
    ):
        """Contacts between voxels."""
        for q, r in ti.ndrange(log.shape[1], m.shape[1]):
            if q < logged[n, r] and lanes[0, r, kernel.LANE_STATE] == kernel.LANE_ACTIVE:
                s1, s2 = log[n, q, r, 0], log[n, q, r, 1]
                adjoint.contact_adjoint(m, r, rec, r, n * plan[STATE_SLOTS], a, s1, s2, True, plan, surface)

    @ti.kernel
    def groups(
        n: ti.i32,
        edge: real.scalar,
        gravity: real.scalar,
        m: reals,
        rec: reals,
        a: reals,
        plan: ints1,
        rest_table: ints2,
        lanes: ints3,
    ):
        """Rest lengths, groups and channels."""
        for r in range(m.shape[1]):
            if lanes[0, r, kernel.LANE_STATE] == kernel.LANE_ACTIVE:
                adjoint.group_adjoint(m, r, rec, r, (n + 1) * plan[STATE_SLOTS], a, plan, rest_table, edge, gravity)

    @ti.kernel
    def marks(
        n: ti.i32,
        t: ti.i32,
        slots: ti.i32,
        edge: real.scalar,
        m: reals,
        rec: reals,
        a: reals,
        plan: ints1,
        link_table: ints1,
        lanes: ints3,
        event: ints2,
        event_given: reals,
        event_value: reals,
        poses: scalars4,
        strains: scalars3,
        sizes: scalars4,
        finals: scalars3,
    ):
        """Ends of runs, events and recorded poses of step t."""
        for r in range(m.shape[1]):
            kernel.meet_marks(
                m,
                a,
                rec,
                0,
                r,
                0,
                0,
                n * plan[STATE_SLOTS],
                t,
                slots,
                edge,
                plan,
                link_table,
                lanes,
                event,
                event_given,
                event_value,
                poses,
                strains,
                sizes,
                finals,
            )

    return ReverseKernels(recall, voxels, links, squares, contacts, groups, marks)


class SteppedReverse:
    """Cotangents of a batch on their way back through a run."""

    def __init__(
        self, run: SteppedRun, recorded: tuple[np.ndarray, np.ndarray, np.ndarray], finals: np.ndarray
    ) -> None:
        """Start at the end of a run; arguments as for ``FusedReverse``."""
        driver, program = run.driver, run.program
        self.run, self.driver, put, real = run, driver, driver._device, driver.real
        self.layout = driver.tables.layout(forces=(len(driver.tables.group), 6))
        values: np.ndarray = np.zeros((self.layout.slots, driver.batch), real.numpy)
        shared = self.layout.starts[memory.FORCE]
        values[:shared] = driver._host(run.memory)[:shared]
        self._values, self._cotangents = put(values), put(np.zeros_like(values))
        lanes = np.zeros((1, driver.batch, kernel.LANE_COLUMNS), np.int32)
        lanes[0, :, kernel.LANE_EVENT] = program.first[1:]
        lanes[0, :, kernel.LANE_FIRST_EVENT] = program.first[:-1]
        lanes[0, :, kernel.LANE_LENGTH] = program.lengths
        lanes[0, :, kernel.LANE_ROBOT] = np.arange(driver.batch)
        dead = driver._host(run.lanes)[:, RUN_STATE] == LANE_DIVERGED
        lanes[0, :, kernel.LANE_STATE] = np.where(dead, kernel.LANE_DEAD, kernel.LANE_WAITING)
        self._lanes = put(lanes)
        self._marks = {int(program.lengths.max()), *program.lengths.tolist(), *program.marks[:, 0].tolist()}
        self._events = put(np.zeros(program.values.shape, real.numpy))
        self._seeds = [put(filled(np.ascontiguousarray(x, real.numpy))) for x in (*recorded, finals)]
        self._contacts = CONTACTS_PER_STEP
        self._kernels = reverse_kernels(real, driver.tables.fluid)

    @property
    def events(self) -> np.ndarray:
        """Cotangents of (base, rate) of each of the program's marks."""
        return self.driver._host(self._events)

    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""
        record = self._record(low, high)
        self._meet(record, high)
        for t in range(high - 1, low - 1, -1):
            self._undo_step(record, t)
            self._meet(record, t)

    def _record(self, low: int, high: int) -> SteppedRecord:
        start = self.run.checkpoint()
        while True:
            record = self.run.new_record(low, high - low + 1, self._contacts)
            self.run.advance(high, record=record)
            if self.driver._host(record.logged).max(initial=0) <= self._contacts:
                return record
            self._contacts *= 2
            del record  # before the larger one is made
            self.run.restore(start)

    def _undo_step(self, record: SteppedRecord, t: int) -> None:
        k, run, n = self._kernels, self.run, t - record.first
        dt, edge, gravity = run.constants
        m, rec, a, lanes, plan = self._values, record.states, self._cotangents, self._lanes, run._plan
        k.recall(n + 1, edge, gravity, m, rec, plan, run._rest)
        k.voxels(n, dt, edge, m, rec, a, plan, run._link, run._voxel, lanes)
        k.links(n, edge, m, rec, a, plan, run._link, run._voxel, lanes)
        if self.driver._plan[memory.SQUARES]:
            k.squares(n, m, rec, a, plan, run._square, run._voxel, lanes)
        if self.driver._plan[memory.CONTACT_ON]:
            k.contacts(n, m, rec, a, plan, run._surface, record.log, record.logged, lanes)
        k.groups(n, edge, gravity, m, rec, a, plan, run._rest, lanes)

    def _meet(self, record: SteppedRecord, t: int) -> None:
        """Do what is due at step t, once."""
        if t not in self._marks:
            return
        self._marks.remove(t)
        k, run, n = self._kernels, self.run, t - record.first
        _, edge, gravity = run.constants
        k.recall(n, edge, gravity, self._values, record.states, run._plan, run._rest)
        k.marks(
            n,
            t,
            self.layout.slots,
            edge,
            self._values,
            record.states,
            self._cotangents,
            run._plan,
            run._link,
            self._lanes,
            run._marks,
            run.values,
            self._events,
            *self._seeds,
        )

    def read(self, section: int) -> np.ndarray:
        """Cotangents of a section of the memory, shape (B, items, components)."""
        part = self.driver._host(self._cotangents)[self.layout.span(section)]
        return part.T.reshape(self.driver.batch, *self.layout.rows[section]).astype(float)
