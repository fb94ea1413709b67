"""How steep a robot can inch on two feet, by statics: what the friction of sliding and of gripping feet allows."""

import math

from taichi_sim.base import checks


def steepest_inching(sliding: float, gripping: float, share: float = 0.5) -> float:
    """The steepest slope up which one foot slides ahead while the other one holds [degrees]; negative is downhill only.

    The foot that holds must bear what pulls along the slope: gravity, and the friction of the foot that slides up. Per
    unit of what the robot presses on the ground, gripping * (1 - share) = tan(slope) + sliding * share. Nothing is
    accelerated, and nothing but feet touches the ground. Both feet slide in turn, so feet that always carry the same
    climb best at a share of 1/2; for less, the robot must lean on the foot that holds, in turn.

    Args:
        sliding: friction of the foot that slides.
        gripping: friction of the foot that holds, at least that of the foot that slides.
        share: of the load, on the foot that slides, 0 to 1.

    Raises:
        ValueError: for what is not allowed.
    """
    sliding, share = checks.number("sliding", sliding, 0.0), checks.number("share", share, 0.0, 1.0)
    gripping = checks.number("gripping", gripping, sliding)
    return math.degrees(math.atan(gripping * (1.0 - share) - sliding * share))
