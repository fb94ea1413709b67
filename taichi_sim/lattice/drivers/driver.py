"""What every driver has in common: the memory of a batch, a run of a program, and the way back through it.

Memories are laid out [block, slot, lane]. A driver says how many lanes a block has, and how the stages of a step run.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from taichi_sim.autodiff.lanes import Real
from taichi_sim.base.arrays import aligned
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.marks import Marks, Recordings
from taichi_sim.lattice.drivers.neighbourhood import Extremes, list_radius
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.store import NeverCopied

CONTACTS_PER_STEP = 256  # room for touching pairs of a block or robot in a record at first; it grows when needed

Checkpoint = tuple[Any, ...]  # of arrays where the kernels run


class Driver(NeverCopied, ABC):
    """State of a batch, in NumPy between runs."""

    run_type: type["Run"]
    lists_grow = True  # whether lists of neighbours reach farther where voxels grow
    radius = contact.NEIGHBOUR_RADIUS  # within which lists hold the neighbours of a voxel [edges]

    def __init__(
        self, tables: Tables, batch: int, real: Real, lanes: int, forces: tuple[int, int], switches: tuple[bool, bool]
    ) -> None:
        """Allocate the memory and fill in the constants.

        Args:
            tables: of the batch.
            batch: number of robots B.
            real: what kernels compute with.
            lanes: robots a block.
            forces: items and width of the section FORCE.
            switches: those of floor and self-contact.
        """
        self.tables, self.batch, self.real = tables, batch, real
        self.blocks = -(-batch // lanes)
        places = np.arange(self.blocks * lanes).reshape(self.blocks, lanes)
        self.robot = np.minimum(places, batch - 1)  # lanes without a robot repeat the last one
        self.has_robot = places < batch
        self.layout = tables.layout(forces)
        self.state_slots = self.layout.state_slots
        self.plan = tables.plan(self.layout, *switches)
        self.memory = self.zeros(self.layout.slots)
        for section, values in tables.initial_sections():
            self.write(section, values)
        self.forget_neighbours(self.memory)

    def radius_for(self, extremes: Extremes) -> float:
        """Radius [edges] of lists of voxels that grow so far."""
        return list_radius(extremes.largest(self.tables.constant)) if self.lists_grow else contact.NEIGHBOUR_RADIUS

    def fit_lists(self, extremes: Extremes) -> None:
        """Have lists reach as far as a run needs that begins with what is in the memory."""
        if (radius := self.radius_for(extremes)) > self.radius:  # lists may lack pairs that will touch
            self.forget_neighbours(self.memory)
        self.radius = radius

    def zeros(self, slots: int) -> np.ndarray:
        """Memory of so many slots a robot, shape (blocks, slots, lanes)."""
        return aligned((self.blocks, slots, self.robot.shape[1]), self.real.numpy)

    def section(self, section: int) -> np.ndarray:
        """A view of a section of the memory, shape (blocks, items, components, lanes)."""
        return self.layout.section(self.memory, section)

    def write(self, section: int, values: np.ndarray) -> None:
        """Set a section from values of shape (B, items, components)."""
        self.fill(self.section(section), section, values)

    def fill(self, view: np.ndarray, section: int, values: np.ndarray) -> None:
        """Set the view of a section (blocks, items, components, lanes) from values of shape (B, items, components)."""
        view[:, : values.shape[1]] = np.moveaxis(values[self.robot], 1, -1)

    def read(self, section: int) -> np.ndarray:
        """A copy of a section, shape (B, items, components)."""
        return self.robots_first(self.section(section)).copy()

    def robots_first(self, lanes_last: np.ndarray) -> np.ndarray:
        """Values of shape (blocks, items, components, lanes), as shape (B, items, components)."""
        return np.moveaxis(lanes_last, -1, 1).reshape(-1, *lanes_last.shape[1:3])[: self.batch]

    def forget_neighbours(self, of: np.ndarray) -> None:
        """Have the neighbour lists of a memory, shape (blocks, slots, lanes), built anew before the next step."""
        self.layout.section(of, memory.MONITOR)[:, 0, memory.MOVED] = np.inf
        self.layout.section(of, memory.LISTED)[...] = np.nan

    def put(self, array: np.ndarray) -> Any:
        """The array where the kernels run."""
        return array

    def put_memory(self, array: np.ndarray) -> Any:
        """A memory where the kernels run, as scalars [slot of any block, lane]."""
        return self.put(array.reshape(-1, array.shape[-1]))

    def blank_memory(self, slots: int) -> Any:
        """A memory of zeros where the kernels run, as scalars [slot of any block, lane]."""
        return self.put_memory(self.zeros(slots))

    def bytes_of(self, array: Any) -> int:
        """Bytes of an array where the kernels run."""
        return int(array.nbytes)

    def host(self, array: Any) -> np.ndarray:
        """An array from where the kernels run, in NumPy."""
        found: np.ndarray = array
        return found

    def snapshot(self, recorded: Any, number: int) -> np.ndarray:
        """One snapshot of recorded poses or strains, shape (B, V, 7) or (B, L)."""
        found: np.ndarray = recorded[:, number]
        return found

    def add_to_snapshot(self, recorded: Any, number: int, values: np.ndarray) -> None:
        """Add to one snapshot of recorded poses or strains, shape (B, V, 7) or (B, L)."""
        recorded[:, number] += values

    def host_memory(self, array: Any) -> np.ndarray:
        """A memory from where the kernels run, in NumPy, shape (blocks, slots, lanes)."""
        return self.host(array).reshape(self.blocks, -1, self.robot.shape[1])

    def put_back(self, whole: np.ndarray, into: Any) -> None:
        """Copy what :meth:`host_memory` gave to where it came from, if it is not that memory itself."""
        if not isinstance(into, np.ndarray):
            into.from_numpy(np.ascontiguousarray(whole.reshape(into.shape)))

    @property
    def backward_layout(self) -> memory.Memory:
        """The memory on the way back, where every voxel has its own cotangents of forces."""
        return self.tables.layout(forces=(len(self.tables.group), 6))

    @property
    @abstractmethod
    def bytes_per_robot(self) -> int:
        """Memory that grows with the batch [B]."""

    @abstractmethod
    def save(self) -> Checkpoint:
        """Copies of all that lasts from run to run."""

    @abstractmethod
    def restore(self, saved: Checkpoint) -> None:
        """Go back to what was saved."""

    def begin(self, program: PackedProgram, alive: np.ndarray, dt: float, edge: float, gravity: float) -> "Run":
        """Start a program at its step 0; robots that are not alive do nothing."""
        return self.run_type(self, program, alive, (dt, edge, gravity))


class Sizes(NamedTuple):
    """Which of some marks set sizes, where their channels are in the run's extremes, and for how many steps."""

    chosen: np.ndarray
    places: np.ndarray
    steps: np.ndarray


