"""How near gaits come to the limits of a rig."""

from dataclasses import replace

import numpy as np
import pytest

from robots.hardware import CHANNELS, PneumaticRig, gait_table
from robots.hardware_limits import rig_report
from robots.inflatable import INCHING, ROLLING

RIG = PneumaticRig()


def test_neighbours_that_are_asked_the_same_are_one_and_none_is_missing():
    found = rig_report(INCHING)
    assert [use.names for use in found.uses] == [
        ("core",), CHANNELS[1:5], CHANNELS[5:9], ("foot1", "foot2")
    ]  # fmt: skip
    assert [use.verdict for use in found.uses] == ["at the limit", "at the limit", "within", "at the limit"]


@pytest.mark.parametrize("design", [INCHING, ROLLING, replace(ROLLING, pressure=3e3)])
def test_pressures_and_times_are_those_of_the_table(design):
    table, found = gait_table(design), rig_report(design)
    for use in found.uses:
        for name in use.names:
            pressures = table.pressures[:, CHANNELS.index(name)]
            assert (use.lowest_kpa, use.highest_kpa) == (pressures.min(), pressures.max())
            rates = np.abs(np.diff(pressures) / np.diff(table.times))
            assert use.fastest_kpa_per_s == pytest.approx(rates.max())
    assert found.shaping_s + found.playing_s == pytest.approx(table.times[-1]) and found.states == 16
    assert found.shortest_state_s == pytest.approx(2.0) == found.longest_state_s


@pytest.mark.parametrize(
    ("limit", "verdict", "share"),
    [
        ({"maximum_kpa": 11.9}, "exceeded", "highest pressure"),
        ({"maximum_kpa": 12.0}, "at the limit", "highest pressure"),
        ({"maximum_kpa": 13.0}, "near the limit", "highest pressure"),
        ({"maximum_kpa": 14.0}, "within", "highest pressure"),
        ({"rise_s": 0.5, "slew_kpa_per_s": 20.0}, "exceeded", "rate"),
        ({"rise_s": 0.5, "slew_kpa_per_s": 26.0}, "near the limit", "rate"),
        ({"minimum_kpa": 1.0}, "exceeded", "lowest pressure"),
    ],
)
def test_the_rig_refuses_exactly_what_exceeds_a_limit(limit, verdict, share):
    rig = replace(RIG, core=replace(RIG.core, **limit))
    found = rig_report(ROLLING, rig)
    core = found.uses[0]
    assert core.verdict == verdict and max(core.shares, key=core.shares.get) == share
    assert found.exceeded == (verdict == "exceeded")
    if found.exceeded:
        with pytest.raises(ValueError, match=r"^core: "):
            gait_table(ROLLING, rig)
    else:
        gait_table(ROLLING, rig)
