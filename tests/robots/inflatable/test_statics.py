"""Statics of two feet: how steep they can inch."""

import math

import pytest

from robots.inflatable.statics import steepest_inching
from robots.world import FLOORS


@pytest.mark.parametrize("share", [0.5, 0.25, 0.0])
@pytest.mark.parametrize("pair", [*FLOORS.values(), (1e-4, 2.0), (0.3, 0.3)])
def test_forces_balance_on_the_steepest_slope(pair, share):
    """Along it, the foot that holds bears weight and the friction of the foot that slides, at the limit of its own."""
    sliding, gripping = pair
    slope = math.radians(steepest_inching(sliding, gripping, share))
    press = math.cos(slope)
    held, slid = (1 - share) * press, share * press
    assert gripping * held == pytest.approx(math.sin(slope) + sliding * slid, abs=1e-12)


def test_known_slopes():
    """On wood, of a sliding foot that does not rub, and of feet that do not differ."""
    assert steepest_inching(*FLOORS["wood"]) == pytest.approx(4.004, abs=1e-3)
    assert steepest_inching(0.0, 2.0) == pytest.approx(45.0)
    assert steepest_inching(0.5, 0.5) == 0.0 > steepest_inching(0.5, 0.5, 0.75)


def test_what_is_not_allowed_is_one_line():
    """A friction, or a share."""
    for given, message in (
        ((-0.1, 0.5), "sliding: -0.1 is not allowed"),
        ((0.7, 0.5), "gripping: 0.5 is not allowed"),
        ((0.1, 0.5, 1.5), "share: 1.5 is not allowed"),
    ):
        with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
            steepest_inching(*given)
