"""Time courses of tables beside those of the simulator."""

from dataclasses import replace

import numpy as np
import pytest

from robots.calibration import Properties
from robots.hardware import PneumaticRig, gait_table
from robots.hardware.time_course import course_difference, designed_course, table_course
from robots.inflatable import INCHING, PUBLISHED, ROLLING
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.timing import gait_steps, gait_timeline

SHARES = np.array([0.001, 0.25, 0.5, 0.999])


@pytest.mark.parametrize("gait", [INCHING, ROLLING])
def test_both_courses_end_every_state_at_the_levels_that_are_told(gait):
    told = gait_timeline(gait).levels.T
    designed, seconds = designed_course(gait, SHARES, ACTUATION)
    rows, lasting = table_course(gait_table(gait), SHARES)
    assert designed.shape == rows.shape == (len(told), 4, 10)
    assert np.abs(designed[:, -1] - told).max() < 1e-3 and np.abs(rows[:, -1] - told).max() < 2e-3
    assert seconds == pytest.approx(19.80, abs=0.01) and lasting == pytest.approx(32.0)


def test_feet_of_a_rig_take_strokes_that_the_simulator_has_not():
    found = course_difference(gait_table(INCHING))
    assert found.stretch == pytest.approx(1.616, abs=0.001)
    assert found.actuator.startswith("foot") and found.largest > 0.9 and 0.0 < found.mean < 0.15
    assert str(found).startswith("its rows take 1.62 times as long") and found.actuator in str(found)


def test_a_stiffer_robot_takes_shorter_steps():
    stiff = Properties(friction=1.0, low_friction=0.1, modulus=4 * PUBLISHED.youngs_modulus, inflation_rate=1.0)
    geometry, actuation = stiff.robot(PUBLISHED)
    table, shorter = gait_table(INCHING), geometry.time_step / PUBLISHED.time_step
    found = course_difference(table, actuation, geometry.time_step)
    assert shorter < 0.6
    assert found.stretch == pytest.approx(course_difference(table, actuation).stretch / shorter, rel=1e-6)
    assert found.stretch == pytest.approx(32 / (gait_steps(INCHING.schedule, actuation) * geometry.time_step), rel=1e-3)


def test_a_rig_with_the_simulators_strokes_differs_by_none():
    """Bladders take the share of a column that they take in the simulator, and feet next to nothing."""
    rig, seconds = PneumaticRig(), 0.813
    swift = [replace(c, rise_s=seconds, fall_s=seconds, slew_kpa_per_s=1e6) for c in rig.channels[:9]]
    feet = [replace(c, rise_s=1e-6, fall_s=1e-6, slew_kpa_per_s=1e9) for c in rig.channels[9:]]
    table = gait_table(replace(ROLLING, schedule=ROLLING.schedule.cut(None, 1)), replace(rig, channels=(*swift, *feet)))
    found = course_difference(table)
    # A table of on and off does not dwell: its bladders take all of the state, the simulator's two thirds of it.
    assert found.stretch == pytest.approx(0.66, abs=0.01) and found.mean < 0.06
