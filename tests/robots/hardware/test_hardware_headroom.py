"""How near gaits come to the limits of a rig."""

from dataclasses import replace

import numpy as np
import pytest

from robots.hardware import CHANNELS, PneumaticRig, RigViolation, gait_table
from robots.hardware.gait_commands import rig_report
from robots.inflatable import INCHING, ROLLING, GaitSchedule, InflatableDesign

RIG = PneumaticRig()


def test_neighbours_that_are_asked_the_same_are_one_and_none_is_missing():
    found = rig_report(INCHING)
    assert [use.names for use in found.uses] == [("core",), CHANNELS[1:5], CHANNELS[5:9], ("foot1", "foot2")]
    assert [use.verdict for use in found.uses] == ["at the limit", "at the limit", "within", "at the limit"]


@pytest.mark.parametrize("design", [INCHING, ROLLING, replace(ROLLING, pressure=3e3)])
def test_pressures_and_times_are_those_of_the_table(design):
    table, found = gait_table(design), rig_report(design)
    for use in found.uses:
        for name in use.names:
            pressures = table.pressures[:, CHANNELS.index(name)]
            assert (use.lowest_kpa, use.highest_kpa) == (pressures.min(), pressures.max())
            moving = np.diff(table.times) > 0
            rates = np.abs(np.diff(pressures)[moving] / np.diff(table.times)[moving])
            assert use.fastest_kpa_per_s == pytest.approx(rates.max())
    shaping = table.timing[0].end_s
    assert found.shaping_s == shaping and found.states == 16
    assert found.playing_s == pytest.approx(table.durations["prefix"] - shaping + table.durations["main"])
    assert found.shortest_state_s == pytest.approx(2.0) == found.longest_state_s


@pytest.mark.parametrize(
    ("limit", "verdict", "share"),
    [
        ({"maximum_kpa": 49.9}, "exceeded", "highest pressure"),
        ({"maximum_kpa": 50.0}, "at the limit", "highest pressure"),
        ({"maximum_kpa": 54.0}, "near the limit", "highest pressure"),
        ({"maximum_kpa": 60.0}, "within", "highest pressure"),
        ({"maximum_kpa": 90.0, "slew_kpa_per_s": 10.0}, "exceeded", "rate"),
        ({"maximum_kpa": 90.0, "slew_kpa_per_s": 11.5}, "near the limit", "rate"),
    ],
)
def test_the_rig_refuses_exactly_what_exceeds_a_limit(limit, verdict, share):
    core = replace(RIG.channels[0], **limit)
    rig = replace(RIG, supply_kpa=100.0, channels=(core, *RIG.channels[1:]))
    found = rig_report(ROLLING, rig)
    use = found.uses[0]
    assert use.verdict == verdict and max(use.shares, key=use.shares.get) == share
    assert found.exceeded == (verdict == "exceeded")
    if found.exceeded:
        with pytest.raises(RigViolation, match=r"^core: "):
            gait_table(ROLLING, rig)
    else:
        gait_table(ROLLING, rig)


def third_of_a_stroke() -> InflatableDesign:
    """A gait of which one bladder fills to a third, then wholly, and is emptied."""
    levels = np.ones((10, 3))
    levels[:8] = 0.0
    levels[0] = 1 / 3, 0.0, 1.0
    return InflatableDesign(0.0, 90.0, GaitSchedule(levels, 2))


@pytest.mark.parametrize(
    ("design", "seconds", "slew"),
    [(third_of_a_stroke(), 1.0, 20.0), (ROLLING, 1 / 3, 60.0), (INCHING, 0.7, 20.0 / 0.7)],
)
def test_strokes_exactly_at_the_limit_of_rate_are_allowed(design, seconds, slew):
    """Rows have times of whole microseconds; strokes that they shorten by less are not too fast."""
    bladder = replace(RIG.channels[1], rise_s=seconds, fall_s=seconds, slew_kpa_per_s=slew)
    rig = replace(RIG, channels=(RIG.channels[0], *[bladder] * 8, *RIG.channels[9:]))
    found = rig_report(design, rig)
    verdicts = {name: use.verdict for use in found.uses for name in use.names}
    assert not found.exceeded and verdicts["bladder1"] == "at the limit"
    assert gait_table(design, rig).clipped == ()
