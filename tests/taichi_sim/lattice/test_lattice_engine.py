"""The engine's promises: one answer whatever batch, threads and driver; failures are data; nothing compiles twice."""

import copy
import dataclasses

import numpy as np
import pytest
from compiled import noting_compilations
from lattice_reference import load_case
from program_values import values_after

from robots.inflatable import INCHING, ROLLING, InflatableGeometry
from robots.inflatable.actuation import InflatableActuation
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain
from taichi_sim import runtime
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeProgram, Material, ProgramBuilder, Quantity
from taichi_sim.lattice.drivers import stepped
from taichi_sim.lattice.stages import memory

pytestmark = pytest.mark.kernels

# A quick pancake: all stages of a run, with self-contact and floor, in about a thousand steps.
QUICK = InflatableActuation(inflation_rate=0.02, pressure_ramp=100.0, hold_steps=150, settle_steps=100)
TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
RUBBER = Material(4e5, 3000)
BAR = LatticeBody(voxels=[(x, 0, 0) for x in range(4)], materials=(RUBBER,), material_index=[0] * 4, voxel_size=0.01)


def quick_designs(count: int) -> list:
    """Designs that differ in everything, lengths included."""
    generator = np.random.default_rng(3)
    base = [INCHING, ROLLING]
    return [
        dataclasses.replace(
            base[i % 2],
            pressure=float(generator.uniform(0, 12e3)),
            orientation=float(generator.uniform(0, 90)),
            schedule=GaitSchedule(generator.random((10, 2)) < 0.5, repeats=1),
        )
        for i in range(count)
    ]


def trajectory(designs, precision="f64", threads=1, **options):
    """Recorded poses (B, S, V, 7) of a quick gait on a slope."""
    runtime.start(precision=precision, threads=threads)
    engine = LatticeEngine(
        TINY.body, len(designs), time_step=TINY.time_step, floor=True, precision=precision, threads=threads, **options
    )
    program = build_program(designs, Terrain(slope=5.0), QUICK, record_every=100)
    result = engine.run(program)
    assert (result.status == "ok").all()
    return np.concatenate([result.positions, result.orientations], axis=-1), result.steps


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_every_driver_gives_the_same_bits(precision):
    """A thread per link or voxel, or one robot's voxels in lanes."""
    designs = quick_designs(3)
    packed, steps = trajectory(designs, precision)
    assert len(set(steps.tolist())) > 1  # robots end at different steps
    stepped, _ = trajectory(designs, precision, driver="stepped")
    assert np.array_equal(packed, stepped, equal_nan=True)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_robot_does_not_feel_its_batch(precision):
    """Same bits alone, among others, in another order, and with another number of threads."""
    designs = quick_designs(7)
    alone = [trajectory([d], precision)[0][0] for d in designs[:2]]
    together, _ = trajectory(designs, precision)
    backwards, _ = trajectory(designs[::-1], precision)
    threaded, _ = trajectory(designs, precision, threads=2)
    marks = [a.shape[0] for a in alone]
    for robot, (mine, count) in enumerate(zip(alone, marks, strict=True)):
        assert np.array_equal(together[robot, :count], mine)
    assert np.array_equal(together, backwards[::-1], equal_nan=True)
    assert np.array_equal(together, threaded, equal_nan=True)


@pytest.mark.parametrize("room", [24, 1])
def test_memory_of_a_device_gives_the_same_bits(monkeypatch, room):
    """The stepped driver on Taichi's own arrays, as on a GPU, here on the CPU's; also where lists must grow."""
    monkeypatch.setattr(stepped, "PARTNERS_PER_VOXEL", room)
    case = load_case("bars_collide")
    program = dataclasses.replace(case.program(2), lengths=[300, 270], snapshots=np.array([[270], [270]]))
    found = []
    for on_cpu in (True, False):
        engine = LatticeEngine(case.body, 2, time_step=case.time_step, driver="stepped")
        monkeypatch.setattr(engine._driver, "_on_cpu", on_cpu)
        first = engine.run(program)
        second = engine.run(ProgramBuilder(2).build(20, [[20], [10]]))
        assert (engine._driver.plan[memory.PAIRS] > room) == (room == 1)
        found.append(np.concatenate([first.positions, second.positions]))
    assert np.array_equal(*found)


