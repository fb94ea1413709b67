"""Memory and launches of the fused driver (see ``fused_kernel``)."""

from collections.abc import Callable

import numpy as np

from taichi_sim.lanes import NATIVE_WIDTH, Real
from taichi_sim.lattice import contact, memory
from taichi_sim.lattice import fused_kernel as kernel
from taichi_sim.lattice.tables import PackedProgram, Tables
from taichi_sim.runtime import aligned

# A block of lanes takes about this many times as long as a single robot in scalars (measured).
BLOCK_COST = {"f32": 1.7, "f64": 2.2}
# Block-steps in a launch: it costs about 0.3 ms itself, and short ones keep progress and Ctrl-C responsive.
STEPS_PER_LAUNCH, LEAST_STEPS = 1000, 50
PAIRS_PER_VOXEL = 8  # room for watched pairs at first; it grows when needed


def choose_width(batch: int, precision: str, threads: int) -> int:
    """Robots per real that finish a batch soonest; results do not depend on it."""
    native = NATIVE_WIDTH[precision]
    blocks = -(-batch // native)
    return native if -(-blocks // threads) * BLOCK_COST[precision] < -(-batch // threads) else 1


class FusedDriver:
    """State of a batch in NumPy, laid out [block, slot, lane], and the loop that advances it."""

    def __init__(self, tables: Tables, batch: int, precision: str, threads: int, floor: bool, self_contact: bool,
                 width: int | None = None) -> None:  # fmt: skip
        """Allocate the memory and fill in the constants."""
        self.tables, self.batch = tables, batch
        self.real = Real(precision, width or choose_width(batch, precision, threads))
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

    def run(
        self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float,
        tick: Callable[[float], None],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Run a program from its step 0; returns (steps done, diverged, poses, strains), robots first."""
        lanes = np.zeros((self.blocks, self.real.width, kernel.LANE_COLUMNS), np.int32)
        lanes[..., kernel.LANE_EVENT] = program.first[self._robot]
        lanes[..., kernel.LANE_LAST_EVENT] = program.first[self._robot + 1]
        lanes[..., kernel.LANE_LENGTH] = program.lengths[self._robot]
        lanes[..., kernel.LANE_ROBOT] = self._robot
        runs = alive[self._robot] & self._has_robot
        lanes[..., kernel.LANE_STATE] = np.where(runs, kernel.LANE_ACTIVE, kernel.LANE_DIVERGED)
        self._parked[...] = self._memory[:, : self.layout.state_slots]
        self._info[:, [kernel.INFO_STEP, kernel.INFO_NEXT_MARK, kernel.INFO_STATE]] = 0, 0, kernel.RUNNING
        slots, links = max(program.slots, 1), max(len(self.tables.link_ends), 1)
        poses: np.ndarray = np.full((self.batch, slots, len(self.tables.group), 7), np.nan, self.real.numpy)
        strains: np.ndarray = np.full((self.batch, slots, links), np.nan, self.real.numpy)
        values: np.ndarray = program.values.astype(self.real.numpy)
        total = max(int(program.lengths.max()), 1)
        while (self._info[:, kernel.INFO_STATE] != kernel.FINISHED).any():
            self._launch(dt, edge, gravity, lanes, program.marks, values, poses, strains)
            full = self._info[:, kernel.INFO_STATE] == kernel.OUT_OF_PAIRS
            if full.any():
                self._reserve(2 * int(self._plan[memory.PAIRS]))
                self._info[full, kernel.INFO_STATE] = kernel.RUNNING
            tick(float(self._info[:, kernel.INFO_STEP].mean()) / total)
        self._unpark(lanes)
        flat = lanes.reshape(-1, kernel.LANE_COLUMNS)[: self.batch]
        diverged = flat[:, kernel.LANE_STATE] == kernel.LANE_DIVERGED
        return flat[:, kernel.LANE_STEP].copy(), diverged, poses[:, : program.slots], strains[:, : program.slots]

    def _unpark(self, lanes: np.ndarray) -> None:
        """Give every robot that ended its own last state back."""
        ended = lanes[..., kernel.LANE_STATE] == kernel.LANE_ENDED
        np.copyto(self._memory[:, : self.layout.state_slots], self._parked, where=ended[:, None, :])
        if len(self.tables.surface_voxels):
            d = self._section(memory.VOXEL)[:, self.tables.surface_voxels, :3] - self._section(memory.WATCH)
            moved = (d[:, :, 0] * d[:, :, 0] + d[:, :, 1] * d[:, :, 1] + d[:, :, 2] * d[:, :, 2]).max(axis=1)
            moved = np.where(np.isnan(moved), np.inf, moved)  # never built
            np.copyto(self._section(memory.MONITOR)[:, 0, memory.MOVED], moved, where=ended)

    def _launch(self, dt: float, edge: float, gravity: float, lanes: np.ndarray, marks: np.ndarray, values: np.ndarray,
                poses: np.ndarray, strains: np.ndarray) -> None:  # fmt: skip
        t, width = self.tables, self.real.width
        steps = max(STEPS_PER_LAUNCH // self.blocks, LEAST_STEPS)
        kernel.fused_kernel(self.real)(
            self.blocks, self.layout.slots, steps, dt, edge, gravity, contact.WATCH_RADIUS * edge,
            contact.REBUILD_DISTANCE * edge, self.real.reals(self._memory.reshape(-1, width)),
            self._memory.reshape(-1, width), self._parked.reshape(-1, width), self._plan, t.link, t.voxel, t.rest,
            t.surface, t.excluded, self._start, self.real.reals(self._bits), self._scratch, self._scratch,
            self._near, self._near, self._touched, self._fresh, self._row, self._partner, self._mask,
            self._info, lanes, marks, values, poses, strains,
        )  # fmt: skip
