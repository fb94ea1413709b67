"""What the outside does to the robots of a batch over time.

Every region of a body has a channel per quantity below. A channel holds a value that changes linearly:
an event at step s sets it to ``value`` and lets it grow by ``rate`` per step from there on,

    value(t) = value + rate (t - s)   for s <= t < step of the channel's next event.

Before its first event a channel holds what the region's material says (zero for pressure, acceleration, force, ...).
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike


class Quantity(IntEnum):
    """Quantities that the channels of regions control; of vectors ``Quantity.FORCE + axis`` is a component."""

    SCALE = 0  # rest size in voxel edges, x y z of the voxel frame
    TEMPERATURE = 3  # [K] relative to the stress-free state
    STATIC_FRICTION = 4
    KINETIC_FRICTION = 5
    GLOBAL_DAMPING = 6  # damping ratio against the world
    PRESSURE = 7  # [Pa]; positive pushes along LatticeBody.pressure_normals
    ACCELERATION = 8  # [m/s^2] x y z, world frame: weight per mass
    FORCE = 11  # [N] x y z on every voxel, world frame
    MOMENT = 14  # [N m] x y z on every voxel, world frame
    TRANSLATION = 17  # [m] x y z, displacement of fixed translations from the start; contacts feel no velocity of it
    ROTATION = 20  # [rad] rotation vector x y z of fixed rotations
    RESISTANCE = 23  # [kg/m^3] half a fluid's density times its coefficients of pressure drag and of friction


QUANTITY_COUNT = 25

EVENT = np.dtype(
    [
        ("robot", np.int32),
        ("step", np.int32),
        ("region", np.int32),
        ("quantity", np.int32),
        ("value", float),
        ("rate", float),
    ]
)


@dataclass(frozen=True, eq=False)
class LatticeProgram:
    """A program for a batch of robots: events that change channels of their regions, and numbers of time steps.

    Steps count from the start of the run that the program drives.

    Attributes:
        lengths: number of time steps of each robot, shape (B,).
        events: array of ``EVENT`` records; those of one channel and step: the last wins.
        snapshots: steps after which each robot's pose is recorded, shape (B, S), ascending, -1 for none.

    Raises:
        ValueError: for wrong shapes, numbers that are not finite, or indices and steps out of range.
    """

    lengths: np.ndarray
    events: np.ndarray
    snapshots: np.ndarray

    def __post_init__(self) -> None:
        lengths = np.asarray(self.lengths, np.int64)
        if lengths.ndim != 1 or len(lengths) == 0 or lengths.min() < 0 or lengths.max() > 2**30:
            raise ValueError("lengths: give one number of steps per robot, from 0 to 2^30")
        events = np.asarray(self.events, EVENT)
        snapshots = np.asarray(self.snapshots, np.int64)
        if snapshots.ndim != 2 or len(snapshots) != len(lengths) or (snapshots > lengths[:, None]).any():
            raise ValueError(
                f"snapshots: shape {snapshots.shape}; give (robots, steps), none beyond a robot's last step"
            )
        for name in ("value", "rate"):
            if not np.isfinite(events[name]).all():
                raise ValueError(f"events: {name} must be finite, got {events[name][~np.isfinite(events[name])][0]}")
        for name, limit in (
            ("robot", len(lengths)),
            ("quantity", QUANTITY_COUNT),
            ("step", 2**30),
            ("region", 2**31 - 1),
        ):
            if len(events) and not (events[name].min() >= 0 and events[name].max() < limit):
                raise ValueError(f"events: {name} must lie in 0..{limit - 1}")
        for name, array in (("lengths", lengths), ("events", events), ("snapshots", snapshots)):
            array = array.copy()
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def robot_count(self) -> int:
        """Number B of robots."""
        return len(self.lengths)

    def refined(self, substeps: int) -> "LatticeProgram":
        """Return the program that does the same in shorter time steps, so many to each of its own.

        Raises:
            ValueError: if it has too many steps then.
        """
        if substeps == 1:
            return self
        if self.lengths.max() * substeps > 2**30:
            raise ValueError(f"lengths: {self.lengths.max()} steps are not allowed in {substeps} substeps each")
        events = self.events.copy()
        events["step"] = np.minimum(self.events["step"].astype(np.int64) * substeps, 2**30 - 1)  # which none reaches
        events["rate"] /= substeps
        snapshots = np.where(self.snapshots < 0, -1, self.snapshots * substeps)
        return LatticeProgram(self.lengths * substeps, events, snapshots)

    def split(self, steps: ArrayLike) -> tuple["LatticeProgram", "ProgramRest"]:
        """Split the program into two that do the same one after the other, at a step of each robot.

        Snapshots of a step before it belong to the first, others to the second; the places of the rest are -1.

        Args:
            steps: where to split, shape (B,), 0 to the robot's length.

        Raises:
            ValueError: for steps that are not allowed.
        """
        cuts = np.asarray(steps, np.int64)
        if cuts.shape != self.lengths.shape or (cuts < 0).any() or (cuts > self.lengths).any():
            raise ValueError(f"steps: {cuts.tolist()} are not allowed; give one from 0 to each robot's length")
        cut = cuts[self.events["robot"]]
        early = np.flatnonzero(self.events["step"] < cut)
        late = np.flatnonzero(self.events["step"] >= cut)
        kept = self.snapshots < cuts[:, None]
        first = LatticeProgram(cuts, self.events[early], np.where(kept, self.snapshots, -1))
        names = ("step", "quantity", "region", "robot")
        early = early[np.lexsort([self.events[early][name] for name in names])]  # stable: the last of a step wins
        channels = self.events[early][["robot", "region", "quantity"]]
        last = early[np.append(channels[1:] != channels[:-1], True)] if len(early) else early
        ages = np.concatenate([cut[last] - self.events["step"][last], np.zeros(len(late), np.int64)])
        source = np.concatenate([last, late])
        events = self.events[source]
        events["value"] += events["rate"] * ages
        events["step"] = np.maximum(events["step"] - cut[source], 0)
        snapshots = np.where(kept, -1, self.snapshots - cuts[:, None])
        return first, ProgramRest(
            LatticeProgram(self.lengths - cuts, events, snapshots), source, ages, len(self.events)
        )


@dataclass(frozen=True, eq=False)
class ProgramRest:
    """The second part of a program that was split: channels begin with events that say what they are by then.

    Attributes:
        program: steps count from the split.
        source: event of the whole program that each of its events is, or carries on, shape (E',).
        ages: steps from that event to the split; 0 of those after it, shape (E',).
        count: events of the whole program, E.
    """

    program: LatticeProgram
    source: np.ndarray
    ages: np.ndarray
    count: int

    def gather(self, values: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by the events of the whole program, shape (E,) each, from those by the events of this part."""
        rates = rates + values * self.ages
        found = [np.bincount(self.source, each, minlength=self.count) for each in (values, rates)]
        return found[0], found[1]


class ProgramBuilder:
    """Builder of a :class:`LatticeProgram`, to which events of many robots are added at once.

    Example:
        >>> builder = ProgramBuilder(robot_count=2)
        >>> builder.set(Quantity.PRESSURE, [[100.0], [200.0]], regions=[0], step=10)
        >>> builder.build(lengths=[1000, 1000]).events.shape
        (2,)
    """

    def __init__(self, robot_count: int) -> None:
        """Start an empty program for ``robot_count`` robots."""
        self.robot_count = robot_count
        self._parts: list[np.ndarray] = []

    def set(
        self,
        quantity: int,
        value: ArrayLike,
        *,
        regions: ArrayLike,
        step: ArrayLike = 0,
        rate: ArrayLike = 0.0,
        robots: ArrayLike | None = None,
    ) -> None:
        """Add events: channels take a value at a step and change by a rate per step from there.

        Args:
            quantity: a ``Quantity``, plus the axis for vectors.
            value: value of the quantity, in its unit, broadcast to shape (robots, regions).
            regions: labels of the regions.
            step: step at which the events happen, broadcast to (robots, regions).
            rate: change per step, broadcast to (robots, regions).
            robots: indices of the robots; all by default.
        """
        rows = np.arange(self.robot_count) if robots is None else np.atleast_1d(np.asarray(robots, int))
        columns = np.atleast_1d(np.asarray(regions, int))
        part = np.empty((len(rows), len(columns)), EVENT)
        part["robot"], part["region"], part["quantity"] = rows[:, None], columns[None], quantity
        part["step"], part["value"], part["rate"] = step, value, rate
        self._parts.append(part.ravel())

    def build(self, lengths: ArrayLike, snapshots: ArrayLike | None = None) -> LatticeProgram:
        """Build the program; ``snapshots`` are steps, shape (robots, steps), none by default.

        Raises:
            ValueError: as of :class:`LatticeProgram`.
        """
        events = np.concatenate(self._parts) if self._parts else np.zeros(0, EVENT)
        marks = np.zeros((self.robot_count, 0), int) if snapshots is None else snapshots
        return LatticeProgram(np.broadcast_to(lengths, self.robot_count), events, np.asarray(marks))