def test_two_runs_continue_as_one():
    """Channels, damping memory and neighbour lists carry over, also for robots that ended before others."""
    case = load_case("bars_collide")
    whole = LatticeEngine(case.body, 2, time_step=case.time_step)
    parts = LatticeEngine(case.body, 2, time_step=case.time_step)
    program = case.program(2)
    whole.run(dataclasses.replace(program, lengths=[3000, 3000], snapshots=np.zeros((2, 0), int)))
    first = dataclasses.replace(program, lengths=[1200, 900], snapshots=np.zeros((2, 0), int))
    parts.run(first)
    parts.run(ProgramBuilder(2).build([1800, 2100]))
    assert np.array_equal(whole.state().positions, parts.state().positions)


@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_divergence_is_reported_and_does_not_spread(driver):
    """One robot is torn apart; the others end as if it were not there."""
    fixed = np.zeros((4, 6), bool)
    fixed[0] = True
    body = dataclasses.replace(BAR, fixed=fixed, regions=[0, 0, 0, 1])
    builder = ProgramBuilder(3)
    builder.set(Quantity.FORCE, [[0.1], [1e7], [0.1]], step=50, regions=[1])
    program = builder.build(400, [[60, 400]] * 3)
    engine = LatticeEngine(body, 3, driver=driver)
    result = engine.run(program)
    assert result.status.tolist() == ["ok", "diverged", "ok"]
    assert 50 < result.steps[1] < 400
    assert np.isnan(result.positions[1, 1]).all()
    assert np.isnan(engine.state().positions[1]).all()
    single = LatticeEngine(body, 1)
    calm = ProgramBuilder(1)
    calm.set(Quantity.FORCE, 0.1, step=50, regions=[1])
    assert np.array_equal(single.run(calm.build(400, [[60, 400]])).positions[0], result.positions[2])
    again = engine.run(ProgramBuilder(3).build(10))
    assert again.status.tolist() == ["ok", "diverged", "ok"]


def test_robots_of_a_batch_may_differ_in_their_materials():
    soft = dataclasses.replace(BAR, materials=(Material(1e5, 3000),))
    program = ProgramBuilder(2)
    program.set(Quantity.SCALE, 1.2, regions=[0])
    both = LatticeEngine([BAR, soft], time_step=1e-4)
    positions = both.run(program.build(50, [[50], [50]])).positions
    for robot, body in enumerate((BAR, soft)):
        alone = ProgramBuilder(1)
        alone.set(Quantity.SCALE, 1.2, regions=[0])
        one = LatticeEngine(body, time_step=1e-4).run(alone.build(50, [[50]]))
        assert np.array_equal(one.positions[0], positions[robot])
    assert not np.array_equal(positions[0], positions[1])


def test_the_watch_list_grows_when_it_must():
    """A bunch of loose voxels, all near each other: far more pairs than there is room for at first."""
    voxels = 2 * np.argwhere(np.ones((4, 4, 4)))
    body = LatticeBody(voxels=voxels, materials=(RUBBER,), material_index=np.zeros(64), voxel_size=0.01)
    close = body.start_positions * 0.35
    builder = ProgramBuilder(2)
    builder.set(Quantity.FORCE, 1e-4, regions=[0])
    program = builder.build(60, [[60], [60]])
    found = []
    for driver in ("packed", "stepped"):
        engine = LatticeEngine(body, 2, driver=driver)
        engine.set_positions(np.stack([close, close * 1.1]))
        found.append(engine.run(program).positions)
        copied = copy.deepcopy(engine)  # with the room of an engine just made, at first
        assert np.array_equal(copied.run(program).positions, engine.run(program).positions)
    assert np.array_equal(*found)
    assert np.ptp(found[0][0, 0], axis=0).min() > np.ptp(close, axis=0).min()  # they pushed each other apart


def test_nothing_compiles_again(monkeypatch):
    """A second body of another shape, other materials, schedules and terrains run on the kernels that exist."""
    runtime.start(precision="f64", threads=1)
    runtime.start(precision="f32", threads=1)  # a fresh start: the first launch compiles
    noted = noting_compilations(monkeypatch)
    LatticeEngine(BAR, 2, precision="f32", threads=1).run(ProgramBuilder(2).build(5))
    assert [name for name, known in noted if not known] == ["run"]
    noted.clear()
    for slope in (0.0, 10.0):
        designs = quick_designs(5)
        engine = LatticeEngine(TINY.body, 5, time_step=TINY.time_step, floor=True, precision="f32", threads=1)
        engine.run(build_program(designs, Terrain(slope=slope), QUICK))
    other = LatticeBody(
        voxels=np.argwhere(np.ones((3, 2, 2))),
        materials=(Material(1e6, 900, poissons_ratio=0.2),),
        material_index=np.zeros(12),
        voxel_size=0.002,
    )
    LatticeEngine(other, 40, precision="f32", threads=1, gravity=9.8).run(ProgramBuilder(40).build(5))
    assert [name for name, known in noted if not known] == []


