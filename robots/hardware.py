"""The pneumatic rig that plays a gait on the physical robot: channels, limits, and gait tables as CSV.

A gait becomes a sequence of *states*: first the body takes its shape, then every column of the schedule is
one state, in the order played. Channels inflate and deflate at different rates, so states last unequal times:
each until its slowest changing channel is done. The table holds the corner points of the pressures, to be
joined by straight lines.

Source: Powers 2021 dissertation, ch. 5, "Transferring to a physical robot" and "Experiments with the physical
robot"; Shah, Powers et al., Nature Machine Intelligence 3, 2021.
"""

import hashlib
import itertools
import json
import os
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
import tomli_w
from numpy.typing import NDArray

from robots.checks import number
from robots.files import read_text, write_text
from robots.schedule import BLADDERS, FEET, GaitSchedule

SCHEMA = "morpholab-gait-1"
CHANNELS = ("core", *GaitSchedule.row_names)
KPA_PER_UNIT = {"kpa": 1.0, "psi": 6.894757293168361}
_UNIT_SPELLING = {"kpa": "kPa", "psi": "psi"}
_Array = NDArray[np.float64]


class Design(Protocol):
    """What is needed of a design: pressure [Pa], orientation [degrees], schedule."""

    @property
    def pressure(self) -> float: ...  # noqa: D102
    @property
    def orientation(self) -> float: ...  # noqa: D102
    @property
    def schedule(self) -> GaitSchedule: ...  # noqa: D102


@dataclass(frozen=True)
class Channel:
    """One pneumatic line of the rig; gauge pressures.

    Attributes:
        on_kpa: pressure of the state 1 [kPa]; the core takes the design's own pressure instead.
        off_kpa: pressure of the state 0 [kPa], below ``on_kpa``.
        rise_s: time from off to on [s]; a smaller step is given as long.
        fall_s: time from on to off [s].
        minimum_kpa: lowest pressure allowed [kPa].
        maximum_kpa: highest pressure allowed [kPa].
        slew_kpa_per_s: fastest change of pressure allowed [kPa/s].
    """

    on_kpa: float
    off_kpa: float
    rise_s: float
    fall_s: float
    minimum_kpa: float
    maximum_kpa: float
    slew_kpa_per_s: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = number(field.name, getattr(self, field.name))
            if not field.name.endswith("_kpa") and value <= 0:
                raise ValueError(f"{field.name}: {value:g} is not allowed; it must be positive")
            object.__setattr__(self, field.name, value)
        for low, high in (("off_kpa", "on_kpa"), ("minimum_kpa", "maximum_kpa")):
            if getattr(self, low) >= getattr(self, high):
                raise ValueError(f"{low}: {getattr(self, low):g} is not allowed; it must be below {high}")


# Published: core 0 to 50 kPa, flattened at -80 kPa, 11.5 s up and 4.7 s down; feet 50 kPa gripping, -80 kPa
# sliding. This rig's own settings, as nothing was published: pressure and times of the outer bladders (within
# the 20 kPa that the study cites for similar ones, as they burst when overdriven), times of the feet, and all
# limits of rate.
_CORE = Channel(50.0, -80.0, 11.5, 4.7, -80.0, 50.0, 30.0)
_BLADDER = Channel(20.0, 0.0, 2.0, 2.0, 0.0, 20.0, 15.0)
_FOOT = Channel(50.0, -80.0, 1.0, 1.0, -80.0, 50.0, 150.0)


