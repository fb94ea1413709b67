"""The lines of a rig, by the actuators that they drive: cores first, then bladders, then feet.

They are the pneumatic robot's in Powers 2021, ch. 5; other robots use the lines of bladders for their channels, or the
lines that a rig names itself.
"""

import re
from collections.abc import Sequence

from taichi_sim.base.checks import shown

BLADDERS = 8
FEET = 2
ACTUATORS = BLADDERS + FEET
BLADDER_LINES = tuple(f"bladder{number}" for number in range(1, BLADDERS + 1))
FOOT_LINES = tuple(f"foot{number}" for number in range(1, FEET + 1))
ACTUATOR_LINES = (*BLADDER_LINES, *FOOT_LINES)
CHANNELS = ("core", *ACTUATOR_LINES)
MOST_LINES = 64  # that a rig names itself
LONGEST_NAME = 32  # of such a line [characters]
SHARED = "default"  # name of the table of a rig's file that speaks of all lines that it names itself
_NOT_LINES = (SHARED, "time_s", "section", "state")  # the latter are other columns of tables


def channel_names(cores: int) -> tuple[str, ...]:
    """Names of the lines of a rig with so many for cores: ``CHANNELS`` for one, else ``core1``, ``core2`` and on."""
    return CHANNELS if cores == 1 else (*(f"core{n}" for n in range(1, cores + 1)), *ACTUATOR_LINES)


def core_count(lines: int) -> int:
    """How many of the lines of a rig or a table drive cores: those beyond its bladders and feet.

    Raises ValueError if none is left for a core.
    """
    if lines < len(CHANNELS):
        raise ValueError(f"channels: {lines} are not allowed; give {len(CHANNELS)}")
    return lines - ACTUATORS


def channel_lines(own: Sequence[str]) -> tuple[str, ...]:
    """Names of the lines that channels of robots of one's own are on: all that a rig names itself, else bladders."""
    return tuple(own) or BLADDER_LINES


def spoken(name: str) -> str:
    """A line as people call it, such as ``bladder 1``; names that a rig gives itself stay as they are."""
    return re.sub(r"^(core|bladder|foot)(\d+)$", r"\1 \2", name)


def own_names(field: str, given: object) -> tuple[str, ...]:
    """Check the names that a rig gives its lines.

    Raises:
        ValueError: unless they are 1 to ``MOST_LINES`` different words that no column of a table has.
    """
    if not isinstance(given, list | tuple) or not 0 < len(given) <= MOST_LINES:
        number = f"{len(given)} are" if isinstance(given, list | tuple) else f"{shown(given)} is"
        raise ValueError(f"{field}: {number} not allowed; give 1 to {MOST_LINES} names, such as ['v1', 'v2']")
    for place, name in enumerate(given):
        if not isinstance(name, str) or not re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{LONGEST_NAME - 1}}}", name):
            allowed = f"give a word of letters, digits and _ that begins with a letter, at most {LONGEST_NAME} long"
            raise ValueError(f"{field}: {shown(name)} is not allowed; {allowed}")
        if name in _NOT_LINES:
            raise ValueError(f"{field}: {name!r} is not allowed; no line may be called {', '.join(_NOT_LINES)}")
        if name in given[:place]:
            raise ValueError(f"{field}: {name!r} is not allowed twice; give each line a name of its own")
    return tuple(given)
