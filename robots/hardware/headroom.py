"""How near what lines are told comes to the limits of the rig that is to play it.

Tables refuse what exceeds a limit; this tells of every channel how much of each limit is used, and how long the rig
takes.
"""

from dataclasses import dataclass

from robots.hardware.rig import ROUNDING, Channel, PneumaticRig
from robots.hardware.timeline import Commands, Timeline

NEAR = 0.9  # of a limit
EXCEEDED, AT_THE_LIMIT, NEAR_THE_LIMIT, WITHIN = "exceeded", "at the limit", "near the limit", "within"


@dataclass(frozen=True)
class Use:
    """What a gait asks of a channel; pressures are gauge pressures.

    Attributes:
        names: of the channels that are asked the same, such as ``("bladder1", "bladder2")``.
        channel: their limits.
        lowest_kpa: pressure [kPa].
        highest_kpa: pressure [kPa].
        fastest_kpa_per_s: change of pressure [kPa/s].
    """

    names: tuple[str, ...]
    channel: Channel
    lowest_kpa: float
    highest_kpa: float
    fastest_kpa_per_s: float

    @property
    def shares(self) -> dict[str, float]:
        """How much of the lowest and highest pressure and of the rate allowed is used; above 1 is exceeded."""
        return {
            "lowest pressure": _share(-self.lowest_kpa, -self.channel.minimum_kpa),
            "highest pressure": _share(self.highest_kpa, self.channel.maximum_kpa),
            "rate": _share(self.fastest_kpa_per_s, self.channel.slew_kpa_per_s),
        }

    @property
    def verdict(self) -> str:
        """``"exceeded"``, ``"at the limit"``, ``"near the limit"`` (above 90 %) or ``"within"``."""
        most = max(self.shares.values())
        if most > 1 + ROUNDING:
            return EXCEEDED
        return AT_THE_LIMIT if most >= 1 - ROUNDING else NEAR_THE_LIMIT if most >= NEAR else WITHIN


@dataclass(frozen=True)
class RigReport:
    """A gait on a rig.

    Attributes:
        uses: of the channels, in their order; neighbours that are asked the same are one.
        shaping_s: until the body has its shape [s].
        playing_s: of the gait after that [s].
        states: columns played.
        shortest_state_s: of those [s].
        longest_state_s: of those [s].
    """

    uses: tuple[Use, ...]
    shaping_s: float
    playing_s: float
    states: int
    shortest_state_s: float
    longest_state_s: float

    @property
    def exceeded(self) -> bool:
        """Whether the rig refuses the gait."""
        return any(use.verdict == EXCEEDED for use in self.uses)


def uses_of(commands: Commands, line: Timeline, rig: PneumaticRig) -> tuple[Use, ...]:
    """What commands, and their rows over time, ask of each channel; neighbours that are asked the same are one."""
    rates = commands.rates(rig).max(axis=0).round(12)  # strokes of different lengths differ in their last bits
    lowest, highest = line.pressures.min(axis=0), line.pressures.max(axis=0)
    uses: list[Use] = []
    for name, *one in zip(
        rig.channel_names, rig.channels, lowest.tolist(), highest.tolist(), rates.tolist(), strict=True
    ):
        if uses and uses[-1] == Use(uses[-1].names, *one):
            uses[-1] = Use((*uses[-1].names, name), *one)
        else:
            uses.append(Use((name,), *one))
    return tuple(uses)


def _share(value: float, limit: float) -> float:
    """The share of a limit above 0 that is used; another limit, such as no vacuum, is kept (0) or not (2)."""
    if limit > 0:
        return max(0.0, value / limit)
    return 2.0 if value > limit + ROUNDING else 0.0
