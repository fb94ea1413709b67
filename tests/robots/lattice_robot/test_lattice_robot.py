"""Robots of the user's own: what drives them, how far they go, and how that changes with what is free."""

import dataclasses

import numpy as np
import pytest
from compiled import noting_compilations
from voxel_files import material, numbers, vxa

from robots.lattice_robot import (
    Drive,
    Free,
    LatticeRobot,
    differentiate,
    load_robot,
    robot_of_voxel_file,
    save_robot,
    simulate,
)
from robots.lattice_robot.faults import settles_at_rest
from robots.lattice_robot.motion import lattice_robot_motion
from robots.lattice_robot.presets import soft_quadruped
from robots.lattice_robot.record import robot_of_record
from robots.lattice_robot.walker import ACTIVE, ANTIPHASE, WalkerActuation, WalkerDesign, WalkerTissue
from robots.lattice_robot.walker import simulate as walk
from robots.view.colouring import GRIPS, PLAIN, SLIDES, colouring
from robots.world import STANDARD_GRAVITY, Terrain
from taichi_sim.lattice import Material, body_from_array
from taichi_sim.lattice.files import load_voxel_file
from taichi_sim.launching import forget_all
from taichi_sim.signals import warping_distances

SOFT = Material(5e4, 1000.0, static_friction=1.0, kinetic_friction=0.5, thermal_expansion=0.01, name="soft")
HARD = Material(1e5, 1500.0, static_friction=1.0, kinetic_friction=0.5, name="hard")
SHAPE = (4, 2, 2)


def lopsided(**settings):
    """Sixteen voxels without any symmetry, and one of everything that can be free."""
    array = np.ones(SHAPE, int)
    array[:, :, 1], array[1:3, :, 0] = 2, 0
    regions = np.arange(16).reshape(SHAPE) % 3
    normals = np.zeros((*SHAPE, 3), int)
    normals[:, :, 1, 2] = 1
    body = body_from_array(array, (SOFT, HARD), 0.02, regions=regions, pressure_normals=normals)
    drives = (
        Drive("legs", (0, 1), amplitude=Free(0, 0.2), phase=(Free(0, 1), Free(0, 1, 0.3)), mean=Free(0.9, 1.1)),
        Drive(
            "rest",
            (2,),
            knots=(Free(-1, 1, 0.5), Free(-1, 1), 0.0, 0.1),
            amplitude=0.1,
            phase=Free(0, 1, 0.21),
            axes="xz",
        ),
        Drive("grip", (0,), "friction", mean=0.8, amplitude=Free(0, 0.5)),
        Drive("blow", (1,), "pressure", amplitude=Free(0, 400.0), phase=0.1),
        Drive("warm", (2,), "temperature", mean=1.0, amplitude=Free(0, 4.0)),
    )
    given = {"moduli": {"soft": Free(3e4, 6e4)}, "cycles": 1, "settling": 0.1, "heading": 20.0} | settings
    return LatticeRobot(body, drives, **given)


NAMES = [
    "legs_mean",
    "legs_amplitude",
    "legs_phase_1",
    "legs_phase_2",
    "rest_phase",
    "rest_knots_1",
    "rest_knots_2",
    "grip_amplitude",
    "blow_amplitude",
    "warm_amplitude",
    "soft_modulus",
]


