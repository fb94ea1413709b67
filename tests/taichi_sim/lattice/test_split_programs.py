"""Programs in two parts: channels that change go on where they were, and derivatives come back to their events."""

import numpy as np
import pytest
from program_values import values_after

from taichi_sim.lattice import ProgramBuilder, Quantity

PRESSURE, SCALE = int(Quantity.PRESSURE), int(Quantity.SCALE)


def program():
    """Two robots: a ramp that is stopped, a value that is overruled in the same step, and one that comes late."""
    builder = ProgramBuilder(robot_count=2)
    builder.set(PRESSURE, 1.0, regions=[0], rate=0.5)
    builder.set(PRESSURE, 9.0, regions=[0], step=10)
    builder.set(SCALE, [[1.0], [2.0]], regions=[1], step=4)
    builder.set(SCALE, [[3.0], [4.0]], regions=[1], step=4)
    builder.set(PRESSURE, 7.0, regions=[1], step=8, robots=[1])
    return builder.build([12, 20], [[3, 12], [6, 20]])


def test_the_second_part_begins_with_what_channels_are_by_then():
    first, rest = program().split([6, 10])
    assert first.lengths.tolist() == [6, 10] and rest.program.lengths.tolist() == [6, 10]
    assert first.snapshots.tolist() == [[3, -1], [6, -1]] and rest.program.snapshots.tolist() == [[-1, 6], [-1, 10]]
    assert values_after(first, 0, 0, PRESSURE, np.array([6])) == [3.5]
    assert values_after(rest.program, 0, 0, PRESSURE, np.array([1, 3, 5])).tolist() == [4.0, 5.0, 9.0]
    # What the split's step sets wins.
    assert values_after(rest.program, 1, 0, PRESSURE, np.array([1])).tolist() == [9.0]
    for robot, value in enumerate((3.0, 4.0)):
        assert values_after(rest.program, robot, 1, SCALE, np.array([1, 6])).tolist() == [value, value]
    assert values_after(rest.program, 0, 1, PRESSURE, np.array([1])) is None


def test_derivatives_come_back_to_the_events_that_were_carried_on():
    whole = program()
    _, rest = whole.split([6, 10])
    count = len(rest.program.events)
    values, rates = rest.gather(np.arange(1.0, count + 1), np.full(count, 0.25))
    ramp = int(np.flatnonzero((whole.events["robot"] == 0) & (whole.events["rate"] == 0.5))[0])
    place = int(np.flatnonzero(rest.source == ramp)[0])
    assert values[ramp] == place + 1 and rates[ramp] == 6 * (place + 1) + 0.25
    overruled = np.flatnonzero((whole.events["quantity"] == SCALE) & np.isin(whole.events["value"], (1.0, 2.0)))
    assert not values[overruled].any() and not rates[overruled].any()


@pytest.mark.parametrize("steps", [[-1, 0], [0, 21], [0]])
def test_a_split_outside_the_program_is_refused_in_one_line(steps):
    with pytest.raises(ValueError, match=r"^steps: .* are not allowed; give one from 0 to each robot's length$"):
        program().split(steps)
