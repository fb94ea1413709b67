"""Derivatives by pace, core pressures, friction, moduli and sizes, of whole gaits and of their last cycle."""

import dataclasses

import numpy as np
import pytest
from graded import GRIPPING, LOW, QUICK, TINY, tabled

from robots.inflatable import InflatableDesign, differentiate, simulate
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.program import build_program
from robots.inflatable.simulation import engine_of, travel_directions
from robots.inflatable.timing import Counting, predicted_steps
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners

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


@pytest.mark.parametrize("change", [{}, {"cores": 2}, {"closed": True}])
def test_derivatives_by_every_new_number_agree_with_differences(change):
    geometry, several = dataclasses.replace(GRIPPING, **change), "cores" in change
    designs = [design_of(seed, geometry, several=several) for seed in (1, 2, 3)]
    options = {"geometry": geometry, "actuation": STEADY}
    found = differentiate(designs, HILL, **options)
    assert np.array_equal(found.result.distance, simulate(designs, HILL, **options).distance)
    for part in UNITS:
        assert np.median(errors(designs, part, getattr(found, part), options)) < 1e-4, part


def test_derivatives_agree_with_differences_over_two_thousand_steps_of_contact():
    """Bladders strike out, feet stick and slip, skins touch."""
    designs = [design_of(seed, columns=4) for seed in (1, 2, 3, 4)]
    options = {"geometry": GRIPPING, "actuation": STEADY}
    assert predicted_steps(designs[0], STEADY) > 2000
    found = differentiate(designs, HILL, **options)
    for part in UNITS:
        assert np.median(errors(designs, part, getattr(found, part), options)) < 1e-4, part


def test_robots_with_moduli_of_their_own_leave_others_to_the_bit():
    plain = dataclasses.replace(design_of(1, TINY), materials=None)
    built = dataclasses.replace(plain, materials=RegionMaterials(modulus=(1.0,) * 13))
    options = {"geometry": TINY, "actuation": QUICK, "perturbation": 1e-6}
    alone = simulate(plain, HILL, **options).distance[0]
    beside = simulate([plain, design_of(2, TINY)], HILL, **options).distance[0]
    assert alone == beside == simulate([built, design_of(2, TINY)], HILL, **options).distance[0]


@pytest.mark.parametrize(
    ("part", "terrain"),
    [
        *((part, HILL) for part in ("pressure", "orientation", "levels", "core_pressure", "pace", "friction", "size")),
        *((part, Terrain.water()) for part in ("pressure", "pace", "size")),  # where each step is computed in several
    ],
)
def test_the_last_cycle_is_differentiated_from_the_state_in_which_it_begins(part, terrain):
    design, window = design_of(3, repeats=3), Counting(window=1)
    if part == "pressure":
        design = dataclasses.replace(design, schedule=dataclasses.replace(design.schedule, core_pressure=None))
    found = differentiate(design, terrain, geometry=GRIPPING, actuation=STEADY, counting=window)
    assert found.result.distance == simulate(design, terrain, geometry=GRIPPING, actuation=STEADY).distance
    engine, state, start = engine_of(GRIPPING, [terrain], STEADY, Compute(), [design]), None, None
    unit = {"pressure": 1e4, "orientation": 1e3, "levels": 1.0, **UNITS}[part]
    direction = unit * np.random.default_rng(0).normal(size=getattr(found, part).shape[1:])

    def distance(step):
        nonlocal state, start
        if part == "levels":
            gait = dataclasses.replace(design.schedule, levels=design.schedule.levels + step * direction)
            changed = dataclasses.replace(design, schedule=gait)
        elif part in ("pressure", "orientation"):
            changed = dataclasses.replace(design, **{part: getattr(design, part) + step * float(direction)})
        else:
            changed = moved(design, part, step * direction)
        program = build_program([changed], terrain, STEADY, None, GRIPPING, window)
        before, rest = program.split(program.snapshots[:, -1])
        if state is None:
            engine.run(before)
            state = engine.save()
        engine.restore(state)
        run = engine.run(rest.program)
        middle = mean_of_face_corners(
            GRIPPING.body, run.positions, run.orientations, half_extents(GRIPPING.body, run.strains, run.sizes)
        )
        start = middle[0, -1, :2] if start is None else start  # constant, whatever sizes bladders begin with
        way = (middle[0, 1, :2] - start) @ travel_directions(np.array([changed.orientation]))[0]
        first, end, begin = program.snapshots[0]
        return way * (end - first) / (end - begin)

    distance(0.0)
    slopes = [(distance(h) - distance(-h)) / (2 * h) for h in (2e-7, 1e-7, 5e-8)]
    along = float((getattr(found, part)[0] * direction).sum())
    assert along != 0 and min(abs(slope / along - 1) for slope in slopes) < 1e-4


def test_a_closed_pouch_whose_regions_differ_hardly_drives_itself_along():
    """Under pressure, with nothing told to move."""
    idle = tabled(np.zeros((8, 1)), np.zeros((2, 1)), 1, settle_steps=[4000])
    designs = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        materials = RegionMaterials(size=rng.uniform(0.85, 1.15, (2, 13)), modulus=rng.uniform(0.5, 1.4, 13))
        designs.append(InflatableDesign(12e3, 0.0, idle, materials))
    ways = []
    for closed in (False, True):
        ran = simulate(designs, geometry=dataclasses.replace(TINY, closed=closed), actuation=QUICK)
        ways.append(np.hypot(*ran.displacement.T).mean())
    assert ways[1] < 0.6 * ways[0] and not TINY.body.has_chambers


def test_noise_is_that_of_the_robot_or_of_its_own_seed():
    designs = [design_of(1, TINY)] * 3
    options = {"geometry": TINY, "actuation": QUICK, "perturbation": 1e-5}
    for seed in (7, (1, 2, 1)):
        ran = simulate(designs, HILL, seed=seed, **options).distance
        assert np.array_equal(differentiate(designs, HILL, seed=seed, **options).result.distance, ran)
        assert (ran[0] == ran[2]) == (seed != 7) and ran[0] != ran[1]
    with pytest.raises(ValueError, match=r"^seed: 2 are not allowed for 3 robots; give one, or one each$"):
        simulate(designs, HILL, seed=(1, 2), **options)


def test_mixtures_are_refused():
    whole, plain = design_of(1, TINY), dataclasses.replace(design_of(1, TINY), materials=None)
    with pytest.raises(ValueError, match=r"^designs: a mixture is not allowed; give all of them a pace, friction"):
        differentiate([whole, plain], HILL, geometry=TINY, actuation=QUICK)