NO_SIZES = Sizes(*[np.zeros(0, int)] * 3)


class Run(NeverCopied, ABC):
    """A program on its way: the robots' places in it, and what they have recorded so far."""

    reverse_type: type["Reverse"]

    def __init__(
        self, driver: Any, program: PackedProgram, alive: np.ndarray, constants: tuple[float, float, float]
    ) -> None:
        """Put every robot at the start of the program; the constants are time step, edge and gravity."""
        self.driver, self.program, self.edge = driver, program, constants[1]
        channels = driver.read(memory.CHANNEL).reshape(driver.batch, -1, memory.CHANNEL_WIDTH)
        self._extremes = Extremes(channels, program)
        driver.fit_lists(self._extremes)
        tables, dtype, put = driver.tables, driver.real.numpy, driver.put
        runs = alive[driver.robot] & driver.has_robot
        lanes = marking.lane_table(program, driver.robot, np.where(runs, marking.ACTIVE, marking.DIVERGED))
        recorded = marking.unrecorded(program, driver.batch, tables, dtype)
        self.marks = Marks(*map(put, (lanes, program.marks, program.values.astype(dtype), *recorded)))
        self.memory = driver.put_memory(driver.memory)
        self.shared = tables.shared(driver.plan, constants, dtype, put)._replace(radius=driver.radius * self.edge)
        self.total = max(int(program.lengths.max()), 1)

    @abstractmethod
    def advance(
        self, until: int | None = None, tick: Callable[[float], None] | None = None, record: Any = None
    ) -> None:
        """Go on to a step, or to the end; keep every state, and that at the end, in a record if one is given."""

    def sizes_among(self, rows: np.ndarray, ends: np.ndarray) -> list[Sizes]:
        """Which sizes are set by each part of some marks; part n reaches from ``ends[n]`` to ``ends[n + 1]``."""
        if not self.driver.lists_grow:  # nothing depends on sizes
            return [NO_SIZES] * (len(ends) - 1)
        places = self._extremes.places[rows]
        chosen = np.flatnonzero(places >= 0)
        cuts = np.searchsorted(chosen, ends)
        found = chosen - np.repeat(ends[:-1], np.diff(cuts)), places[chosen], self._extremes.lasting[rows[chosen]]
        return [Sizes(*(array[a:b] for array in found)) for a, b in pairwise(cuts.tolist())]

    def decide(self, rows: np.ndarray, values: np.ndarray, sizes: Sizes) -> None:
        """Set value and rate, shape (N, 2), of the events at some marks; ``sizes`` are from :meth:`sizes_among`."""
        driver, (chosen, places, steps) = self.driver, sizes
        decided = driver.host(self.marks.value)
        decided[rows] = values
        if (put := driver.put(decided)) is not self.marks.value:
            self.marks = self.marks._replace(value=put)
        if not (len(chosen) and self._extremes.include(places, values[chosen], steps)):
            return
        if (radius := driver.radius_for(self._extremes)) > driver.radius:
            driver.radius, held = radius, driver.host_memory(self.memory)
            driver.forget_neighbours(held)
            self.memory = driver.put_memory(held)
            self.shared = self.shared._replace(radius=radius * self.edge)

    def finish(self) -> tuple[np.ndarray, np.ndarray, Recordings]:
        """What the run gave: steps done, which diverged, and (poses, strains, rest sizes of groups), robots first."""
        lanes = self.driver.host(self.marks.lanes).reshape(-1, marking.LANE_COLUMNS)[: self.driver.batch]
        recorded = self.marks.poses, self.marks.strains, self.marks.sizes
        poses, strains, sizes = (self.driver.host(array)[:, : self.program.slots] for array in recorded)
        diverged = lanes[:, marking.STATE] == marking.DIVERGED
        return lanes[:, marking.STEP].copy(), diverged, (poses, strains, sizes)

    @abstractmethod
    def checkpoint(self) -> Checkpoint:
        """Copies of all that changes from step to step."""

    @abstractmethod
    def restore(self, checkpoint: Checkpoint) -> None:
        """Go back to a checkpoint."""

    def checkpoint_bytes(self, checkpoint: Checkpoint) -> int:
        """Bytes of a checkpoint."""
        return sum(self.driver.bytes_of(array) for array in checkpoint)

    @abstractmethod
    def new_record(self, first: int, room: int, contacts: int) -> Any:
        """Memory for so many states from step ``first`` on, and so many contacts of each."""

    @abstractmethod
    def fits(self, record: Any) -> bool:
        """Whether all contacts found room in a record."""

    @property
    @abstractmethod
    def state_bytes(self) -> int:
        """Bytes of a recorded step of all robots."""

    @property
    def most_states(self) -> int:
        """Steps of all robots that a record can hold."""
        layout, real = self.driver.layout, self.driver.real
        reals = self.driver.memory.size // (layout.slots * real.width)  # of a slot
        return memory.MOST_SLOTS // (reals * self.driver.state_slots)

    @property
    def reverse_bytes(self) -> int:
        """Bytes that reversing takes besides."""
        return 3 * int(self.driver.memory.nbytes)

    def reverse(self, recorded: Recordings, finals: np.ndarray) -> "Reverse":
        """Cotangents at the end of the run, ready to go back.

        Args:
            recorded: cotangents of poses (B, S, V, 7), strains (B, S, L) and rest sizes of groups (B, S, G, 3).
            finals: cotangents of last states (B, V, 13).
        """
        return self.reverse_type(self, recorded, finals)


