"""Properties of the inflatable robot that are fitted to a rig, and the robot that has them."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from os import PathLike
from types import MappingProxyType
from typing import Annotated, Any, Self

from robots.inflatable.actuation import ACTUATION, WEIGHTS, InflatableActuation
from robots.inflatable.body import NAMED_GEOMETRIES, PUBLISHED, InflatableGeometry
from taichi_sim.base.checks import check_fields, choice, positive
from taichi_sim.base.files import read_record, write_record
from taichi_sim.base.records import checked

CALIBRATION_FORMAT = "morpholab-calibration-1"
# Default bounds of a fit. The stiffest body determines the time step of all, see ``Laboratory``.
BOUNDS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"friction": (0.1, 4.0), "low_friction": (1e-3, 1.0), "modulus": (200e3, 800e3), "inflation_rate": (0.7, 12.0)}
)
Property = Annotated[float, partial(positive, high=1e12)]
UNITS: Mapping[str, str] = MappingProxyType(
    {"friction": "", "low_friction": "", "modulus": "Pa", "inflation_rate": "1/s"}
)


@dataclass(frozen=True)
class Properties:
    """Properties of the inflatable robot that a fit may change.

    Attributes:
        friction: Coulomb coefficient of skin and gripping feet on the ground, static and kinetic; bladders have a
            third of it.
        low_friction: Coulomb coefficient of sliding feet.
        modulus: Young's modulus of the skin [Pa]; that of bladders stays in proportion to it.
        inflation_rate: change of a bladder's thickness [voxels per voxel per second].
    """

    friction: Property
    low_friction: Property
    modulus: Property
    inflation_rate: Property

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def of(cls, geometry: InflatableGeometry = PUBLISHED, actuation: InflatableActuation = ACTUATION) -> Self:
        """Properties of a robot with the given geometry and actuation."""
        rate = actuation.inflation_rate / geometry.time_step
        return cls(actuation.high_friction, actuation.low_friction, geometry.youngs_modulus, rate)

    @property
    def spoken(self) -> str:
        """All properties as one line of text."""
        each = (f"{name.replace('_', ' ')} {getattr(self, name):.4g} {UNITS[name]}" for name in NAMES)
        return ", ".join(text.strip() for text in each)

    def body_of(self, geometry: InflatableGeometry) -> InflatableGeometry:
        """The geometry with this modulus; the ratio of the bladders' modulus to it is kept."""
        softer = geometry.bladder_modulus / geometry.youngs_modulus
        return replace(geometry, youngs_modulus=self.modulus, bladder_modulus=self.modulus * softer)

    def drive_of(self, actuation: InflatableActuation, counted_in: float, time_step: float) -> InflatableActuation:
        """The actuation with this friction and rate; durations that it counts in steps stay the same in seconds.

        Args:
            actuation: actuation before the fit.
            counted_in: time step for which it was described [s].
            time_step: time step of the simulation [s].
        """
        ratio = time_step / counted_in
        return replace(
            actuation,
            high_friction=self.friction,
            low_friction=self.low_friction,
            inflation_rate=self.inflation_rate * time_step,
            pressure_ramp=actuation.pressure_ramp * ratio,
            hold_steps=round(actuation.hold_steps / ratio),
            settle_steps=round(actuation.settle_steps / ratio),
        )

    def robot(
        self, geometry: InflatableGeometry = PUBLISHED, actuation: InflatableActuation = ACTUATION
    ) -> tuple[InflatableGeometry, InflatableActuation]:
        """Geometry and actuation of the robot that has these properties, for ``robots.inflatable.simulate``.

        The time step is that of the geometry, in which gaits count, unless the skin is too stiff for it; then a shorter
        one is used, and durations that the actuation counts in steps stay the same in seconds.
        """
        tuned = self.body_of(geometry)
        if not self.fits_time_step(geometry):
            return tuned, self.drive_of(actuation, geometry.time_step, tuned.time_step)
        tuned = replace(tuned, time_step_safety=geometry.time_step_safety * geometry.relative_time_step(self.modulus))
        return tuned, self.drive_of(actuation, geometry.time_step, geometry.time_step)

    def fits_time_step(self, geometry: InflatableGeometry = PUBLISHED) -> bool:
        """Whether the robot can be simulated at the time step of the geometry."""
        return self.modulus <= geometry.most_modulus

    def check_time_step(self, geometry: InflatableGeometry = PUBLISHED) -> None:
        """Raise ValueError unless :meth:`fits_time_step`, which gaits with durations of their own require."""
        if not self.fits_time_step(geometry):
            raise ValueError(
                f"modulus: {self.modulus:g} Pa is not allowed with gaits that have times of their own, which count in "
                f"time steps that are too long for it; at most {geometry.most_modulus:.0f} Pa"
            )


NAMES = tuple(field.name for field in fields(Properties))


@dataclass(frozen=True)
class _Calibration:
    """Fields that are read from ``calibration.json``; the others are for information only."""

    format: str
    geometry: str
    properties: Properties
    weight: str = "published"


def robot_of(
    geometry: str, weight: str, properties: Properties | None = None
) -> tuple[InflatableGeometry, InflatableActuation]:
    """Geometry and actuation of a robot by name and weight of bladders, with published or calibrated properties."""
    named, actuation = NAMED_GEOMETRIES[geometry], InflatableActuation(weight=weight)
    return (named, actuation) if properties is None else properties.robot(named, actuation)


def load_calibration(path: str | PathLike[str]) -> tuple[Properties, str]:
    """Load properties, and the name of their geometry, from a file that ``morpholab calibrate`` wrote.

    Raises:
        ValueError: if the file cannot be read as such; names the file and what is wrong.
    """
    return read_record(path, CALIBRATION_FORMAT, _calibration)


def weight_of_calibration(path: str | PathLike[str]) -> str:
    """Read the weight of bladders with which a calibration was fitted from its file, ``"published"`` or ``"physical"``.

    Raises:
        ValueError: if the file cannot be read as such; names the file and what is wrong.
    """
    return choice("weight", read_record(path, CALIBRATION_FORMAT, _fields).weight, WEIGHTS)


def save_properties(
    properties: Properties, geometry: str, path: str | PathLike[str], weight: str = "published"
) -> None:
    """Write properties, and the name of their geometry, for :func:`load_calibration`."""
    more = {} if weight == "published" else {"weight": weight}
    write_record(path, CALIBRATION_FORMAT, {"geometry": geometry, **more, "properties": asdict(properties)})


def _calibration(record: dict[str, Any]) -> tuple[Properties, str]:
    found = _fields(record)
    return found.properties, choice("geometry", found.geometry, NAMED_GEOMETRIES)


def _fields(record: dict[str, Any]) -> _Calibration:
    read = [each.name for each in fields(_Calibration)]
    return checked(_Calibration, {name: value for name, value in record.items() if name in read})
