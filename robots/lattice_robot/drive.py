"""Drives of lattice robots: waves of size, temperature, pressure or friction in groups of regions."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.control.cyclic import SEGMENTS
from robots.free import Free as Free
from robots.lattice_robot.gains import Gains
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import number
from taichi_sim.lattice import LatticeBody, Quantity

Value = float | Free
Values = Value | tuple[Value, ...]

# Channels of what can be driven; friction is that of voxels that stick and of those that slide.
QUANTITIES = {
    "scale": (Quantity.SCALE, Quantity.SCALE + 1, Quantity.SCALE + 2),
    "temperature": (Quantity.TEMPERATURE,),
    "pressure": (Quantity.PRESSURE,),
    "friction": (Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION),
}
CYCLES = "cycles"  # the unit of phases
UNITS = {"scale": "", "temperature": "K", "pressure": "Pa", "friction": ""}
FIELDS = ("mean", "amplitude", "phase", "knots")


@dataclass(frozen=True)
class Drive:
    """A drive: regions that follow one wave, mean + amplitude w(f t + phase), w a sine or a curve through knots.

    A value may be ``Free``; that of a field other than ``knots`` may be a tuple, a value for each region.

    Attributes:
        name: name of the drive.
        regions: labels of the body's regions that it drives.
        quantity: ``"scale"``, rest size in voxel edges; ``"temperature"`` [K], which swells a material by its
            thermal expansion; ``"pressure"`` [Pa] on the body's pressurised faces; ``"friction"`` against the floor.
        mean: mean of the wave, in the unit of the quantity; None: the value of the region's material, 0 for pressure.
        amplitude: amplitude of the wave, in the unit of the quantity.
        phase: phase of the wave [cycles].
        knots: of a curve instead of the sine: its values at equal times of the cycle, which it joins by straight lines
            and closes to a ring; at least two.
        axes: of the scale: some of "xyz", in the voxel's frame.
        proportions: of a scale that swings about its material's: how far along each of the axes, the first by 1; none
            is as far along all. So a bladder that thickens may lengthen a little.
        gains: factors of the amplitude, one for each region; None is as said. They are no part of a description: what
            is drawn of a robot whose drives are uncertain.

    Raises:
        ValueError: for a field that is not allowed.
    """

    name: str
    regions: tuple[int, ...]
    quantity: str = "scale"
    mean: Values | None = None
    amplitude: Values = 0.0
    phase: Values = 0.0
    knots: tuple[Value, ...] = ()
    axes: str = "xyz"
    proportions: tuple[float, ...] = ()
    gains: Gains | None = None

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
        self._check_proportions()
        if len(self.knots) == 1:
            raise ValueError(f"knots: one of {self.name} is not allowed; give none, or at least two")
        for field, values in list(self._fields()):
            if field != "knots" and isinstance(getattr(self, field), tuple) and len(values) != len(self.regions):
                raise ValueError(
                    f"{field}: {len(values)} values of {self.name} are not allowed; give one, or {len(self.regions)}"
                )
            checked = tuple(v if isinstance(v, Free) else number(f"{self.name}_{field}", v) for v in values)
            object.__setattr__(self, field, checked if isinstance(getattr(self, field), tuple) else checked[0])

    def _check_proportions(self) -> None:
        held = self.proportions if isinstance(self.proportions, list | tuple | np.ndarray) else (self.proportions,)
        given = tuple(number(f"{self.name}_proportions", each) for each in held)
        object.__setattr__(self, "proportions", given)
        if given and (self.quantity != "scale" or self.mean is not None):
            why = "a mean" if self.quantity == "scale" else self.quantity
            raise ValueError(f"proportions: {given} of {self.name} are not allowed with {why}; leave them out")
        if given and (len(given) != len(self.axes) or given[0] != 1.0):
            raise ValueError(
                f"proportions: {given} of {self.name} are not allowed; give one for each of {self.axes}, the first 1"
            )

    def _fields(self) -> Iterator[tuple[str, tuple[Value, ...]]]:
        """Fields that hold values, and those."""
        for field in FIELDS:
            held = getattr(self, field)
            if held is not None and not (isinstance(held, tuple) and not held):
                yield field, held if isinstance(held, tuple) else (held,)

    @property
    def quantities(self) -> tuple[int, ...]:
        """Channels of each region that the drive sets, see ``taichi_sim.lattice.Quantity``."""
        channels = QUANTITIES[self.quantity]
        return tuple(channels["xyz".index(a)] for a in self.axes) if self.quantity == "scale" else channels

    @property
    def is_idle(self) -> bool:
        """Whether it leaves its regions at the rest sizes of their materials."""
        return self.quantity == "scale" and self.mean is None and self.amplitude == 0.0

    @property
    def free(self) -> dict[str, Free]:
        """Free numbers of the drive by name: ``legs_phase``, ``legs_phase_1`` of the first region, ``legs_knots_1``."""
        return {name: value for name, (_, value) in self._free_fields().items()}

    @property
    def units(self) -> dict[str, str]:
        """Units of the free numbers, by the same names; empty of what has none."""
        given = dict.fromkeys(FIELDS, UNITS[self.quantity]) | {"phase": CYCLES, "knots": ""}
        return {name: given[field] for name, (field, _) in self._free_fields().items()}

    def _free_fields(self) -> dict[str, tuple[str, Free]]:
        """Field and value of the free numbers by name."""
        found = {}
        for field, values in self._fields():
            several = isinstance(getattr(self, field), tuple)
            for place, value in enumerate(values, 1):
                if isinstance(value, Free):
                    found[f"{self.name}_{field}_{place}" if several else f"{self.name}_{field}"] = field, value
        return found

    def filled(self, given: Iterable[float]) -> "Drive":
        """Return the drive with nothing free, with ``given`` values of :attr:`free` in its order."""
        numbers = iter(given)
        return replace(self, **self._each(lambda value: next(numbers) if isinstance(value, Free) else value))

    def describe(self) -> dict[str, Any]:
        """Describe the drive as JSON values; a free value becomes a table of its fields."""
        told = {"name": self.name, "regions": list(self.regions), "quantity": self.quantity, "axes": self.axes}
        if self.proportions:
            told["proportions"] = list(self.proportions)
        values = self._each(lambda value: asdict(value) if isinstance(value, Free) else value)
        return told | {field: list(held) if isinstance(held, tuple) else held for field, held in values.items()}

    def _each(self, change: Callable[[Value], Any]) -> dict[str, Any]:
        """Apply a function to each value, by fields; without a mean that is not given."""
        found: dict[str, Any] = {}
        for field in FIELDS:
            held = getattr(self, field)
            if held is not None:
                found[field] = tuple(map(change, held)) if isinstance(held, tuple) else change(held)
        return found

    def nodes(self, points: Any, rest: Floats, later: ArrayLike = 0.0) -> Any:
        """Compute the channels' values at the 16 nodes of a cycle, shape (N, Q, G, 16): Q channels of G regions.

        Args:
            points: values of :attr:`free` in its order, shape (N, F); they may be traced.
            rest: what the materials say of each channel, shape (Q, G).
            later: what is added to all phases of a point, in cycles, one or shape (N,).
        """
        columns, count = iter(range(len(self.free))), len(points)
        arrays = {
            field: np.stack([points[:, next(columns)] if isinstance(v, Free) else np.full(count, v) for v in values], 1)
            for field, values in self._fields()
        }
        amplitude, phase = (self._of_regions(arrays[field])[..., None] for field in ("amplitude", "phase"))
        if self.gains:
            peak = np.abs(arrays["knots"]).max(axis=1)[:, None, None] if "knots" in arrays else 1.0
            amplitude = self.gains.limited(amplitude * np.array(self.gains.factors)[:, None], peak)
        places = np.arange(SEGMENTS) / SEGMENTS + phase + np.asarray(later, float).reshape(-1, 1, 1)
        wave = amplitude * (_curve(arrays["knots"], places) if "knots" in arrays else np.sin(2 * np.pi * places))
        if "mean" in arrays:
            wave = self._of_regions(arrays["mean"])[..., None] + wave
        several = np.repeat(wave[:, None], len(rest), axis=1)
        if self.proportions:
            several = several * np.array(self.proportions)[:, None, None]
        return several if "mean" in arrays else rest[..., None] + several

    @property
    def shares(self) -> tuple[float, ...]:
        """Amplitude of each channel of a region, relative to that of the first."""
        return self.proportions or (1.0,) * len(self.quantities)

    def _of_regions(self, values: Any) -> Any:
        return np.broadcast_to(values, (len(values), len(self.regions)))


def _curve(knots: Any, places: Any) -> Any:
    """Values at places of the cycle, shape (N, G, 16), of a closed curve through knots, shape (N, K)."""
    count = knots.shape[1]
    first = np.floor(places * count).astype(int)
    part = places * count - first
    rows = np.arange(len(knots))[:, None, None]
    left, right = knots[rows, first % count], knots[rows, (first + 1) % count]
    return left + part * (right - left)


def check_drives(drives: Sequence[Drive], body: LatticeBody) -> None:
    """Refuse drives of a body that is to have some, each with its name; a region has one at most in a quantity.

    Raises:
        ValueError: one line that names the field, the value and what is allowed.
    """
    if not drives:
        raise ValueError("drives: there are none; give at least one Drive")
    names = [drive.name for drive in drives]
    if len(set(names)) < len(names):
        raise ValueError(f"drives: {', '.join(names)} do not all differ; give each its name")
    known = set(np.unique(body.regions).tolist())  # type: ignore[arg-type]
    seen: dict[tuple[int, int], str] = {}
    for drive in drives:
        for region, quantity in product(drive.regions, drive.quantities):
            if region not in known:
                raise ValueError(
                    f"regions: {region} of {drive.name} is unknown; the body has {min(known)} to {max(known)}"
                )
            other = seen.setdefault((region, quantity), drive.name)
            if other != drive.name:
                raise ValueError(
                    f"drives: {other} and {drive.name} both set the {drive.quantity} of region {region}; give one"
                )
        feels = body.pressure_normals[driven_voxels(drive, body)]  # type: ignore[index]
        if drive.quantity == "pressure" and not feels.any():
            raise ValueError(f"drives: no voxel of {drive.name} has a face under pressure; give pressure_normals")


def driven_voxels(drive: Drive, body: LatticeBody) -> Bools:
    """Which voxels of a body a drive moves, shape (V,)."""
    return np.isin(np.asarray(body.regions), drive.regions)