@pytest.mark.kernels
@pytest.mark.parametrize("ground", [pytest.param(None, marks=pytest.mark.slow), "rough:0.004,0.03"])
def test_the_gradient_is_that_of_central_differences_in_everything_free(ground):
    robot, terrain = lopsided(), Terrain(3.0, ground=ground)
    found = differentiate(robot, None, terrain, threads=1)
    assert list(robot.free) == NAMES and found.gradient.shape == (1, 11)
    span = np.array([free.high - free.low for free in robot.free.values()])
    moves = 1e-6 * np.diag(span)
    run = simulate(robot, robot.start + np.concatenate([moves, -moves]), terrain, threads=1)
    slopes = (run.distance[:11] - run.distance[11:]) / 2e-6
    assert (run.status == "ok").all() and np.abs(slopes).min() > 1e-6
    assert found.gradient[0] * span == pytest.approx(slopes, rel=1e-4)
    assert found.distance[0] == simulate(robot, None, terrain, threads=1).distance[0]


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_gradients_of_robots_that_settle_at_rest_are_those_just_beside(precision):
    regions = np.zeros((6, 2, 2), int)
    regions[3:] = 1
    body = body_from_array(np.ones(regions.shape, int), SOFT, 0.01, regions=regions)
    drive = Drive("legs", (0, 1), amplitude=Free(0, 0.3, 0.15), phase=(Free(-1, 1, 0.0), Free(-1, 1, 0.5)))
    robot = LatticeRobot(body, (drive,), cycles=1, settling=0.1)
    point, moves = robot.start, np.array([[0, 0, 0], [0, 1e-3, 0], [0, 0, 0.5], [0, 1e-4, 1e-4]])
    assert settles_at_rest(robot, point + moves).tolist() == [True, False, True, False]
    assert "phases: all are 0 or 0.5 (legs_phase_1, legs_phase_2)" in robot.caution(point)
    assert not robot.caution(point + moves[1])
    assert not dataclasses.replace(robot, settling=0.0).caution(point)
    shifted = point + moves[3]
    found = differentiate(robot, [point, shifted], threads=1, precision=precision)
    assert np.array_equal(found.distance, simulate(robot, [point, shifted], threads=1, precision=precision).distance)
    assert 0 < np.abs(found.gradient).max() < 1  # metres; 1e148 at the tie itself
    assert found.gradient[0] == pytest.approx(found.gradient[1], rel=1e-3)


@pytest.mark.kernels
def test_points_do_not_depend_on_their_neighbours():
    robot = lopsided()
    points = robot.start * np.array([[1.0], [1.02], [0.97]])
    together = simulate(robot, points, threads=1)
    alone = [simulate(robot, point, threads=1).distance[0] for point in points]
    assert np.array_equal(together.distance, alone) and len(set(alone)) == 3
    slopes = differentiate(robot, np.repeat(points, 4, axis=0), threads=1)  # more than run side by side
    assert slopes.gradient.shape == (12, 11) and slopes.distance[::4].tolist() == alone
    assert np.abs(slopes.gradient[0] / slopes.gradient[3] - 1).max() < 1e-6


@pytest.mark.kernels
def test_a_filled_robot_goes_as_far_as_the_point_it_is_filled_with():
    robot = lopsided()
    point = robot.start * 0.95
    filled = robot.filled(point)
    assert not filled.free and filled.body.materials[0].youngs_modulus == point[-1]
    assert filled.cycle.time_step == robot.cycle.time_step  # that of its stiffest
    assert np.array_equal(simulate(robot, point, threads=1).distance, simulate(filled, threads=1).distance)


@pytest.mark.kernels
def test_a_walker_is_such_a_robot_to_the_bit():
    kinds = np.array([ACTIVE, ACTIVE, ANTIPHASE, ACTIVE, 0, 1, ACTIVE, ANTIPHASE]).reshape(4, 1, 2)
    drive, tissue = WalkerActuation(settling=0.05, cycles=1), WalkerTissue()
    theirs = walk(WalkerDesign(kinds), Terrain(5.0), actuation=drive, tissue=tissue, threads=1)
    body = body_from_array(kinds > 0, tissue.material, tissue.voxel_size, regions=kinds)
    up, down = (
        Drive(name, (kind,), amplitude=a) for name, kind, a in (("up", ACTIVE, 0.14), ("down", ANTIPHASE, -0.14))
    )
    robot = LatticeRobot(body, (up, down), cycles=1, settling=0.05)
    ours = simulate(robot, None, Terrain(5.0), threads=1)
    assert ours.time_step == theirs.time_step and ours.steps[0] == theirs.steps[0]
    assert ours.distance[0] == pytest.approx(theirs.distance[0], rel=1e-6)
    assert ours.speed[0] == pytest.approx(theirs.speed[0], rel=1e-6)


