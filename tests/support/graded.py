"""Graded gaits for tests."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robots.inflatable import PUBLISHED, InflatableActuation, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.gradient import pull_back
from robots.inflatable.schedule import GaitSchedule

TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
TINY_TWO = InflatableGeometry(bladder_columns=1, rows=12, foot_rows=2, voxel_size=0.02, cores=2)
QUICK = InflatableActuation(inflation_rate=0.03, pressure_ramp=50.0, hold_steps=200, settle_steps=100)
# Its feet reach the ground.
GRIPPING = InflatableGeometry(bladder_columns=1, rows=12, foot_rows=4, bladder_layers=1, voxel_size=0.02)
LOW = replace(QUICK, deflated=0.05, hold_steps=600)

levels = st.floats(0.0, 1.0, allow_subnormal=False) | st.sampled_from([0.0, 0.5, 1.0])
steps = st.integers(0, 5000)


def tabled(inflation, grip, repeats=2, core_pressure=None, motion_steps=None, settle_steps=None) -> GaitSchedule:
    """The schedule of bladders' and feet's levels that skips no idle column."""
    others = {"core_pressure": core_pressure, "motion_steps": motion_steps, "settle_steps": settle_steps}
    return GaitSchedule.from_tables({"inflation": inflation, "grip": grip, **others}, repeats)


def retabled(gait: GaitSchedule, **tables) -> GaitSchedule:
    """The schedule with other tables."""
    return GaitSchedule.from_tables({**gait.tables, **tables}, gait.repeats)


def unskipped(design: InflatableDesign) -> InflatableDesign:
    """The design whose schedule skips no idle column."""
    return replace(design, schedule=replace(design.schedule, skip_idle=False))


@st.composite
def graded_gaits(draw):
    """Gaits with all, some or no times of their own, with and without pressures of their own."""
    columns = draw(st.integers(1, 4))
    times = [draw(st.none() | arrays(np.int64, columns, elements=steps)) for _ in range(2)]
    core = draw(st.none() | arrays(float, columns, elements=st.floats(1.0, 12e3)))
    tables = [draw(arrays(float, (rows, columns), elements=levels)) for rows in (8, 2)]
    return tabled(*tables, draw(st.integers(1, 3)), core, *times)


graded_designs = st.builds(
    InflatableDesign, st.just(0.0) | st.floats(1.0, 12e3), st.floats(0.0, 90.0, allow_subnormal=False), graded_gaits()
)


def settling(levels, settle, repeats=1, motion=None) -> GaitSchedule:
    """The gait of levels, shape (10, T), that moves as fast as it goes and settles for so many steps."""
    levels = np.asarray(levels, float)
    motion = np.zeros(levels.shape[1]) if motion is None else motion
    return tabled(levels[:8], levels[8:], repeats, motion_steps=motion, settle_steps=settle)


def pulled_back(program, designs, terrain, actuation, values, rates, geometry=PUBLISHED) -> list[dict[str, np.ndarray]]:
    """Derivatives of a cost by each design of a program, by their names, from those by the program's events."""
    found = []
    for robot, design in enumerate(designs):
        mine = program.events["robot"] == robot
        by = pull_back(design, terrain, actuation, geometry, values[mine], rates[mine])
        by["inflation"], by["grip"] = np.split(by.pop("levels"), [8])
        found.append(by)
    return found
