"""What drives groups of a robot's regions: waves of size, temperature, pressure or friction, some of them free."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robots.control.cyclic import SEGMENTS
from taichi_sim.autodiff.arrays import trace
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number
from taichi_sim.lattice import Quantity


@dataclass(frozen=True)
class Free:
    """A number that a search may change.

    Attributes:
        low: smallest value.
        high: largest value.
        start: where nothing has been searched; by default in the middle.
    """

    low: float
    high: float
    start: float | None = None

    def __post_init__(self) -> None:
        low, high = number("low", self.low), number("high", self.high)
        if not low < high:
            raise ValueError(f"low: {low:g} to {high:g} is not allowed; low must be below high")
        if self.start is not None:
            number("start", self.start, low, high)

    @property
    def middle(self) -> float:
        """The start, or else the middle."""
        return (self.low + self.high) / 2 if self.start is None else self.start


Value = float | Free
Values = Value | tuple[Value, ...]

# Channels of what can be driven; friction is that of voxels that stick and of those that slide.
QUANTITIES = {
    "scale": (Quantity.SCALE, Quantity.SCALE + 1, Quantity.SCALE + 2),
    "temperature": (Quantity.TEMPERATURE,),
    "pressure": (Quantity.PRESSURE,),
    "friction": (Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION),
}
UNITS = {"scale": "", "temperature": "K", "pressure": "Pa", "friction": ""}
FIELDS = ("mean", "amplitude", "phase", "knots")


@dataclass(frozen=True)
class Drive:
    """A group of regions that follow one wave: mean + amplitude w(f t + phase), w a sine or a curve through knots.

    A value may be ``Free``; that of a field other than ``knots`` may be a tuple, a value for each region.

    Attributes:
        name: of the group.
        regions: labels of the body's regions.
        quantity: ``"scale"``, rest size in voxel edges; ``"temperature"`` [K], which swells a material by its
            thermal expansion; ``"pressure"`` [Pa] on the body's pressurised faces; ``"friction"`` against the floor.
        mean: what the quantity swings about; None: what the region's material says, 0 for pressure.
        amplitude: in the unit of the quantity.
        phase: in cycles.
        knots: of a curve instead of the sine: its values at equal times of the cycle, which it joins by straight lines
            and closes to a ring; at least two.
        axes: of the scale: some of "xyz", in the voxel's frame.
    """

    name: str
    regions: tuple[int, ...]
    quantity: str = "scale"
    mean: Values | None = None
    amplitude: Values = 0.0
    phase: Values = 0.0
    knots: tuple[Value, ...] = ()
    axes: str = "xyz"

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(f"quantity: {self.quantity!r} is unknown; choose one of {', '.join(QUANTITIES)}")
        object.__setattr__(self, "regions", tuple(int(region) for region in np.atleast_1d(self.regions)))
        for field in FIELDS:
            if isinstance(held := getattr(self, field), list | np.ndarray):
                object.__setattr__(self, field, tuple(held))
        if not self.regions or len(set(self.regions)) < len(self.regions):
            raise ValueError(f"regions: {self.regions} of {self.name} are not allowed; give at least one, none twice")
        if not self.axes or set(self.axes) - set("xyz") or len(set(self.axes)) < len(self.axes):
            raise ValueError(f"axes: {self.axes!r} of {self.name} are not allowed; give some of xyz")
        if len(self.knots) == 1:
            raise ValueError(f"knots: one of {self.name} is not allowed; give none, or at least two")
        for field, values in list(self._fields()):
            if field != "knots" and isinstance(getattr(self, field), tuple) and len(values) != len(self.regions):
                raise ValueError(
                    f"{field}: {len(values)} values of {self.name} are not allowed; give one, or {len(self.regions)}"
                )
            checked = tuple(v if isinstance(v, Free) else number(f"{self.name}_{field}", v) for v in values)
            object.__setattr__(self, field, checked if isinstance(getattr(self, field), tuple) else checked[0])

    def _fields(self) -> Iterator[tuple[str, tuple[Value, ...]]]:
        """Fields that hold values, and those."""
        for field in FIELDS:
            held = getattr(self, field)
            if held is not None and held != ():
                yield field, held if isinstance(held, tuple) else (held,)

    @property
    def quantities(self) -> tuple[int, ...]:
        """Channels of each region."""
        channels = QUANTITIES[self.quantity]
        return tuple(channels["xyz".index(a)] for a in self.axes) if self.quantity == "scale" else channels

    @property
    def free(self) -> dict[str, Free]:
        """What a search may change, by name: ``legs_phase``, ``legs_phase_1`` of the first region, ``legs_knots_1``."""
        found = {}
        for field, values in self._fields():
            several = isinstance(getattr(self, field), tuple)
            for place, value in enumerate(values, 1):
                if isinstance(value, Free):
                    found[f"{self.name}_{field}_{place}" if several else f"{self.name}_{field}"] = value
        return found

    def given(self, points: Floats) -> "DriveValues":
        """The drive at points, shape (N, P), values of :attr:`free` in its order."""
        columns: dict[str, list[int]] = {}
        arrays: dict[str, Floats] = {}
        taken = 0
        for field, values in self._fields():
            array = np.empty((len(points), len(values)))
            columns[field] = []
            for place, value in enumerate(values):
                if isinstance(value, Free):
                    array[:, place] = points[:, taken]
                    columns[field].append(taken)
                    taken += 1
                else:
                    array[:, place] = value
                    columns[field].append(-1)
            arrays[field] = array
        return DriveValues(self, arrays, columns, taken)


@dataclass(frozen=True, eq=False)
class DriveValues:
    """A drive at N points.

    Attributes:
        drive: that has G regions.
        arrays: values of its fields, shape (N, number of values) each.
        columns: where each value stands among what is free, -1 where it is not.
        free_count: how much is free.
    """

    drive: Drive
    arrays: dict[str, Floats]
    columns: dict[str, list[int]]
    free_count: int

    @property
    def filled(self) -> Drive:
        """The drive of the first point, without anything free."""
        given = {field: tuple(array[0].tolist()) for field, array in self.arrays.items()}
        plain: dict[str, Any] = {
            f: v if f == "knots" or isinstance(getattr(self.drive, f), tuple) else v[0] for f, v in given.items()
        }
        return replace(self.drive, **plain)

    def nodes(self, rest: Floats) -> Floats:
        """The quantity at the nodes of a cycle, shape (N, G, 16).

        Args:
            rest: what the materials say, shape (G,).
        """
        return self._nodes(self.arrays, rest)

    def pull_back(self, nodes: Floats) -> Floats:
        """Derivatives of a cost by what is free, shape (N, free_count), from those by the nodes, shape (N, G, 16)."""
        fields, rest = list(self.arrays), np.zeros(len(self.drive.regions))
        _, pull_back = trace(
            lambda *given: self._nodes(dict(zip(fields, given, strict=True)), rest), *self.arrays.values()
        )
        gradient = np.zeros((len(nodes), self.free_count))
        for field, by_field in zip(fields, pull_back(nodes), strict=True):
            for place, column in enumerate(self.columns[field]):
                if column >= 0:
                    gradient[:, column] = by_field[:, place]
        return gradient

    def _nodes(self, arrays: Mapping[str, Floats], rest: Floats) -> Floats:
        """The quantity at the nodes, with other values of the fields; these may be traced."""
        mean, amplitude = arrays.get("mean", rest[None]), arrays["amplitude"]
        return self._of_regions(mean)[..., None] + self._of_regions(amplitude)[..., None] * self._wave(arrays)

    def _of_regions(self, values: Floats) -> Floats:
        return np.broadcast_to(values, (len(values), len(self.drive.regions)))

    def _wave(self, arrays: Mapping[str, Floats]) -> Floats:
        """w at the nodes, shape (N, G, 16)."""
        places = np.arange(SEGMENTS) / SEGMENTS + self._of_regions(arrays["phase"])[..., None]
        if "knots" not in arrays:
            return np.sin(2 * np.pi * places)
        knots = arrays["knots"]
        count = knots.shape[1]
        first = np.floor(places * count).astype(int)
        part = places * count - first
        rows = np.arange(len(knots))[:, None, None]
        left, right = knots[rows, first % count], knots[rows, (first + 1) % count]
        return left + part * (right - left)
