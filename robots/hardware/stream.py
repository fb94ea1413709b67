"""Stream of lines for a rig's controller, made from a table: a header, samples in order of time, and a stop line.

Samples are equally spaced in time and interpolate the rows of the table linearly. ``docs/rig-side.md`` describes the
protocol.
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from robots.hardware.channel_table import read_channels
from robots.hardware.rig import PRESETS, PneumaticRig
from robots.hardware.rig_table import CHANNELS_SCHEMA, RigTable
from robots.hardware.table import read_csv
from robots.hardware.timeline import FASTEST_RATE
from robots.hardware.units import KPA_PER_UNIT, UNIT_SPELLING
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import read_text

VERSION = "morpholab-stream-1"
USUAL_RATE = 20.0  # for tables whose rows are corners [Hz]
FASTER_RATES = (20.0, 50.0, 100.0, 200.0, 500.0, FASTEST_RATE)  # proposed if a stream is too coarse [Hz]
LARGEST_MISS = 0.01  # deviation from the rows of a table, relative to a line's range, above which a note is given
COMPARED_LOOPS = 100  # loops of the main section in which samples are checked; later ones have similar samples
COMPARED_ROWS = 200_000  # most rows or samples of these loops in all, except that one loop is always checked
SLOWEST_VENTING = 5.0  # lowest rate of samples while venting [Hz]
_DIGIT = 1e-8  # relative rounding of a number in a file, which has nine digits
_EXCESS = 1e-3  # relative tolerance of limits, for rounding in the file


@dataclass(frozen=True)
class Sample:
    """Commanded pressures of all lines at one time.

    Attributes:
        number: number of the sample, from 0 without gaps.
        time_s: time since the start [s].
        section: section of the table: prefix, main or suffix; or vent, after an interruption.
        pressures: pressures of all channels, in the stream's unit.
    """

    number: int
    time_s: float
    section: str
    pressures: tuple[float, ...]


class Format(Protocol):
    """How a stream is written as lines, without their ends."""

    def header(self, stream: "Stream") -> str:
        """The first line."""

    def sample(self, sample: Sample) -> str:
        """The line of a sample."""

    def heartbeat(self, number: int) -> str:
        """The line that says that the next sample, of this number, is still to come."""

    def stop(self, why: str) -> str:
        """The last line: open all lines to the air."""


class JsonLines:
    """Lines that are JSON objects."""

    def header(self, stream: "Stream") -> str:
        """The first line."""
        return _json({"stream": VERSION, **stream.about()})

    def sample(self, sample: Sample) -> str:
        """The line of a sample."""
        pressures = [_rounded(value) for value in sample.pressures]
        return _json({"n": sample.number, "t": round(sample.time_s, 6), "section": sample.section, "p": pressures})

    def heartbeat(self, number: int) -> str:
        """The line that says that the next sample, of this number, is still to come."""
        return _json({"heartbeat": number})

    def stop(self, why: str) -> str:
        """The last line: open all lines to the air."""
        return _json({"stop": why})


class CommaLines:
    """Lines of comma-separated values; the first value is the type of the line."""

    def header(self, stream: "Stream") -> str:
        """The first line."""
        about = stream.about()
        values = [about[name] for name in ("units", "rate_hz", "samples", "seconds")]
        return ",".join(["H", VERSION, *map(str, values), *about["channels"]])

    def sample(self, sample: Sample) -> str:
        """The line of a sample."""
        values = [np.format_float_positional(_rounded(value), trim="-") for value in sample.pressures]
        return ",".join(["S", str(sample.number), f"{sample.time_s:.6f}", sample.section, *values])

    def heartbeat(self, number: int) -> str:
        """The line that says that the next sample, of this number, is still to come."""
        return f"B,{number}"

    def stop(self, why: str) -> str:
        """The last line: open all lines to the air."""
        return f"STOP,{why}"


FORMATS: Mapping[str, type[Format]] = {"jsonl": JsonLines, "csv": CommaLines}


@dataclass(frozen=True, eq=False)
class Stream:
    """A table sampled for a controller.

    Attributes:
        table: table with sections prefix, main and suffix.
        rig: rig whose limits apply.
        loops: number of times that the main section is played.
        rate: samples per second [Hz].
    """

    table: RigTable
    rig: PneumaticRig
    loops: int
    rate: float

    @property
    def seconds(self) -> float:
        """Duration of the stream [s]."""
        lengths = self.table.durations
        return lengths["prefix"] + self.loops * lengths["main"] + lengths["suffix"]

    @property
    def samples(self) -> int:
        """Number of samples; the last one is at the end, at most one period after the previous one."""
        return int(np.ceil(self.seconds * self.rate - 1e-9)) + 1

    @property
    def unit(self) -> str:
        """Unit of the pressures in its usual spelling."""
        return UNIT_SPELLING[self.table.units]

    def about(self) -> dict[str, Any]:
        """Content of the header, as values for JSON."""
        return {
            "units": self.table.units,
            "rate_hz": self.rate,
            "samples": self.samples,
            "seconds": round(self.seconds, 6),
            "channels": list(self.table.channels),
        }

    def __iter__(self) -> Iterator[Sample]:
        """Iterate over the samples in order, with one in memory at a time."""
        return (self.sample(number) for number in range(self.samples))

    def sample(self, number: int) -> Sample:
        """Compute the sample with a given number."""
        lengths, begin = self.table.durations, self.table.times[0]
        main, suffix = begin + lengths["prefix"], begin + lengths["prefix"] + lengths["main"]
        time = min(number / self.rate, self.seconds)
        place, section = begin + time, "prefix"
        if time >= lengths["prefix"] + self.loops * lengths["main"]:
            # The times of the table include the main section once.
            place, section = max(place - (self.loops - 1) * lengths["main"], suffix), "suffix"
        elif place >= main and lengths["main"] > 0:
            place, section = main + (place - main) % lengths["main"], "main"
        times, lines = self._rows[section]
        return Sample(number, time, section, tuple(float(np.interp(place, times, line)) for line in lines))

    def venting(self, last: Sample) -> Iterator[Sample]:
        """Samples after a last one that vent all lines, each as fast as the line and its limit of rate allow.

        They have the stream's rate, but at least ``SLOWEST_VENTING``, so that venting is smooth in slow streams, too.
        """
        kpa = np.array(last.pressures) * KPA_PER_UNIT[self.table.units]
        strokes = np.maximum(self.rig.stroke_times(-kpa), self.rig.least_times(kpa))
        lasting, rate = np.where(kpa != 0, strokes, 0.0), max(self.rate, SLOWEST_VENTING)
        steps = int(np.ceil(max(lasting.max(), 0.0) * rate - 1e-9))
        for step in range(1, steps + 1):
            left = np.clip(1 - step / rate / np.maximum(lasting, 1e-9), 0.0, 1.0)
            pressures = tuple((np.array(last.pressures) * left).tolist())
            yield Sample(last.number + step, last.time_s + step / rate, "vent", pressures)

    def extremes(self) -> list[tuple[str, float, float, float, float]]:
        """Name, lowest and highest pressure sent, and lowest and highest allowed, of each channel, in the table's unit.

        Only the first ``COMPARED_LOOPS`` loops of the main section count, or fewer if it is long.
        """
        factor, (times, lines) = KPA_PER_UNIT[self.table.units], self._course
        moments, found = self._moments(self.rate), []
        for name, line, channel in zip(self.table.channels, lines, self.rig.channels, strict=False):
            sent = np.interp(moments, times, line)
            least, most = channel.minimum_kpa / factor, channel.maximum_kpa / factor
            found.append((name, float(sent.min()), float(sent.max()), least, most))
        return found

    def largest_miss(self, rate: float | None = None) -> tuple[float, str]:
        """Largest deviation of linear interpolation between samples from the rows, and the channel where it occurs.

        The deviation is relative to the range of the line's pressures in the table.

        Args:
            rate: samples per second [Hz]; by default the stream's.
        """
        (times, lines), moments = self._course, self._moments(rate or self.rate)
        swings = np.ptp(self.table.pressures, axis=0)
        missed = [  # the deviation is largest at a row, as both are piecewise linear and agree at samples
            float(np.abs(np.interp(times, moments, np.interp(moments, times, line)) - line).max() / swing)
            if swing
            else 0.0
            for line, swing in zip(lines, swings, strict=True)
        ]
        worst = int(np.argmax(missed))
        return missed[worst], self.table.channels[worst]

    def notes(self) -> list[str]:
        """Notes for the user: that the rate is too low for the rows, or that the unit is not that of the rig."""
        found, (miss, name) = [], self.largest_miss()
        if miss > LARGEST_MISS:
            enough = (rate for rate in FASTER_RATES if rate > self.rate and self.largest_miss(rate)[0] <= LARGEST_MISS)
            finer = next(enough, None)
            mend = f"--rate {finer:g} keeps within" if finer else f"no --rate up to {FASTEST_RATE:g} keeps within"
            found.append(
                f"{self.rate:g} samples a second are too few for these rows: straight lines between samples miss them "
                f"by up to {100 * miss:.2g} % of the swing of {name}; {mend} {100 * LARGEST_MISS:g} %"
            )
        if self.table.units != self.rig.units:
            told = f"the table is in {self.unit}, the rig {self.rig.name} in {UNIT_SPELLING[self.rig.units]}"
            found.append(f"{told}; numbers are sent as {self.unit}, as the header says")
        return found

    @cached_property
    def _course(self) -> tuple[Floats, Floats]:
        """Times since the start [s], shape (R,), and pressures, shape (L, R), of the rows as they are played."""
        main, begin = self.table.durations["main"], self.table.times[0]
        largest = max(int(np.sum(np.array(self.table.sections) == "main")), main * self.rate, 1.0)  # rows or samples
        loops = min(self.loops, COMPARED_LOOPS, max(int(COMPARED_ROWS / largest), 1))
        starts = [("prefix", 0.0), *(("main", loop * main) for loop in range(loops)), ("suffix", (loops - 1) * main)]
        times = np.concatenate([self._rows[section][0] - begin + start for section, start in starts])
        return times, np.concatenate([self._rows[section][1] for section, _ in starts], axis=1)

    def _moments(self, rate: float) -> Floats:
        """Times of the samples while the rows of :attr:`_course` are played [s]."""
        end = float(self._course[0][-1])
        return np.minimum(np.arange(int(np.ceil(end * rate - 1e-9)) + 1) / rate, end)

    @cached_property
    def _rows(self) -> Mapping[str, tuple[Floats, Floats]]:
        """Times of the rows of each section, and pressures of each line in them."""
        sections = np.array(self.table.sections)
        found = {name: sections == name for name in dict.fromkeys(self.table.sections)}
        return {name: (self.table.times[rows], self.table.pressures[rows].T) for name, rows in found.items()}


def rig_of_table(table: RigTable) -> PneumaticRig:
    """Preset rig for which a table was made.

    Raises:
        ValueError: if the rig of the table is not a preset.
    """
    if table.rig not in PRESETS:
        raise ValueError(f"rig: the table is for {table.rig!r}, whose limits are not known; give its .toml file")
    return PRESETS[table.rig]


def stream_of(
    table: RigTable, rig: PneumaticRig | None = None, *, loops: int | None = None, rate: float | None = None
) -> Stream:
    """Make a stream from a table for a rig, and check it against the rig's limits.

    Args:
        table: table to play.
        rig: rig whose limits apply; by default the preset that the table names.
        loops: number of times that the main section is played; by default that of the table.
        rate: samples per second [Hz]; by default that of the table, or ``USUAL_RATE`` if its rows are corners.

    Raises:
        ValueError: if the table exceeds limits of the rig, has another number of lines, or names an unknown rig.
    """
    rig = rig or rig_of_table(table)
    rig.check_names(table.channels)
    stream = Stream(table, rig, table.loops if loops is None else loops, rate or table.rate or USUAL_RATE)
    _check_limits(stream)
    return stream


def read_any_table(path: str | os.PathLike[str]) -> RigTable:
    """Read a table of a gait, or of the channels of another robot, depending on its first line.

    Raises:
        ValueError: if the file is damaged, or is neither.
    """
    first = read_text(path).partition("\n")[0]
    return read_channels(path) if first == f"# schema={CHANNELS_SCHEMA}" else read_csv(path)


def _check_limits(stream: Stream) -> None:
    """Refuse pressures and rates of change beyond the rig's limits."""
    table, unit = stream.table, stream.unit
    for column, (name, channel) in enumerate(zip(table.channels, stream.rig.channels, strict=True)):
        line, factor = table.pressures[:, column], KPA_PER_UNIT[table.units]
        least, most = channel.minimum_kpa / factor, channel.maximum_kpa / factor
        slack = _EXCESS * max(abs(least), abs(most))
        _refuse_beyond(line > most + slack, line, table.times, f"{name}: {{}} {unit}", f"{most:.6g} {unit}")
        _refuse_beyond(line < least - slack, line, table.times, f"{name}: {{}} {unit}", f"{least:.6g} {unit}")
        limit = channel.slew_kpa_per_s / factor
        lasting = np.diff(table.times)
        steps = np.abs(np.diff(line))
        slopes, told = steps / np.maximum(lasting, 1e-9), f"{name}: {{}} {unit}/s"
        rounded = _DIGIT * (2 * np.abs(line).max() + limit * 2 * np.abs(table.times).max())
        _refuse_beyond(
            steps > limit * lasting * (1 + _EXCESS) + rounded, slopes, table.times, told, f"{limit:.6g} {unit}/s"
        )


def _refuse_beyond(beyond: np.ndarray, values: Floats, times: Floats, told: str, limit: str) -> None:
    if beyond.any():
        at = int(np.argmax(beyond))
        raise ValueError(
            f"{told.format(f'{values[at]:.6g}')} at {times[at]:g} s is not allowed; the rig's limit is {limit}"
        )


def _rounded(value: float) -> float:
    return round(value, 4) + 0.0  # without a negative zero


def _json(values: Mapping[str, Any] | Sequence[Any]) -> str:
    return json.dumps(values, separators=(",", ":"), allow_nan=False)