def test_drives_do_at_their_nodes_what_they_say():
    points = np.array([[0.5, 0.25, 0.125, 2.0]])
    drive = Drive(
        "a",
        (3, 4),
        "scale",
        mean=Free(0, 1),
        amplitude=(0.2, Free(0, 1)),
        phase=Free(0, 1),
        knots=(0.0, Free(0, 3), 0, 0),
    )
    nodes = drive.nodes(points, np.ones((3, 2)))
    assert np.array_equal(nodes[:, 0], nodes[:, 1])
    ring = np.interp((np.arange(16) / 16 + 0.125) % 1, np.arange(5) / 4, [0, 2, 0, 0, 0])
    assert nodes[0, 0] == pytest.approx(0.5 + np.outer([0.2, 0.25], ring))
    sine = Drive("b", (0,), "pressure", amplitude=3.0, phase=0.25).nodes(np.zeros((1, 0)), np.zeros((1, 1)))
    assert sine[0, 0, 0] == pytest.approx(3 * np.cos(2 * np.pi * np.arange(16) / 16))


def test_a_scale_may_swing_less_along_one_axis_than_along_another():
    """About what the material says of each."""
    drive = Drive("a", (0,), amplitude=0.2, axes="zy", proportions=(1.0, -0.5))
    nodes = drive.nodes(np.zeros((1, 0)), np.array([[1.0], [0.9]]))
    wave = 0.2 * np.sin(2 * np.pi * np.arange(16) / 16)
    assert nodes[0, 0, 0] == pytest.approx(1.0 + wave) and nodes[0, 1, 0] == pytest.approx(0.9 - 0.5 * wave)


@pytest.mark.kernels
def test_points_that_are_no_robots_are_told_apart():
    robot = LatticeRobot(lopsided().body, (Drive("legs", (0,), amplitude=Free(0, 2)),), cycles=1, settling=0.05)
    for run in (simulate, differentiate):
        found = run(robot, [[0.1], [1.5]], threads=1)
        assert (
            found.status.tolist() == ["ok", "invalid"]
            and np.isnan(found.distance[1])
            and np.isfinite(found.distance[0])
        )
        assert found.reason[1] == "legs shrinks to -0.5 of a voxel; 0.1 is the least"
    assert np.isnan(found.gradient[1]).all() and np.isfinite(found.gradient[0]).all()
    none = differentiate(robot, [[1.5]], threads=1)
    assert none.status.tolist() == ["invalid"] and none.gradient.shape == (1, 1)
    unstable = dataclasses.replace(robot, time_step_safety=0.05)
    burst = differentiate(unstable, [[0.3]], threads=1)
    assert burst.status.tolist() == ["diverged"] and np.isnan(burst.distance[0]) and np.isnan(burst.gradient).all()


def test_heat_and_grip_have_their_limits():
    body = lopsided().body
    cold = LatticeRobot(body, (Drive("heat", (0, 1, 2), "temperature", amplitude=95.0),))
    assert cold.fault(cold.start) == "heat shrinks to 0.05 of a voxel; 0.1 is the least"
    slick = LatticeRobot(body, (Drive("feet", (0,), "friction", mean=0.5, amplitude=0.75),))
    assert slick.fault(slick.start) == "feet has a friction of -0.25; 0 is the least"


@pytest.mark.kernels
def test_robots_survive_files(tmp_path):
    robot = lopsided()
    save_robot(robot, tmp_path / "robot.json")
    again = load_robot(tmp_path / "robot.json")
    assert again.describe() == robot.describe() and again.drives == robot.drives
    assert again.free_moduli == robot.free_moduli and np.array_equal(again.body.voxels, robot.body.voxels)
    assert simulate(again, threads=1).distance == simulate(robot, threads=1).distance
    damaged = robot.describe()
    del damaged["frequency"]
    with pytest.raises(KeyError, match="frequency"):
        robot_of_record(damaged)


