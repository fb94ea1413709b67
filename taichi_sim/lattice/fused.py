"""Memory and launches of the fused driver (see ``fused_kernel``)."""

from collections.abc import Callable

import numpy as np

from taichi_sim.lanes import NATIVE_WIDTH, Real
from taichi_sim.lattice import contact, stages
from taichi_sim.lattice import fused_kernel as kernel
from taichi_sim.lattice.fused_kernel import fused_kernel
from taichi_sim.lattice.tables import PackedProgram, Tables
from taichi_sim.lattice.watch import PAIRS
from taichi_sim.runtime import aligned

# A block of 16 lanes takes about this many times as long as a single robot in scalars (measured; 8 lanes of f64 alike).
BLOCK_COST = 2.5
NEW_LINK = 2.0
STEPS_PER_LAUNCH = 1000  # a launch costs about 0.3 ms; short ones keep progress and Ctrl-C responsive


def choose_width(batch: int, precision: str, threads: int) -> int:
    """Robots per real that finish a batch soonest; results do not depend on it."""
    native = NATIVE_WIDTH[precision]
    blocks = -(-batch // native)
    return native if -(-blocks // threads) * BLOCK_COST < -(-batch // threads) else 1


class FusedDriver:
    """State of a batch in NumPy, laid out [block, item, component, lane], and the loop that advances it."""

    def __init__(self, tables: Tables, batch: int, precision: str, threads: int, switches: tuple[bool, bool, bool],
                 width: int | None = None) -> None:  # fmt: skip
        """Allocate and fill the state; switches are (floor, self-contact, Poisson)."""
        self.tables, self.batch = tables, batch
        self.real = Real(precision, width or choose_width(batch, precision, threads))
        width = self.real.width
        # As many robots in each block as in the others, as many blocks as threads can share.
        self.blocks = -(-batch // width)
        lanes = np.arange(self.blocks * width).reshape(self.blocks, width)
        self.robot = np.minimum(lanes, batch - 1)  # lanes without a robot repeat the last one
        self.real_lane = lanes < batch
        voxels, surface = len(tables.voxel), len(tables.surface)
        self._rows = {
            "voxel": (voxels, stages.VOXEL_WIDTH),
            "link": (len(tables.link), stages.LINK_WIDTH),
            "channel": (tables.channel.shape[1], stages.CHANNEL_WIDTH),
            "strain": (max(tables.strain_count, 1), stages.STRAIN_WIDTH),
            "watch": (max(surface, 1), 3),
            "monitor": (1, 2),
        }
        groups = len(tables.group_region)
        scratch = {
            "current": (groups, stages.CURRENT_WIDTH),
            "constant": tables.constant.shape[1:],
            "beam": (max(tables.beam.shape[1], 1), tables.beam.shape[2]),
            "rest": (len(tables.rest), 2),
            "contact": (max(surface, 1), 3),
            "ring": (tables.ring, 6),
        }
        self.a = {name: self.real.array((self.blocks, *shape)) for name, shape in (self._rows | scratch).items()}
        self._parked = {name: self.real.array((self.blocks, *self._rows[name])) for name in ("voxel", "link", "strain", "channel")}
        self._fill("constant", tables.constant)
        self._fill("beam", tables.beam)
        self.write("channel", tables.channel)
        self.a["link"][:, :, stages.LINK_STATE] = NEW_LINK
        self.a["monitor"][:, :, stages.MOVED] = np.inf
        bunch = NATIVE_WIDTH[precision]
        self._scratch = aligned((self.blocks, 3, -(-max(surface, 1) // bunch), bunch), self.real.numpy)
        self._fresh = np.zeros((self.blocks, max(surface, 1)), np.int32)
        self._touched = np.zeros((self.blocks, max(surface, 1)), np.int32)
        self._row = np.zeros((self.blocks, 2, surface + 1), np.int32)
        self._info = np.zeros((self.blocks, kernel.INFO_COLUMNS), np.int32)
        self._bits = aligned((1, width), np.int32)
        self._bits[0] = np.left_shift(1, np.arange(width))
        self._sizes = np.zeros(kernel.SIZES, np.int32)
        self._sizes[:4] = voxels, groups, len(tables.rest), surface
        self._sizes[kernel.USES_FLOOR], self._sizes[kernel.USES_CONTACT], self._sizes[kernel.USES_POISSON] = switches
        self._sizes[kernel.RING_MASK] = tables.ring - 1
        self._reserve(8 * max(surface, 1))

    def _reserve(self, pairs: int) -> None:
        """Make room for so many watched pairs a block, keeping the present ones."""
        partner, mask = (np.zeros((self.blocks, 2, pairs), np.int32) for _ in range(2))
        if hasattr(self, "_partner"):
            kept = self._partner.shape[2]
            partner[:, :, :kept], mask[:, :, :kept] = self._partner, self._mask
        self._partner, self._mask = partner, mask
        self._sizes[kernel.SIZE_PAIRS] = pairs

    def _fill(self, name: str, values: np.ndarray) -> None:
        """Spread values (B, items, components) over the lanes."""
        self.a[name][:, : values.shape[1]] = np.moveaxis(values[self.robot], 1, -1)

    def write(self, name: str, values: np.ndarray) -> None:
        """Set an array of the state from (B, items, components)."""
        self._fill(name, values)

    def read(self, name: str) -> np.ndarray:
        """An array of the state as (B, items, components)."""
        lanes_last = self.a[name]
        return np.moveaxis(lanes_last, -1, 1).reshape(-1, *lanes_last.shape[1:3])[: self.batch].copy()

    def forget_watch(self) -> None:
        """Have the watch lists built anew before the next step."""
        self.a["monitor"][:, :, stages.MOVED] = np.inf

    @property
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""
        arrays = [*self.a.values(), *self._parked.values(), self._scratch, self._fresh, self._touched, self._row]
        arrays += [self._partner, self._mask]
        return int(sum(a.nbytes for a in arrays) / self.blocks / self.real.width)

    @property
    def watched_pairs(self) -> np.ndarray:
        """Pairs in each block's list."""
        return self._info[:, PAIRS]

    def run(
        self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float,
        tick: Callable[[float], None],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Run a program from its step 0; returns (steps done, diverged, poses, strains), robots first."""
        lanes = np.zeros((self.blocks, self.real.width, kernel.LANE_COLUMNS), np.int32)
        lanes[..., kernel.LANE_EVENT] = program.first[self.robot]
        lanes[..., kernel.LANE_LAST_EVENT] = program.first[self.robot + 1]
        lanes[..., kernel.LANE_LENGTH] = program.lengths[self.robot]
        lanes[..., kernel.LANE_ROBOT] = self.robot
        lanes[..., kernel.LANE_STATE] = np.where(alive[self.robot], kernel.LANE_ACTIVE, kernel.LANE_DIVERGED)
        lanes[~self.real_lane, kernel.LANE_STATE] = kernel.LANE_DIVERGED
        for name, parked in self._parked.items():
            parked[...] = self.a[name]
        self._info[:, [kernel.INFO_STEP, kernel.INFO_NEXT_MARK, kernel.INFO_STATE]] = 0, 0, kernel.RUNNING
        poses = np.full((self.batch, max(program.slots, 1), len(self.tables.voxel), 7), np.nan, self.real.numpy)
        strains = np.full((self.batch, max(program.slots, 1), len(self.tables.link)), np.nan, self.real.numpy)
        values = program.values.astype(self.real.numpy)
        total = max(int(program.lengths.max()), 1)
        while (self._info[:, kernel.INFO_STATE] != kernel.FINISHED).any():
            self._launch(dt, edge, gravity, lanes, program.marks, values, poses, strains)
            full = self._info[:, kernel.INFO_STATE] == kernel.OUT_OF_PAIRS
            if full.any():
                self._reserve(2 * int(self._sizes[kernel.SIZE_PAIRS]))
                self._info[full, kernel.INFO_STATE] = kernel.RUNNING
            tick(float(self._info[:, kernel.INFO_STEP].mean()) / total)
        self._unpark(lanes)
        flat = lanes.reshape(-1, kernel.LANE_COLUMNS)[: self.batch]
        diverged = flat[:, kernel.LANE_STATE] == kernel.LANE_DIVERGED
        return flat[:, kernel.LANE_STEP].copy(), diverged, poses[:, : program.slots], strains[:, : program.slots]

    def _unpark(self, lanes: np.ndarray) -> None:
        """Give every robot that ended its own last state back."""
        ended = lanes[..., kernel.LANE_STATE] == kernel.LANE_ENDED
        for name, parked in self._parked.items():
            np.copyto(self.a[name], parked, where=ended[:, None, None, :])
        if len(self.tables.surface):
            d = self.a["voxel"][:, self.tables.surface, :3] - self.a["watch"]
            moved = (d[:, :, 0] * d[:, :, 0] + d[:, :, 1] * d[:, :, 1] + d[:, :, 2] * d[:, :, 2]).max(axis=1)
            np.copyto(self.a["monitor"][:, 0, stages.MOVED], moved, where=ended)

    def _launch(self, dt: float, edge: float, gravity: float, lanes: np.ndarray, marks: np.ndarray, values: np.ndarray,
                poses: np.ndarray, strains: np.ndarray) -> None:  # fmt: skip
        t, a, reals = self.tables, self.a, self.real.reals
        fused_kernel(self.real)(
            self.blocks, STEPS_PER_LAUNCH, dt, edge, gravity, contact.WATCH_RADIUS * edge, contact.REBUILD_DISTANCE * edge,
            self._sizes, t.link, t.voxel, t.rest, t.surface, t.excluded, t.start.astype(self.real.numpy), reals(self._bits),
            *(reals(a[name]) for name in ("voxel", "link", "channel", "current", "constant", "beam", "rest", "strain",
                                          "contact", "watch", "monitor", "ring")),
            *(a[name] for name in ("voxel", "link", "channel", "rest", "strain", "watch", "monitor")),
            *(self._parked[name] for name in ("voxel", "link", "strain", "channel")),
            self._scratch, self._scratch, self._touched, self._fresh, self._row, self._partner, self._mask, self._info,
            lanes, marks, values, poses, strains,
        )  # fmt: skip