@dataclass(frozen=True)
class PneumaticRig:
    """The lines that drive the robot.

    Attributes:
        core: inner bladder, gives the body its shape.
        bladders: outer bladders 1 to 8.
        feet: variable-friction feet 1 and 2; on is gripping.
        shortest_state_s: duration of a state in which nothing changes [s].
    """

    core: Channel = _CORE
    bladders: tuple[Channel, ...] = (_BLADDER,) * BLADDERS
    feet: tuple[Channel, ...] = (_FOOT,) * FEET
    shortest_state_s: float = 0.1

    def __post_init__(self) -> None:
        for field, size in (("bladders", BLADDERS), ("feet", FEET)):
            object.__setattr__(self, field, tuple(getattr(self, field)))
            if (given := len(getattr(self, field))) != size:
                raise ValueError(f"{field}: {given} channels are not allowed; give {size}")
        if number("shortest_state_s", self.shortest_state_s) <= 0:
            raise ValueError(f"shortest_state_s: {self.shortest_state_s} is not allowed; it must be positive")

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels in the order of ``CHANNELS``: core, bladders, feet."""
        return (self.core, *self.bladders, *self.feet)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rig as JSON or TOML, by the suffix of the path."""
        data = asdict(self)
        write_text(path, tomli_w.dumps(data) if _is_toml(path) else json.dumps(data, indent=2) + "\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a rig from JSON or TOML, by the suffix of the path; what it leaves out is the default.

        Raises:
            ValueError: in one line, for an unreadable file, an unknown name or a value that is not allowed.
        """
        text = read_text(path)
        try:
            return cls._from_dict(tomllib.loads(text) if _is_toml(path) else json.loads(text))
        except ValueError as error:  # syntax errors of both formats are ValueErrors
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def _from_dict(cls, data: object) -> Self:
        given = _known(data, "rig", tuple(field.name for field in fields(cls)))
        for group in ("bladders", "feet"):
            if group in given:
                if not isinstance(given[group], list):
                    raise ValueError(f"{group}: give a list of channels")
                given[group] = tuple(_channel(item, group) for item in given[group])
        if "core" in given:
            given["core"] = _channel(given["core"], "core")
        return cls(**given)


def _is_toml(path: str | os.PathLike[str]) -> bool:
    suffix = Path(path).suffix.lower()
    if suffix not in (".json", ".toml"):
        raise ValueError(f"{path}: a rig is a .json or a .toml file")
    return suffix == ".toml"


def _known(data: object, what: str, names: tuple[str, ...]) -> dict[str, Any]:
    """The data as a dict with no other than these names."""
    if not isinstance(data, dict):
        raise ValueError(f"{what}: give a table with {', '.join(names)}")
    unknown = sorted(set(data) - set(names))
    if unknown:
        raise ValueError(f"{what}: {unknown[0]!r} is unknown; give {', '.join(names)}")
    return dict(data)


def _channel(data: object, group: str) -> Channel:
    names = tuple(field.name for field in fields(Channel))
    given = _known(data, group, names)
    missing = [name for name in names if name not in given]
    if missing:
        raise ValueError(f"{group}: {missing[0]} is missing")
    try:
        return Channel(**given)
    except ValueError as error:
        raise ValueError(f"{group}: {error}") from None


@dataclass(frozen=True, eq=False)
class GaitTable:
    """Pressures over time, as a rig plays them.

    Attributes:
        times: corner points [s], shape (N,), increasing from 0; between them pressures change linearly.
        channels: names, C of them.
        pressures: gauge pressures in ``units``, shape (N, C).
        units: ``"kpa"`` or ``"psi"``.
        metadata: what the header of the file says, by name; values as text.
    """

    times: _Array
    channels: tuple[str, ...]
    pressures: _Array
    units: str
    metadata: Mapping[str, str]

    def schedule(self) -> GaitSchedule:
        """The schedule that the pressures play, read off at the end of every state.

        Raises:
            ValueError: in one line, when the table does not hold a whole number of schedules.
        """
        try:
            ends, thresholds = (_numbers(self.metadata[name]) for name in ("state_ends_s", "thresholds"))
            columns, repeats = (int(self.metadata[name]) for name in ("columns", "repeats"))
            rows = [self.channels.index(name) for name in GaitSchedule.row_names]
        except KeyError as error:
            raise ValueError(f"gait table: {error.args[0]} is missing in its header") from None
        except ValueError:
            raise ValueError("gait table: its header is damaged, or an actuator has no channel") from None
        # The first state shapes the body and belongs to no column.
        if len(thresholds) != len(rows) or columns < 1 or len(ends) != 1 + columns * repeats:
            raise ValueError("gait table: its header does not fit a schedule of its columns and repeats")
        played = np.array([np.interp(ends[1:], self.times, self.pressures[:, row]) for row in rows])
        bits = played > thresholds[:, None]
        schedule = GaitSchedule(bits[:, :columns], repeats)
        if not np.array_equal(schedule.played, bits):
            raise ValueError("gait table: its pressures differ from one repeat to the next")
        return schedule


def design_hash(design: Design) -> str:
    """A short fingerprint of a design, equal for equal designs on every machine."""
    schedule = design.schedule
    content = [float(design.pressure), float(design.orientation), schedule.to_text(), schedule.repeats]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def gait_table(design: Design, rig: PneumaticRig | None = None, units: str = "kpa") -> GaitTable:
    """The pressures that play a design on a rig, within the rig's limits.

    All lines start vented. The core goes to the design's pressure; a flat body (pressure 0) is drawn flat by
    vacuum. The feet grip meanwhile, as in the simulation's initialisation.

    Raises:
        ValueError: in one line, when a pressure or a rate is outside the rig's limits.
    """
    if units not in KPA_PER_UNIT:
        raise ValueError(f"units: {units!r} is unknown; give one of {', '.join(KPA_PER_UNIT)}")
    rig = PneumaticRig() if rig is None else rig
    pressure = number("pressure", design.pressure, 0.0, unit="Pa")
    times, pressures, ends = planned_pressures(design, rig)
    on, off = np.array([(channel.on_kpa, channel.off_kpa) for channel in rig.channels]).T
    _check_limits(rig, times, pressures)
    metadata = {
        "design": design_hash(design),
        "pressure_pa": _text(pressure),
        "orientation_deg": _text(design.orientation),
        "columns": str(design.schedule.columns),
        "repeats": str(design.schedule.repeats),
        "state_ends_s": _texts(ends),
        "thresholds": _texts((on[1:] + off[1:]) / 2 / KPA_PER_UNIT[units]),
    }
    return GaitTable(times, CHANNELS, pressures / KPA_PER_UNIT[units], units, metadata)


def planned_pressures(design: Design, rig: PneumaticRig) -> tuple[_Array, _Array, _Array]:
    """The pressures that would play a design, whatever the rig's limits say of them.

    Returns:
        Times of the corner points [s], shape (N,), pressures there [kPa], shape (N, C), channels as ``CHANNELS``, and
        the ends of the states [s], shape (S,); the first state shapes the body.
    """
    on, off, rise, fall = np.array([(c.on_kpa, c.off_kpa, c.rise_s, c.fall_s) for c in rig.channels]).T
    core = design.pressure / 1000 if design.pressure else rig.core.off_kpa
    shaping = np.arange(len(CHANNELS) - 1) >= BLADDERS  # the feet grip
    targets = [[core, *np.where(bits, on[1:], off[1:])] for bits in (shaping, *design.schedule.played.T)]
    return _corner_points(np.array(targets), rise, fall, rig.shortest_state_s)


def _corner_points(targets: _Array, rise: _Array, fall: _Array, still: float) -> tuple[_Array, _Array, _Array]:
    """Go from vented lines to one row of targets, shape (S, C) [kPa], after the other.

    Returns:
        Times of the corner points [s], shape (N,), pressures there [kPa], shape (N, C), and the ends of the
        states [s], shape (S,).
    """
    times, corners, ends = [0.0], [np.zeros(targets.shape[1])], []
    for target in targets:
        start, before = times[-1], corners[-1]
        strokes = np.where(target > before, rise, fall)
        changing = strokes[target != before]
        for passed in np.unique(changing if changing.size else [still]):
            times.append(start + passed)
            corners.append(before + (target - before) * np.minimum(passed / strokes, 1.0))
        corners[-1] = target  # free of rounding
        ends.append(times[-1])
    return np.array(times), np.array(corners), np.array(ends)


def _check_limits(rig: PneumaticRig, times: _Array, pressures: _Array) -> None:
    """Refuse pressures over time, shape (N, C) [kPa], that would overdrive a channel of the rig."""
    rates = np.abs(np.diff(pressures, axis=0)) / np.diff(times)[:, None]
    for index, (name, channel) in enumerate(zip(CHANNELS, rig.channels, strict=True)):
        low, high, fastest = channel.minimum_kpa, channel.maximum_kpa, channel.slew_kpa_per_s
        for time, pressure in zip(times, pressures[:, index], strict=True):
            if not low <= pressure <= high:
                limits = f"the rig's limits are {low:g} to {high:g} kPa"
                raise ValueError(f"{name}: {pressure:g} kPa at {time:g} s is not allowed; {limits}")
        for time, rate in zip(times, rates[:, index], strict=False):
            if rate > fastest * (1 + 1e-9):  # a rate exactly at the limit survives rounding
                limit = f"the rig's limit is {fastest:g} kPa/s"
                raise ValueError(f"{name}: {rate:g} kPa/s at {time:g} s is not allowed; {limit}")


def export_csv(
    design: Design, path: str | os.PathLike[str], rig: PneumaticRig | None = None, units: str = "kpa"
) -> GaitTable:
    """Write the gait table of a design as CSV, replacing the file in one step.

    Args:
        design: pressure [Pa], orientation [degrees] and schedule.
        path: of the CSV file.
        rig: the default rig if None.
        units: ``"kpa"`` or ``"psi"``.

    Returns:
        The table that was written.

    Raises:
        ValueError: in one line, when the rig's limits refuse the gait or the file cannot be written.
    """
    table = gait_table(design, rig, units)
    header = {"schema": SCHEMA, "units": units, "channels": ",".join(table.channels), **table.metadata}
    lines = [f"# {name}={value}" for name, value in header.items()]
    lines.append(_column_names(table.channels, units))
    lines.extend(_texts([time, *row]) for time, row in zip(table.times, table.pressures, strict=True))
    write_text(path, "\n".join(lines) + "\n")
    return table


def read_csv(path: str | os.PathLike[str]) -> GaitTable:
    """Read a gait table that :func:`export_csv` wrote.

    Raises:
        ValueError: in one line, with the number of the line that is wrong.
    """
    lines = read_text(path).splitlines()
    header = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
    pairs = (line[1:].partition("=") for line in header)
    metadata = {name.strip(): value.strip() for name, _, value in pairs}
    schema, units = metadata.pop("schema", None), metadata.pop("units", "")
    channels = tuple(metadata.pop("channels", "").split(","))
    if schema != SCHEMA:
        raise ValueError(f"{path}: schema {schema!r} is unknown; the first line must be '# schema={SCHEMA}'")
    if units not in KPA_PER_UNIT:
        raise ValueError(f"{path}: units {units!r} are unknown; give one of {', '.join(KPA_PER_UNIT)}")
    names = _column_names(channels, units)
    start = len(header) + 1
    if lines[len(header) : start] != [names]:
        raise ValueError(f"{path}: line {start} must be {names!r}")
    rows: list[_Array] = []
    for index, line in enumerate(lines[start:], start + 1):
        try:
            row = _numbers(line)
        except ValueError:
            row = np.array([])
        size = len(channels) + 1
        if len(row) != size or not np.all(np.isfinite(row)) or (rows and row[0] <= rows[-1][0]):
            raise ValueError(f"{path}: line {index} must be {size} numbers, the first one increasing")
        rows.append(row)
    if not rows:
        raise ValueError(f"{path}: holds no rows")
    return GaitTable(np.array(rows)[:, 0], channels, np.array(rows)[:, 1:], units, metadata)


def _column_names(channels: tuple[str, ...], units: str) -> str:
    return ",".join(("time_s", *(f"{name}_{_UNIT_SPELLING[units]}" for name in channels)))


def _text(value: float) -> str:
    return f"{value:.9g}"


def _texts(values: Any) -> str:
    return ",".join(map(_text, values))


def _numbers(text: str) -> _Array:
    return np.array([float(part) for part in text.split(",")])