def test_a_robot_stands_on_the_ground_wherever_its_array_lies():
    tall = np.zeros((2, 2, 5), int)
    tall[:, :, 3:] = 1
    robot = LatticeRobot(body_from_array(tall, SOFT, 0.02), (Drive("all", (0,), amplitude=0.1),))
    assert robot.body.voxels[:, 2].min() == 0 and robot.length == 0.04
    assert dataclasses.replace(robot, heading=45.0).length == pytest.approx(0.02 * np.sqrt(2) + 0.02)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Free(1.0, 1.0), "low: 1 to 1 is not allowed; low must be below high"),
        (lambda: Free(0.0, 1.0, 2.0), "start: 2.0 is not allowed"),
        (lambda: Drive("a", ()), r"regions: \(\) of a are not allowed"),
        (lambda: Drive("a", (1, 1)), r"regions: \(1, 1\) of a are not allowed"),
        (lambda: Drive("a", (0,), "colour"), "quantity: 'colour' is unknown; choose one of scale, temperature"),
        (lambda: Drive("a", (0,), axes="xw"), "axes: 'xw' of a are not allowed"),
        (
            lambda: Drive("a", (0,), axes="zy", proportions=(1.0,)),
            r"proportions: \(1.0,\) of a are not allowed; give one for each of zy, the first 1",
        ),
        (lambda: Drive("a", (0,), axes="zy", proportions=(0.5, 1.0)), r"proportions: \(0.5, 1.0\) of a are not"),
        (lambda: Drive("a", (0,), "pressure", proportions=(1.0,)), r"proportions: \(1.0,\) of a .* with pressure;"),
        (lambda: Drive("a", (0,), axes="z", proportions="wide"), "a_proportions: 'wide' is not allowed; give a finite"),
        (lambda: Drive("a", (0,), mean=1.0, axes="z", proportions=(1.0,)), r"proportions: .* not allowed with a mean;"),
        (lambda: Drive("a", (0,), knots=(1.0,)), "knots: one of a is not allowed"),
        (lambda: Drive("a", (0, 1), phase=(0.1, 0.2, 0.3)), "phase: 3 values of a are not allowed; give one, or 2"),
        (lambda: Drive("a", (0,), amplitude=np.nan), "a_amplitude: nan is not allowed"),
        (lambda: lopsided(moduli={"wood": Free(1, 2)}), "moduli: 'wood' is unknown; give a material's name, or 0 to 1"),
        (lambda: lopsided(moduli={0: Free(0, 2)}), "moduli: 0 of 0 is not allowed; it must be positive"),
        (lambda: lopsided(frequency=0.0), "frequency: 0.0 is not allowed"),
        (lambda: lopsided(cycles=10**9), "cycles: 1000000000 is not allowed; give a number from 1 to 10000"),
        (lambda: LatticeRobot(lopsided().body, ()), "drives: there are none"),
        (lambda: LatticeRobot(lopsided().body, (Drive("a", (9,)),)), "regions: 9 of a is unknown; the body has 0 to 2"),
        (lambda: LatticeRobot(lopsided().body, (Drive("a", (0,)), Drive("a", (1,)))), "drives: a, a do not all differ"),
        (
            lambda: LatticeRobot(lopsided().body, (Drive("a", (0,)), Drive("b", (0, 1), axes="z"))),
            "drives: a and b both set the scale of region 0; give one",
        ),
        (
            lambda: LatticeRobot(body_from_array([[[1]]], SOFT, 0.1), (Drive("a", (0,), "pressure"),)),
            "drives: no voxel of a has a face under pressure",
        ),
        (lambda: simulate(lopsided(), [[1.0, 2.0]]), r"points: shape \(1, 2\) is not allowed; give finite numbers of"),
        (lambda: simulate(lopsided(), np.full((1, 11), np.nan)), "^points: nan of .* is not allowed; give finite"),
        (lambda: simulate(lopsided(), terrain=Terrain(low_friction=0.1)), "low_friction: 0.1 is not allowed; drive"),
        (lambda: simulate(lopsided(), record_every=0), "record_every: 0 is not allowed"),
        (lambda: load_robot("nothing.py"), "robot: nothing.py is no file"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1", "robot is missing; set it to a LatticeRobot"),
        ("robot = 3", "robot is a int; set it to a LatticeRobot"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("def", "SyntaxError: "),
    ],
)
def test_python_files_without_robots_are_refused_in_one_line(tmp_path, text, message):
    (tmp_path / "mine.py").write_text(text)
    with pytest.raises(ValueError, match=r"mine\.py: ") as error:
        load_robot(tmp_path / "mine.py")
    assert message in str(error.value) and "\n" not in str(error.value)


