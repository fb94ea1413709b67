"""Derivatives by pace, core pressures, friction, moduli and sizes, of whole gaits and of their last cycle."""

import dataclasses

import numpy as np
import pytest
from graded import GRIPPING, LOW, tabled

from robots.inflatable import InflatableDesign, differentiate, simulate
from robots.inflatable.materials import RegionMaterials
from robots.world import Terrain

pytestmark = pytest.mark.kernels

HILL = Terrain(slope=5.0)
STEADY = dataclasses.replace(LOW, ramp_steps=500)
UNITS = {"pace": 1.0, "core_pressure": 1e4, "friction": 1.0, "modulus": 1.0, "size": 0.1}


def design_of(seed, geometry=GRIPPING, columns=2, repeats=1, several=False):
    """A gait at a pace of its own with core pressures of columns, of a robot whose regions differ."""
    rng, regions = np.random.default_rng(seed), geometry.region_count
    shape = (geometry.cores, columns) if several else columns
    times = {"motion_steps": np.full(columns, 200), "settle_steps": np.full(columns, 60)}
    gait = tabled(rng.uniform(0.1, 0.9, (8, columns)), rng.uniform(0.1, 0.9, (2, columns)), repeats, **times)
    core, pace = rng.uniform(1e3, 3e3, shape), rng.uniform(0.5, 0.95, (8, columns))
    materials = RegionMaterials(
        rng.uniform([[1.0], [0.1]], [[2.0], [0.6]], (2, 2)),
        rng.uniform(0.6, 1.3, regions),
        rng.uniform(0.9, 1.1, (2, regions)),
    )
    pressure = (2e3, 1e3) if several else 2e3
    return InflatableDesign(pressure, 40.0, dataclasses.replace(gait, core_pressure=core, pace=pace), materials)


def moved(design, part, change):
    if part in ("core_pressure", "pace"):
        gait = dataclasses.replace(design.schedule, **{part: getattr(design.schedule, part) + change})
        return dataclasses.replace(design, schedule=gait)
    materials = dataclasses.replace(design.materials, **{part: np.array(getattr(design.materials, part)) + change})
    return dataclasses.replace(design, materials=materials)


def errors(designs, part, gradient, options, seed=5, steps=(2e-7, 1e-7, 5e-8)):
    """Relative errors of slopes along random directions, at the best step size; infinite where differences jump."""
    direction = UNITS[part] * np.random.default_rng(seed).normal(size=gradient.shape)
    along = (gradient * direction).reshape(len(designs), -1).sum(axis=1)
    copies = [
        moved(design, part, sign * h * way)
        for h in steps
        for sign in (1, -1)
        for design, way in zip(designs, direction, strict=True)
    ]
    distance = simulate(copies, HILL, **options).distance.reshape(len(steps), 2, len(designs))
    slopes = (distance[:, 0] - distance[:, 1]) / (2 * np.array(steps)[:, None])
    assert (along != 0).all(), part
    return np.abs(slopes / along - 1).min(axis=0)


@pytest.mark.parametrize("several", [False, True])
def test_derivatives_by_every_new_number_agree_with_differences(several):
    geometry = dataclasses.replace(GRIPPING, cores=2) if several else GRIPPING
    designs = [design_of(seed, geometry, several=several) for seed in (1, 2, 3)]
    options = {"geometry": geometry, "actuation": STEADY}
    found = differentiate(designs, HILL, **options)
    assert np.array_equal(found.result.distance, simulate(designs, HILL, **options).distance)
    for part in UNITS:
        assert np.median(errors(designs, part, getattr(found, part), options)) < 1e-4, part
