"""Levels between 0 and 1 in motion: on and off at its bits, and derivatives of distances."""

import dataclasses

import numpy as np
import pytest
from graded import retabled, tabled, unskipped
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.inflatable import InflatableActuation, InflatableDesign, InflatableGeometry, simulate
from robots.inflatable.gradient import READ_OFF, differentiate, distance_cotangents
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.simulation import summarise
from robots.world import Terrain
from taichi_sim.lattice import LatticeResult

pytestmark = pytest.mark.kernels

TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
QUICK = InflatableActuation(inflation_rate=0.03, pressure_ramp=50.0, hold_steps=200, settle_steps=100)
HILL = Terrain(slope=5.0)
# Its feet reach the ground.
GRIPPING = InflatableGeometry(bladder_columns=1, rows=12, foot_rows=4, bladder_layers=1, voxel_size=0.02)
LOW = dataclasses.replace(QUICK, deflated=0.05, hold_steps=600)
UNITS = {"pressure": 1e4, "orientation": 1e3, "inflation": 1.0, "grip": 10.0, "core_pressure": 1e4}
PARTS = tuple(UNITS)


def random_design(seed: int, columns: int = 2, core: bool = False) -> InflatableDesign:
    generator = np.random.default_rng(seed)
    tables = generator.uniform(0.1, 0.9, (8, columns)), generator.uniform(0.1, 0.9, (2, columns))
    pressure = generator.uniform(1e3, 3e3, columns) if core else None
    return InflatableDesign(2e3, 40.0, tabled(*tables, 1, pressure))


def moved(design: InflatableDesign, part: str, change: np.ndarray | float) -> InflatableDesign:
    if part in ("pressure", "orientation"):
        return dataclasses.replace(design, **{part: getattr(design, part) + change})
    gait = retabled(design.schedule, **{part: getattr(design.schedule, part) + change})
    return dataclasses.replace(design, schedule=gait)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_gaits_without_idle_columns_travel_as_far_to_the_bit(precision):
    generator = np.random.default_rng(3)
    bits = generator.random((2, 10, 4)) < 0.5
    bits[:, 0] = [True, False, True, False]  # a full stroke in every column
    designs = [InflatableDesign(p, 30.0, GaitSchedule(b, 1)) for p, b in zip((0.0, 5e3), bits, strict=True)]
    options = {"geometry": TINY, "actuation": QUICK, "precision": precision}
    binary = simulate(designs, HILL, perturbation=1e-6, seed=4, **options)
    relaxed = simulate([unskipped(d) for d in designs], HILL, perturbation=1e-6, seed=4, **options)
    assert (binary.status == "ok").all() and (np.abs(binary.distance) > 1e-4).all()
    for field in ("distance", "speed", "speed_simulated", "steps", "status"):
        assert np.array_equal(getattr(relaxed, field), getattr(binary, field))


STILL = GaitSchedule(np.zeros((10, 1)), 1)
WHOLE = np.array([[-1.0, 1.0]] * 3)  # from the first snapshot to the last


def fake_run(seed: int):
    """A run that never was: random poses, strains and sizes."""
    generator, body = np.random.default_rng(seed), TINY.body
    voxels = (3, 2, body.voxel_count)
    shapes = [(*voxels, 3), (*voxels, 4), (3, 2, len(body.topology.links)), (*voxels, 3)]
    arrays = [generator.normal(size=shape) for shape in shapes]
    return generator, LatticeResult(np.array(["ok"] * 3), np.full(3, 100), *arrays)


def distances(run: LatticeResult, headings: np.ndarray) -> np.ndarray:
    designs = [InflatableDesign(0.0, float(heading), STILL) for heading in headings]
    return summarise(run, build_program(designs, HILL, QUICK, geometry=TINY), designs, TINY, QUICK).distance


@given(st.integers(0, 1000))
@settings(max_examples=10)
def test_cotangents_of_distances_agree_with_differences(seed):
    """In every argument in turn."""
    generator, run = fake_run(seed)
    headings = generator.uniform(1, 89, 3)
    found, h = distance_cotangents(TINY.body, run, headings, WHOLE), 1e-5
    for name, gradient in zip((*READ_OFF, "headings"), found, strict=True):
        direction = generator.normal(size=gradient.shape)
        sides = []
        for step in (h * direction, -h * direction):
            if name == "headings":
                sides.append(distances(run, headings + step))
            else:
                sides.append(distances(dataclasses.replace(run, **{name: getattr(run, name) + step}), headings))
        change = (sides[0] - sides[1]).sum() / (2 * h)
        assert (gradient * direction).sum() == pytest.approx(change, rel=1e-6, abs=1e-8)


