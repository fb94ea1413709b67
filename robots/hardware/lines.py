"""The lines of a rig, by the actuators that they drive: cores first, then bladders, then feet.

They are the pneumatic robot's in Powers 2021, ch. 5; other robots use the lines of bladders for their channels.
"""

BLADDERS = 8
FEET = 2
ACTUATORS = BLADDERS + FEET
BLADDER_LINES = tuple(f"bladder{number}" for number in range(1, BLADDERS + 1))
FOOT_LINES = tuple(f"foot{number}" for number in range(1, FEET + 1))
ACTUATOR_LINES = (*BLADDER_LINES, *FOOT_LINES)
CHANNELS = ("core", *ACTUATOR_LINES)


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