# --- robots of voxel files


def heated(tmp_path, phases=None, name="robot.vxa"):
    """A slab of muscle on two legs of bone, as evosoro writes it."""
    array = np.ones((4, 2, 2), int)
    array[1:3, :, 0] = 0
    palette = [material("muscle", "5e4", "1e3", more=""), material("bone", "1e5", "1e3", cte="-0.01")]
    array[3] *= 2
    more = "" if phases is None else numbers(phases)
    text = vxa(array, palette, heat="<TempAmp>39</TempAmp><TempPeriod>0.25</TempPeriod>", more=more)
    path = tmp_path / name
    path.write_text(text.replace("0.35", "0").replace("<Lattice_Dim>0.05", "<Lattice_Dim>0.02"))
    return path


@pytest.mark.kernels
def test_a_robot_of_a_vxa_file_walks(tmp_path):
    robot = load_robot(heated(tmp_path))
    assert robot.frequency == 4.0 and robot.drives[0].amplitude == 14 and not robot.free
    found = simulate(robot, threads=1, record_every=200)
    assert found.status[0] == "ok" and abs(found.distance[0]) > 1e-3
    # muscle swells by 14 % while bone shrinks by as much
    sizes = found.frames[0].extents[:, 0]
    edges = (sizes[..., ::2] + sizes[..., 1::2]).mean(axis=2) / 0.02
    kinds = robot.body.material_index
    assert edges[:, kinds == 0].max() > 1.08 and edges[:, kinds == 0].min() < 0.92
    assert np.corrcoef(edges[:, kinds == 0].mean(axis=1), edges[:, kinds == 1].mean(axis=1))[0, 1] < -0.5


@pytest.mark.kernels
def test_a_phase_for_every_voxel_compiles_nothing_new(tmp_path, monkeypatch):
    phases = np.random.default_rng(0).uniform(0, 1, (4, 2, 2))
    plain, waving = load_robot(heated(tmp_path)), load_robot(heated(tmp_path, phases, "waving.vxa"))
    quick = {"cycles": 1, "settling": 0.05}
    plain, waving = dataclasses.replace(plain, **quick), dataclasses.replace(waving, **quick)
    assert (plain.body.region_count, waving.body.region_count) == (2, 12)
    still = simulate(plain, threads=1)
    forget_all()  # so that the next call asks for machine code
    built = noting_compilations(monkeypatch)
    moved = simulate(waving, threads=1)
    assert built and all(known for _, known in built)
    assert moved.status[0] == "ok" and moved.distance[0] != still.distance[0]