class Reverse(NeverCopied, ABC):
    """Cotangents of a batch on their way back through a run.

    Cotangents and parameters lie as the memory does, but for forces: here every voxel has its own.
    """

    def __init__(self, run: Any, recorded: Recordings, finals: np.ndarray) -> None:
        """Start at the end of a run; the arguments are those of :meth:`Run.reverse`."""
        self.run, self.driver = run, run.driver
        driver, program, dtype = run.driver, run.program, run.driver.real.numpy
        self.layout = driver.backward_layout
        values, shared = driver.zeros(self.layout.slots), self.layout.starts[memory.FORCE]
        values[:, :shared] = driver.host_memory(run.memory)[:, :shared]
        self.values, self.cotangents = driver.put_memory(values), driver.blank_memory(self.layout.slots)
        poses, strains, sizes, ends = (driver.put(marking.filled(x, dtype)) for x in (*recorded, finals))
        lanes = driver.put(marking.lanes_back(driver.host(run.marks.lanes)))
        by_value: np.ndarray = np.zeros(program.values.shape, dtype)
        given = {"poses": poses, "strains": strains, "sizes": sizes, "finals": ends, "by_value": driver.put(by_value)}
        self.marks = run.marks._replace(lanes=lanes, **given)
        self._contacts = CONTACTS_PER_STEP
        self._stops: dict[int, list[Callable[[int], None]]] = {}

    def stop_at(self, steps: Iterable[int], called: Callable[[int], None]) -> None:
        """Have a function called with each of some steps once the way back has come there, and met what is due.

        Where there are several, they are called in the order in which they were given.
        """
        for step in steps:
            self._stops.setdefault(step, []).append(called)

    def next_stop(self, low: int, high: int) -> int:
        """The last stop before step ``high``, ``low`` if that comes first."""
        return max([low, *(step for step in self._stops if step < high)])

    def stop(self, step: int) -> None:
        """Call what is to be called at a step."""
        for called in self._stops.get(step, ()):
            called(step)

    def seeds(self, snapshot: int) -> np.ndarray:
        """Cotangents of the poses of a recording, shape (B, V, 7)."""
        return self.driver.snapshot(self.marks.poses, snapshot).astype(float)

    def fade(self, factor: float, towards: np.ndarray) -> None:
        """Mix the cotangents of the state with others, by positions alone, shape (B, V, 3).

        Args:
            factor: part of the present ones that stays.
            towards: the others.
        """
        whole = self.driver.host_memory(self.cotangents)
        view = self.layout.section(whole, memory.VOXEL)
        motion = factor * self.of_section(memory.VOXEL, view)
        motion[..., :3] += (1 - factor) * towards
        self.driver.fill(view, memory.VOXEL, motion)
        for section in (memory.LINK, memory.STRAIN, memory.PRINT):
            self.layout.section(whole, section)[...] *= factor
        self.driver.put_back(whole, self.cotangents)

    def add_seeds(self, snapshot: int, poses: np.ndarray, strains: np.ndarray) -> None:
        """Add to the cotangents of a recording that is still to come, shapes (B, V, 7) and (B, L)."""
        links = np.zeros((len(strains), self.marks.strains.shape[2]))
        links[:, : strains.shape[1]] = strains
        self.driver.add_to_snapshot(self.marks.poses, snapshot, poses)
        self.driver.add_to_snapshot(self.marks.strains, snapshot, links)

    @abstractmethod
    def undo(self, low: int, high: int) -> None:
        """Take the cotangents back from step ``high`` to step ``low``, where the run is."""

    def record(self, low: int, high: int) -> Any:
        """Run forward and keep every state."""
        start = self.run.checkpoint()
        while True:
            record = self.run.new_record(low, high - low + 1, self._contacts)
            self.run.advance(high, record=record)
            if self.run.fits(record):
                return record
            del record  # before the larger one is made
            self._contacts *= 2
            self.run.restore(start)

    @property
    def events(self) -> np.ndarray:
        """Cotangents of (base, rate) of each of the program's marks."""
        found: np.ndarray = self.driver.host(self.marks.by_value)
        return found

    def read(self, *sections: int) -> list[np.ndarray]:
        """Cotangents of sections of the memory, each of shape (B, items, components)."""
        whole = self.driver.host_memory(self.cotangents)
        return [self.of_section(section, self.layout.section(whole, section)) for section in sections]

    def of_section(self, section: int, view: np.ndarray) -> np.ndarray:
        """Cotangents of a section, a view of the memory, in shape (B, items, components)."""
        found: np.ndarray = self.driver.robots_first(view).astype(float)
        return found