def test_memory_per_robot():
    """At most 850 KB in f32 for the published robot."""
    from robots.inflatable import PUBLISHED

    engine = LatticeEngine(PUBLISHED.body, 16, precision="f32", floor=True)
    engine.run(ProgramBuilder(16).build(2))
    assert engine.bytes_per_robot < 850_000


def test_states_are_in_double_precision_whatever_the_engine_computes_with():
    state = LatticeEngine(BAR, precision="f32").state()
    assert all(getattr(state, field.name).dtype == np.float64 for field in dataclasses.fields(state))


def test_progress_is_told():
    told = []
    LatticeEngine(BAR).run(ProgramBuilder(1).build(2500), progress=told.append)
    assert told == sorted(told) and told[-1] == 1.0 and len(told) > 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"batch": 0}, "batch: 0 is not allowed"),
        ({"time_step": -1e-4}, "time_step: -0.0001 is not allowed"),
        ({"gravity": np.nan}, "gravity: nan"),
        ({"driver": "magic"}, "driver: 'magic' is unknown; choose one of auto, packed, stepped"),
        ({"precision": "f16"}, "precision: 'f16' is unknown; choose one of f32, f64"),
        ({"compute": Compute(threads=1), "precision": "f32"}, "compute: give it or precision, not both"),
        ({"device": "abacus"}, "device: 'abacus' is unknown"),
        ({"threads": 0}, "threads: 0 is not allowed"),
        ({"device": "cuda", "driver": "packed"}, "driver: 'packed' runs on a cpu only"),
    ],
)
def test_bad_options_are_refused_in_one_line(options, message):
    with pytest.raises(ValueError, match=message):
        LatticeEngine(BAR, **options)


def test_bad_programs_are_refused_in_one_line():
    builder = ProgramBuilder(1)
    builder.set(Quantity.PRESSURE, np.nan, regions=[0])
    with pytest.raises(ValueError, match="events: value must be finite"):
        builder.build(10)
    with pytest.raises(ValueError, match=r"lengths: give one number of steps per robot"):
        ProgramBuilder(1).build([-1])
    with pytest.raises(ValueError, match=r"snapshots: .* none beyond a robot's last step"):
        ProgramBuilder(1).build(10, [[11]])
    with pytest.raises(ValueError, match="program: made for 2 robots, the engine has 1"):
        LatticeEngine(BAR).run(ProgramBuilder(2).build(10))
    builder = ProgramBuilder(1)
    builder.set(Quantity.PRESSURE, 1.0, regions=[7])
    with pytest.raises(ValueError, match=r"events: region 7 is unknown; the body has 0\.\.0"):
        LatticeEngine(BAR).run(builder.build(10))
    with pytest.raises(ValueError, match="body: bodies of one batch may differ"):
        LatticeEngine([BAR, dataclasses.replace(BAR, voxel_size=0.02)])
    with pytest.raises(ValueError, match="positions: give finite numbers of shape"):
        LatticeEngine(BAR).set_positions(np.zeros((1, 3, 3)))


def test_channels_follow_their_events():
    """value + rate (t - s), the last event of a step wins, and other channels do not change."""
    builder = ProgramBuilder(1)
    builder.set(Quantity.PRESSURE, 1.0, rate=0.5, regions=[0])
    builder.set(Quantity.PRESSURE, 7.0, step=4, regions=[0])
    builder.set(Quantity.PRESSURE, 9.0, step=4, regions=[0])
    program: LatticeProgram = builder.build(10)
    assert values_after(program, 0, 0, Quantity.PRESSURE, np.array([0, 1, 2, 4, 5, 9])).tolist() == [
        1,
        1,
        1.5,
        2.5,
        9,
        9,
    ]
    assert values_after(program, 0, 0, Quantity.SCALE, np.array([3])) is None