@pytest.mark.kernels
def test_phases_of_a_file_can_be_freed(tmp_path):
    phases = np.random.default_rng(0).uniform(0, 1, (4, 2, 2))
    file = load_voxel_file(heated(tmp_path, phases))
    robot = robot_of_voxel_file(file, phase=Free(0.0, 1.0), amplitude=Free(0.0, 20.0, 14.0), cycles=1)
    kinds = file.body.material_index
    expected = np.concatenate([np.sort(file.heat.phase[kinds == kind]) for kind in (0, 1)])
    assert len(robot.free) == 13 and np.array_equal(robot.start[1:], expected)
    fixed = robot_of_voxel_file(file, cycles=1)
    assert simulate(robot, threads=1).distance == simulate(fixed, threads=1).distance


def test_files_that_drive_nothing_and_other_gravity_are_told(tmp_path):
    path = heated(tmp_path)
    path.write_text(path.read_text().replace("<TempEnabled>1", "<TempEnabled>0"))
    with pytest.raises(ValueError, match=r"robot\.vxa: heat: the file drives nothing; make a LatticeRobot of its body"):
        load_robot(path)
    path = heated(tmp_path, name="moon.vxa")
    path.write_text(path.read_text().replace("-9.81", "-1.62"))
    with pytest.warns(UserWarning, match=r"gravity: 1.62 m/s\^2 is not that of the robots"):
        load_robot(path)
    assert pytest.approx(9.81, rel=0.01) == STANDARD_GRAVITY


@pytest.mark.kernels
def test_motions_show_what_drives_each_voxel():
    robot = dataclasses.replace(lopsided(), drives=lopsided().drives[:2], moduli={}, cycles=2)
    motion = lattice_robot_motion(simulate(robot, threads=1, record_every=100), robot, Terrain(3.0))
    assert [channel.name for channel in motion.channels[:2]] == ["legs scale", "rest scale"]
    shown = {node.channel for node in motion.nodes}
    assert shown == {0, 1} and motion.ground.slope == 3.0 and motion.ground.heading == 20.0
    legs = motion.channels[0]
    assert legs.times[-1] == pytest.approx(0.75) and legs.values[4] == pytest.approx(
        1.0 + 0.1 * np.sin(np.pi / 2 + np.pi)
    )


@pytest.mark.kernels
def test_every_wave_of_friction_has_a_row_and_its_feet():
    """Feet may take turns, be driven otherwise too, and be called anything; friction that stays is no foot's."""
    drives = (
        Drive("sole", (0, 1), "friction", mean=0.5, amplitude=0.4, phase=(0.25, 0.75)),
        Drive("mud", (2,), "friction", mean=0.5),
        Drive("speed", (0,), amplitude=0.05, mean=1.0),
        Drive("core", (1,), "pressure", mean=100.0),
    )
    robot = dataclasses.replace(lopsided(), drives=drives, moduli={})
    motion = lattice_robot_motion(simulate(robot, threads=1, record_every=100), robot)
    names = ["sole 1 friction", "sole 2 friction", "mud friction", "speed scale", "core pressure", "distance", "speed"]
    assert [channel.name for channel in motion.channels] == names
    assert [channel.name for channel in motion.channels if channel.read_out] == ["core pressure", "distance", "speed"]
    regions = np.asarray(robot.body.regions)
    shown = {(region, node.channel, node.foot) for region, node in zip(regions.tolist(), motion.nodes, strict=True)}
    assert shown == {(0, 3, 0), (1, 4, 1), (2, 2, None)}
    friction = colouring(motion, "friction").of(0)
    for region, colour in enumerate((GRIPS, SLIDES, PLAIN)):
        assert np.allclose(friction[regions == region], colour)


@pytest.mark.kernels
def test_a_simulation_in_a_callback_leaves_the_outer_one_its_precision():
    robot, signals, seen = soft_quadruped(1), np.random.default_rng(0).standard_normal((2, 3, 20)), []

    def compare(fraction):
        if not seen:
            warping_distances(*signals, precision="f32", threads=1)
        seen.append(fraction)

    alone, beside = (robot.simulate(robot.start[None], Terrain(), progress=told).measures for told in (None, compare))
    assert len(seen) > 1 and alone["speed"] == beside["speed"]
