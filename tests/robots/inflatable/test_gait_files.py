"""What docs/gait-files.md says a gait's columns do, counted anew here, is what the program does."""

import math

import numpy as np
import pytest
from graded import tabled
from hypothesis import given, settings
from hypothesis import strategies as st
from program_values import values_after

from robots.inflatable.body import BLADDER_REGIONS, FIRST_BLADDER, FOOT_1, FOOT_SEAM, PUBLISHED, SKIN
from robots.inflatable.design import InflatableDesign
from robots.inflatable.program import build_program
from robots.inflatable.timing import gait_timeline
from robots.world import Terrain
from taichi_sim.lattice import Quantity

EMPTY, FULL, RATE = 0.1997, 2.5001, 3e-4


def along(z, pressure):
    return 1 + (z - 0.2) / (1.7 + 8.3 * pressure / 12e3)


class Replay:
    """One gait, step by step, by the words of the page."""

    def __init__(self, design):
        gait, p = design.schedule, design.pressure
        self.begin = math.floor(design.pressure / 0.5) + 1 + 2000
        self.sizes, self.lengths, self.cores, self.weights = [], [], [], []
        self.frictions, self.seams, self.dampings = [], [], []
        z, first = np.full(8, 0.2), True
        for t in list(range(gait.columns)) * gait.repeats:
            u = gait.inflation[:, t]
            target = (1 - u) * EMPTY + u * FULL
            target = np.where((z == 0.2) & (target <= 0.2), z, target)
            tau = np.abs(target - z) / RATE
            m = np.floor(tau).astype(int)
            length, settle = max(int(gait.motion_steps[t]), m.max() + 1), int(gait.settle_steps[t])
            q = p if gait.core_pressure is None else gait.core_pressure[t]
            a, b, c = along(z, p), along(target, p + (q - p) * tau / length), along(target, q)
            for k in range(length):
                self.sizes.append(np.where(k < m, z + np.sign(target - z) * RATE * (k + 1), target))
                after = np.where(k == m, (1 - u) * (1 - (tau - m)), 1 - u)
                self.weights.append(np.where(k < m, 0.0, after))
                arriving = a + (k + 1) * (b - a) / np.maximum(tau, 1e-300)
                self.lengths.append(np.where(k < m, arriving, b + (k + 1 - tau) * (c - b) / (length - tau)))
                self.cores.append(p + (k + 1) * (q - p) / length)
            self.sizes += [target] * settle
            self.lengths += [c] * settle
            self.cores += [q] * settle
            self.weights += [1 - u] * settle
            self.frictions += [(1 - gait.grip[:, t]) * 1e-4 + gait.grip[:, t] * 2] * length + [np.full(2, 2.0)] * settle
            self.seams += [1e-4 if first else 2.0] * length + [2.0] * settle
            self.dampings += [0.002] * length + [0.01] * settle
            z, p, first = target, q, False


@pytest.mark.long
@pytest.mark.parametrize("shapes", [False, True])
@given(seed=st.integers(0, 10**6))
@settings(max_examples=2)
def test_columns_do_what_the_page_says(seed, shapes):
    generator = np.random.default_rng(seed)
    levels, held = generator.uniform(0.0, 1.0, (10, 2)), generator.integers(0, 9000, 2)
    core = generator.uniform(0, 12e3, 2) if shapes else None
    gait = tabled(levels[:8], levels[8:], 2, core, held, generator.integers(0, 3, 2) * 700)
    design = InflatableDesign(generator.uniform(0, 12e3), 40.0, gait)
    said, tilt = Replay(design), 9.80665 * math.cos(math.radians(180 + 15))
    program = build_program([design], Terrain(15.0))
    assert program.lengths[0] == said.begin + len(said.sizes) == said.begin + gait_timeline(design).steps
    steps = np.unique(
        np.concatenate(
            [
                np.linspace(0, len(said.sizes) - 1, 3000).astype(int),
                np.flatnonzero(np.diff(said.dampings)),
                np.arange(3),
            ]
        )
    )

    def channel(region, quantity):
        return values_after(program, 0, region, quantity, said.begin + steps + 1)

    z, lengths = np.array(said.sizes)[steps], np.array(said.lengths)[steps]
    for bladder, region in enumerate(BLADDER_REGIONS):
        np.testing.assert_allclose(channel(region, Quantity.SCALE + 2), z[:, bladder], atol=1e-9)
        np.testing.assert_allclose(channel(region, Quantity.SCALE + 1), lengths[:, bladder], atol=1e-9)
        np.testing.assert_allclose(channel(region, Quantity.SCALE), 1 + (z[:, bladder] - 0.2) / 20, atol=1e-9)
        weight = np.array(said.weights)[steps, bladder] * tilt
        np.testing.assert_allclose(channel(region, Quantity.ACCELERATION + 2), weight, atol=1e-6)
    np.testing.assert_allclose(channel(SKIN, Quantity.PRESSURE), np.array(said.cores)[steps], atol=1e-6)
    for foot in range(2):
        friction = channel(FOOT_1 + foot, Quantity.STATIC_FRICTION)
        np.testing.assert_allclose(friction, np.array(said.frictions)[steps, foot])
    np.testing.assert_allclose(channel(FOOT_SEAM, Quantity.KINETIC_FRICTION), np.array(said.seams)[steps])
    np.testing.assert_allclose(channel(FIRST_BLADDER, Quantity.GLOBAL_DAMPING), np.array(said.dampings)[steps])
    assert values_after(program, 0, 0, Quantity.PRESSURE, np.array([said.begin - 2000]))[0] <= design.pressure
    assert values_after(program, 0, 0, Quantity.PRESSURE, np.array([said.begin - 1999]))[0] == design.pressure


def test_the_numbers_of_the_page_are_the_published_ones():
    assert PUBLISHED.time_step == pytest.approx(1.0602478758e-4, rel=1e-10)
    assert PUBLISHED.body_length == pytest.approx(0.22)