def test_a_diverged_robot_has_no_cotangents():
    _, run = fake_run(0)
    whole = distance_cotangents(TINY.body, run, np.zeros(3), WHOLE)
    lost = dataclasses.replace(run, status=np.array(["ok", "diverged", "ok"]))
    for name in READ_OFF:
        getattr(lost, name)[1, 1] = np.nan
    for part, before in zip(distance_cotangents(TINY.body, lost, np.zeros(3), WHOLE), whole, strict=True):
        assert (part[1] == 0).all()
        assert np.array_equal(part[[0, 2]], before[[0, 2]])


@pytest.mark.parametrize("core", [False, True])
def test_derivatives_of_distances_agree_with_differences(core):
    """The whole way: design, program, lattice and back. Three robots, each part of a design in a random direction."""
    designs = [random_design(seed, core=core) for seed in (1, 2, 3)]
    options = {"geometry": GRIPPING, "actuation": dataclasses.replace(LOW, ramp_steps=500)}
    found = differentiate(designs, HILL, **options)
    assert np.array_equal(found.result.distance, simulate(designs, HILL, **options).distance)
    assert (found.result.status == "ok").all()
    assert (found.core_pressure is not None) == core
    generator = np.random.default_rng(5)
    steps = np.array([1e-7, -1e-7, 5e-8, -5e-8])
    for part in PARTS if core else PARTS[:-1]:
        gradient = getattr(found, part)
        direction = UNITS[part] * generator.normal(size=gradient.shape)
        copies = [moved(d, part, h * v) for h in steps for d, v in zip(designs, direction, strict=True)]
        distance = simulate(copies, HILL, **options).distance.reshape(4, 3)
        far, near = (distance[::2] - distance[1::2]) / (steps[::2] - steps[1::2])[:, None]
        along = (gradient * direction).reshape(3, -1).sum(axis=1)
        assert (along != 0).all(), part
        smooth = np.abs(far - near) < 1e-4 * np.abs(far)  # not where contact or friction begins or ends in between
        assert smooth.any(), part
        assert along[smooth] == pytest.approx(far[smooth], rel=1e-3), part


def test_failed_robots_have_no_derivatives():
    """Bladders that jump to thousands of voxels tear a robot apart; its neighbour does not mind."""
    torn = random_design(1)
    violent = InflatableActuation(inflated=5e3, inflation_rate=5e3, hold_steps=200, settle_steps=100, ramp_steps=500)
    flat = moved(torn, "inflation", -torn.schedule.inflation)
    found = differentiate([torn, flat], HILL, geometry=TINY, actuation=violent)
    assert found.result.status.tolist() == ["diverged", "ok"]
    for part in PARTS[:-1]:
        assert np.isnan(getattr(found, part)[0]).all() and np.isfinite(getattr(found, part)[1]).all()


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: simulate([]), "designs: give at least one InflatableDesign"),
        (lambda: differentiate([]), "designs: give at least one InflatableDesign"),
        (lambda: simulate(random_design(0), precision="f16"), "precision: 'f16' is unknown"),
        (lambda: differentiate([random_design(0), random_design(0, columns=3)]), "designs: a mixture is not allowed"),
        (lambda: simulate(random_design(0), perturbation=-1.0), "perturbation: -1.0 is not allowed"),
        (lambda: simulate(random_design(0), seed=-1), "seed: -1 is not allowed"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(build, message):
    with pytest.raises(ValueError, match=f"^{message}.*$"):
        build()


def test_groups_of_robots_have_the_gradients_of_each(monkeypatch):
    """More robots than run side by side are differentiated one group after the other."""
    designs = [random_design(i) for i in range(3)]
    options = {"geometry": TINY, "actuation": dataclasses.replace(QUICK, ramp_steps=50), "threads": 1}
    whole = differentiate(designs, HILL, **options)
    monkeypatch.setattr("robots.inflatable.gradient.ROBOTS_PER_THREAD", 2)
    reports = []
    grouped = differentiate(designs, HILL, **options, progress=reports.append)
    assert np.array_equal(grouped.result.distance, whole.result.distance)
    for part in ("pressure", "orientation", "inflation", "grip"):
        assert getattr(grouped, part) == pytest.approx(getattr(whole, part), rel=1e-9, abs=1e-12)
    assert reports == sorted(reports) and reports[-1] == 1.0


def test_on_and_off_have_gradients_too():
    design = InflatableDesign(3e3, 30.0, GaitSchedule(np.eye(10)[:, :2], 1))
    options = {"geometry": TINY, "actuation": QUICK, "threads": 1}
    found = differentiate(design, HILL, **options)
    assert found.result.distance == simulate(design, HILL, **options).distance
    assert found.inflation.shape == (1, 8, 2) and np.abs(found.inflation).max() > 0


def test_too_little_memory_is_refused():
    with pytest.raises(ValueError, match=r"^memory: 1000 B is not allowed; .* need at least"):
        differentiate(random_design(0), geometry=TINY, actuation=QUICK, memory=1000)
