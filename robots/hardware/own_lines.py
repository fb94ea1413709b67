"""Lines that a rig names itself, such as six valves on a bench, which drive the channels of robots of one's own."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from robots.hardware.lines import own_names
from robots.hardware.units import PRESSURE, PressureError, Unit


class ChannelLine(NamedTuple):
    """A line of a rig that takes a channel of a robot.

    Attributes:
        place: among all lines of the rig, from 0.
        name: of the line.
        off_kpa: pressure that stands for the low end of a size or temperature [kPa].
        on_kpa: and for its high end [kPa].
    """

    place: int
    name: str
    off_kpa: float
    on_kpa: float


def misplaced(channels: Sequence[str], lines: Sequence[ChannelLine]) -> str:
    """Why channels cannot be on lines in order: one has the name of another line, and not all have one; else empty."""
    named = _named(channels, lines)
    if None not in named and len(set(named)) == len(named):
        return ""
    nameless = [channel for channel, own in zip(channels, named, strict=True) if own is None]
    why = f"{nameless[0]} has no line of its name" if nameless else "two channels have names of one line"
    for channel, own, line in zip(channels, named, lines, strict=False):
        if own is not None and own != line:
            told = f"{channel} would be on the line {line.name} by order, though there is a line {own.name}, as {why}"
            return f"{told}; rename channels or lines so that each channel has one, or bring both into the same order"
    return ""


def lines_of(channels: Sequence[str], lines: Sequence[ChannelLine]) -> tuple[ChannelLine, ...]:
    """The line that each channel is on: that of its name if all channels have names of lines, else in order.

    Only letters and digits count, in either case: the channel ``legs 1`` is on the line ``Legs_1``.

    Args:
        channels: names of a robot's channels, at most as many as lines.
        lines: those of a rig that take channels.

    Raises:
        ValueError: if a channel has the name of another line than that which it would be on.
    """
    if why := misplaced(channels, lines):
        raise ValueError(f"channels: {why}")
    named = _named(channels, lines)
    found = [line for line in named if line is not None]
    return tuple(found if len(found) == len(named) else lines[: len(named)])


def _named(channels: Sequence[str], lines: Sequence[ChannelLine]) -> list[ChannelLine | None]:
    """The line with the name of each channel; None where there is none."""
    by_name = {_letters(line.name): line for line in lines}
    return [by_name.get(_letters(channel)) for channel in channels]


def _letters(name: str) -> str:
    """Letters and digits of a name, in lower case: ``bladder 2``, ``Bladder_2`` and ``bladder2`` name the same."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


@dataclass(frozen=True)
class OwnLines:
    """Lines that a rig names itself, and the two pressures between which they play sizes and temperatures.

    Attributes:
        names: of the lines, in order.
        off_kpa: gauge pressure of each line where it is off [kPa].
        on_kpa: and where it is on [kPa]; below ``off_kpa`` where vacuum drives.

    Raises:
        ValueError: for a name or a pressure that is not allowed.
    """

    names: tuple[str, ...]
    off_kpa: tuple[float, ...]
    on_kpa: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", own_names("lines", self.names))
        for field in ("off_kpa", "on_kpa"):
            object.__setattr__(self, field, _pressures(field, getattr(self, field), len(self.names)))
        for line in self.channel_lines:
            if line.off_kpa == line.on_kpa:
                raise _same(line)

    @classmethod
    def within(
        cls, names: Sequence[str], limits: Sequence[tuple[float, float]], off_kpa: Any = None, on_kpa: Any = None
    ) -> Self:
        """Lines whose pressures follow from their limits where none are given.

        Args:
            names: of the lines.
            limits: lowest and highest pressure of each line [kPa].
            off_kpa: one pressure for all lines, or one for each; None: 0, vented.
            on_kpa: the same; None: the highest of each line, or its lowest where the highest is 0.
        """
        off = 0.0 if off_kpa is None else off_kpa
        on = [most if most > 0 else least for least, most in limits] if on_kpa is None else on_kpa
        sides: list[Any] = [side if isinstance(side, list | tuple) else (side,) * len(names) for side in (off, on)]
        return cls(tuple(names), *sides)

    @property
    def channel_lines(self) -> tuple[ChannelLine, ...]:
        """All lines, as those that take channels."""
        each = zip(self.names, self.off_kpa, self.on_kpa, strict=True)
        return tuple(ChannelLine(place, *line) for place, line in enumerate(each))


def _pressures(field: str, given: Any, count: int) -> tuple[float, ...]:
    if not isinstance(given, list | tuple) or len(given) != count:
        allowed = f"give one pressure, or {count}, in the order of lines"
        raise PressureError(lambda unit: f"{unit.field(field)}: {unit.shown(given)} is not allowed; {allowed}")
    return tuple(PRESSURE(field, pressure) for pressure in given)


def _same(line: ChannelLine) -> PressureError:
    def tell(unit: Unit) -> str:
        told = f"{unit.field('off_kpa')}: {unit.text(line.off_kpa)} of {line.name} is not allowed"
        return f"{told}; it must differ from its {unit.field('on_kpa')}"

    return PressureError(tell)
