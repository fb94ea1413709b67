"""Props: bodies beside a lattice robot, which touch it by the contact that is there."""

import dataclasses

import numpy as np
import pytest

from optim.problems.robot import RobotProblem
from robots.freeform import FreeformRobot
from robots.ground import Ground
from robots.inflatable.actuation import ACTUATION
from robots.lattice_robot import Drive, Free, LatticeRobot, load_robot, simulate
from robots.lattice_robot.presets import soft_quadruped
from robots.lattice_robot.props import time_step_among
from robots.lattice_robot.reflexes import Reflexes
from robots.props import Prop
from robots.robot import Compute
from robots.uncertainty import Perturbation
from robots.world import Terrain
from taichi_sim.lattice import LatticeEngine, LatticeState, Material, ProgramBuilder, body_from_array

SOFT = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, collision_damping=0.5)
BEHIND = "box:0.02,0.02,0.02,-0.2,0.0"


def crawler(reflexes=None, **settings) -> LatticeRobot:
    """Eighteen voxels in three muscles, without symmetry."""
    regions = np.arange(18).reshape(6, 3, 1) % 3
    array = np.ones((6, 3, 1), int)
    array[5, 2, 0] = 0
    body = body_from_array(array, SOFT, 0.01, regions=regions)
    drive = Drive("legs", (0, 1, 2), amplitude=Free(0, 0.2, 0.1), phase=(0.1, 0.4, Free(0, 1, 0.8)))
    given = {"cycles": 1, "settling": 0.05, "frequency": 4.0, **settings}
    return LatticeRobot(body, (drive,), reflexes=reflexes, **given)


def on(*names: str, **fields) -> Terrain:
    return Terrain(props=names, **fields)


def test_names():
    prop = Prop("box", (0.02, 0.04, 0.02), 0.07, 0.0, 0.03, 500.0)
    for text in (prop.name, "ball:0.04,0.12,-0.01", "wall:0.01,0.1,0.1,0.2,0.0", "box:0.1,0.1,0.1,1.0,0.0,ground,20.0"):
        assert Prop.parse(text).name == text
    assert Prop.parse(prop.name) == prop and Prop.parse("ball:0.04,0.1,0").z is None
    world = Terrain.parse(f"hill:5+rough:0.01+light:1.0,0.5+ball:0.04,0.1,0+{prop.name}")
    assert [each.kind for each in world.props or ()] == ["ball", "box"] and world.light == (1.0, 0.5)
    assert Terrain.parse(world.name) == world == Terrain(**world.document)
    assert Terrain(props=(prop,)).spoken == "on flat ground, with a box"


def test_a_ball_is_round_and_a_box_has_its_edges():
    assert Prop.parse("box:0.021,0.04,0.001,0,0").cells(0.01).max(axis=0).tolist() == [1, 3, 0]
    ball = Prop.parse("ball:0.08,0,0").cells(0.01)
    assert len(ball) == pytest.approx(np.pi / 6 * 8**3, rel=0.1) and ball.max() == 7
    for across in (3, 4, 5, 6, 7, 9, 12):
        cells = Prop.parse(f"ball:{0.01 * across},0,0").cells(0.01)
        assert np.ptp(cells, axis=0).tolist() == [across - 1] * 3
        assert len(cells) == pytest.approx(np.pi / 6 * across**3, rel=0.35 if across < 7 else 0.06)
    assert Prop.parse("ball:0.001,0,0").cells(0.01).tolist() == [[0, 0, 0]]


@pytest.mark.kernels
def test_what_is_far_away_changes_nothing():
    """Measures, senses and lengths are the robot's own."""
    robot = crawler(Reflexes(("strain", "touch", "tilt", "velocity", "light", "clock"), light=(0.1, 0.02)))
    point = robot.start + 0.3 * np.random.default_rng(0).normal(size=len(robot.start)) * (
        np.arange(len(robot.start)) > 1
    )
    alone, beside = simulate(robot, point[None]), simulate(robot, point[None], on(BEHIND, "ball:0.04,0.3,0.2"))
    for name, values in alone.measures.items():
        assert beside.measures[name][0] == pytest.approx(values[0], rel=1e-9, abs=1e-12), name
    assert beside.measures["prop_distance"][0] == pytest.approx(0.0, abs=1e-9)
    assert beside.measures["prop_height"][0] == pytest.approx(0.01, abs=2e-5)


@pytest.mark.kernels
@pytest.mark.parametrize("ground", [None, "wave:0.0,0.1"])
def test_a_wall_holds(ground):
    """A robot that slides down a slope without friction, by g sin(slope) t^2 / 2, rests where it meets a wall."""
    robot = dataclasses.replace(crawler(settling=0.0, cycles=2), drives=(Drive("legs", (0, 1, 2), amplitude=0.0),))
    slope, gap = 5.0, 0.01
    terrain = Terrain(slope, static_friction=0.0, kinetic_friction=0.0, ground=ground)
    wall = f"wall:0.01,0.03,0.03,{-(robot.body.start_positions[:, 0].mean() + 0.0125 + gap)},0.0"
    free, caught = simulate(robot, None, terrain), simulate(robot, None, dataclasses.replace(terrain, props=(wall,)))
    fallen = 0.5 * 9.80665 * np.sin(np.radians(slope)) * (0.75**2 - 0.25**2)
    assert free.distance[0] == pytest.approx(-fallen, rel=1e-2)
    assert abs(caught.distance[0]) < 0.6 * gap and caught.measures["prop_distance"][0] == 0.0


@pytest.mark.kernels
def test_a_box_gives_way():
    robot = soft_quadruped(2)
    points = np.random.default_rng(0).uniform(
        [p.low for p in robot.parameters], [p.high for p in robot.parameters], (16, 40)
    )
    found = simulate(robot, points, precision="f32")
    best = points[found.distance.argmax()][None]
    pushed = simulate(robot, best, on("box:0.02,0.06,0.02,0.058,0.0,ground,300.0"), precision="f32")
    assert found.distance.max() > 0.005 and pushed.measures["prop_distance"][0] > 0.002


@pytest.mark.kernels
def test_a_payload_rests_on_the_back():
    """It slips into the pit between four of the robot's voxels, which repel as spheres."""
    robot = dataclasses.replace(crawler(settling=0.5), drives=(Drive("legs", (0, 1, 2), amplitude=0.0),))
    found = simulate(robot, None, on("box:0.02,0.01,0.01,0,0,0.0125,500.0"))
    assert found.measures["prop_height"][0] == pytest.approx(0.005 + 0.01 * np.sqrt(1.25**2 - 0.5), rel=5e-3)


@pytest.mark.kernels
@pytest.mark.parametrize("density", [10.0, 30.0])
def test_light_props_gain_no_energy(density):
    """One lies still on the floor, and one in the pit on the back of a robot that moves; they leapt by themselves."""
    on_floor = simulate(crawler(), None, on(f"box:0.01,0.01,0.01,0.1,0,ground,{density}"))
    assert on_floor.measures["prop_height"][0] == pytest.approx(0.005, abs=1e-6)
    assert on_floor.measures["prop_distance"][0] == pytest.approx(0.0, abs=1e-4)
    still = dataclasses.replace(crawler(settling=0.3), drives=(Drive("legs", (0, 1, 2), amplitude=0.0),))
    carried = simulate(still, None, on(f"box:0.01,0.01,0.01,0,0,0.0125,{density}"))
    assert carried.measures["prop_height"][0] == pytest.approx(0.005 + 0.01 * np.sqrt(1.25**2 - 0.5), abs=2e-5)


@pytest.mark.kernels
@pytest.mark.parametrize("density", [10.0, 100.0])
def test_a_light_prop_that_is_hit_gains_no_energy(density):
    """It goes on at the speed of the robot; in the robot's own time steps it parted up to 25 times as fast."""
    robot = soft_quadruped().on(on(f"box:0.01,0.01,0.01,0.048,0.0,ground,{density}"))
    placed = robot.placed
    engine = LatticeEngine(placed.body, time_step=robot.cycle.time_step)
    start, hit = engine.state(), placed.of(0)
    moving = np.where(hit[:, None], [0.5, 0.0, 0.0], 0.0)[None]
    positions = (placed.body.start_positions + placed.shift)[None]
    engine.set_state(LatticeState(positions, start.orientations, moving, start.angular_velocities))
    assert engine.run(ProgramBuilder(1).build(int(0.03 / engine.time_step))).status == "ok"
    mass = np.array([m.density for m in placed.body.materials])[placed.body.material_index] * 0.01**3
    velocities = engine.state().velocities[0]
    assert velocities[~hit] == pytest.approx(np.array([[0.5, 0.0, 0.0]]), abs=1e-3)
    assert (mass[:, None] * velocities**2).sum() < mass[hit].sum() * 0.5**2


def test_time_steps_are_shorter_among_light_props_alone():
    """A lattice robot and a freeform one have the same; those beside usual props are their own."""
    robot, freeform = soft_quadruped(), FreeformRobot()
    for box in ("0.02,0.02,0.02,0.2,0,ground,1250", "0.01,0.01,0.01,0.2,0", "0.02,0.02,0.02,0.2,0"):
        assert robot.on(on(f"box:{box}")).cycle.time_step == robot.cycle.time_step
        assert freeform.cycle_on(on(f"box:{box}")).time_step == freeform.cycle.time_step
    for box in ("0.01,0.01,0.01,0.2,0,ground,100", "0.02,0.02,0.02,0.2,0,ground,10", "0.02,0.02,0.02,0.2,0,ground,1e5"):
        there = on(f"box:{box}")
        assert robot.on(there).cycle.time_step == freeform.cycle_on(there).time_step < 0.9 * robot.cycle.time_step
        among = time_step_among(robot.body.materials, there.props, 0.01)
        assert robot.on(there).body.recommended_time_step == among


def test_props_whose_contact_takes_far_shorter_steps_are_refused():
    """The density that is allowed instead is."""
    light, robots = on("box:0.01,0.01,0.01,0.2,0,ground,1"), (soft_quadruped().on, FreeformRobot().cycle_on)
    for place in robots:
        with pytest.raises(ValueError, match=r"^density: 1 kg/m\^3 of the prop box:.* give at least 4.7 kg/m\^3$"):
            place(light)
        place(on("box:0.01,0.01,0.01,0.2,0,ground,4.7"))


@pytest.mark.parametrize("density", [1, 3])
def test_boxes_whose_links_take_far_shorter_steps_are_refused(density):
    """A box of many voxels costs as much as one of a single voxel: against the steps of the robot alone."""
    for place in (soft_quadruped().on, FreeformRobot().cycle_on):
        with pytest.raises(ValueError, match=rf"^density: {density} kg/m\^3 .*50 at most.* give at least 4.7 kg/m\^3$"):
            place(on(f"box:0.02,0.02,0.02,0.1,0,ground,{density}"))
    robot = soft_quadruped()
    there = robot.on(on("box:0.02,0.02,0.02,0.1,0,ground,4.7"))
    assert 40 < robot.cycle.time_step / there.cycle.time_step < 52


def test_beside_a_robot_that_is_far_softer_props_are_refused_at_any_density():
    body = crawler().body
    soft = dataclasses.replace(crawler(), body=body.with_materials([Material(10.0, 1e3)] * len(body.materials)))
    with pytest.raises(ValueError, match=r"^prop: box:.* beside a robot as soft as 10 Pa, .* leave props out$"):
        soft.on(on("box:0.02,0.02,0.02,0.1,0"))


SLOPE = "ramp:30,0.1"


def test_props_that_start_inside_the_ground_are_refused():
    """They were thrown out, 10 m high; from the height that the message names they start on the slope."""
    robot = soft_quadruped()
    with pytest.raises(ValueError, match=r"^prop: box:.* Z = 0 m, .* in the ground; .* at least 0\.1971 m, or"):
        robot.on(on("box:0.02,0.02,0.02,0.4,0,0", ground=SLOPE))
    with pytest.raises(ValueError, match=r"at least 0\.1971 m"):
        robot.on(on("ball:0.01,0.2,0,0.3", "box:0.02,0.02,0.02,0.4,0,0.196", ground=SLOPE))
    for box in ("0.4,0,0.1971", "0.4,0", "0.4,0,ground", "0,0,0.05"):
        robot.on(on(f"box:0.02,0.02,0.02,{box}", ground=SLOPE))
    robot.on(on("wall:0.02,0.02,0.02,0.4,0,0", ground=SLOPE))  # nothing moves it


@pytest.mark.kernels
def test_a_prop_that_starts_as_low_as_is_allowed_is_not_thrown():
    box = "box:0.02,0.02,0.02,0.4,0,0.1971"
    assert simulate(crawler(), None, on(box, ground=SLOPE)).measures["prop_height"][0] < 0.21  # it slides down


BOX = "box:0.03,0.03,0.02,0.08,0"


@pytest.mark.parametrize(
    ("ground", "props", "named", "least"),
    [
        ("stairs:0.02,0.2,0.07", (BOX, f"{BOX},0.0225"), "box:.*0.0225 .* another prop", 0.0425),
        ("stairs:0.02,0.2,0.07", (f"{BOX},0.0225", BOX), "box:.*0.0225 .* another prop", 0.0425),
        ("stairs:0.02,0.2,0.07", (BOX, "ball:0.03,0.08,0,0.03"), "ball:.* another prop", 0.0425),
        ("ramp:20,0.02", (f"wall{BOX[3:]}", f"{BOX},0.03"), "box:.* another prop", 0.0457),
        ("ramp:20,0.02", (f"{BOX},ground", f"wall{BOX[3:]},0.03"), "wall:.* another prop", 0.0457),
        ("rough:0.03,0.05,5", (BOX, f"{BOX},0.0325"), "box:.* another prop", 0.0336),
        ("rough:0.01", ("box:0.02,0.02,0.02,0,0,0.005",), "box:.* the robot", 0.0117),
    ],
)
def test_props_that_overlap_once_they_stand_on_uneven_ground_are_refused(ground, props, named, least):
    """Those with a height rise as the robot does, others as their own ground: they were thrown up to 0.6 m high."""
    with pytest.raises(
        ValueError, match=rf"^prop: {named} .* on their ground\); give a Z of at least .* X and Y$"
    ) as told:
        crawler().on(on(*props, ground=ground))
    found = float(str(told.value).split("at least ")[1].split()[0])
    assert found == least
    names = [Prop.parse(each) for each in props]
    lower, higher = (
        [prop if prop.z is None else dataclasses.replace(prop, z=found - under) for prop in names]
        for under in (3e-4, 0.0)
    )
    crawler().on(Terrain(props=higher, ground=ground))
    with pytest.raises(ValueError, match=named.replace("0.0225", "")):
        crawler().on(Terrain(props=lower, ground=ground))


@pytest.mark.parametrize(
    ("ground", "props"),
    [
        ("stairs:0.02,0.2,0.07", (f"wall{BOX[3:]}", f"wall{BOX[3:]},0.0225")),  # nothing moves them
        ("ramp:-20,0.02", (BOX, f"{BOX},0.01")),  # the ground falls away below the other one
        ("rough:0.01", (BOX, "box:0.03,0.03,0.02,0.1125,0", "box:0.02,0.02,0.02,0,0,0.0125")),
    ],
)
def test_props_that_stand_apart_on_uneven_ground_are_allowed(ground, props):
    assert crawler().on(on(*props, ground=ground)).placed is not None


@pytest.mark.kernels
def test_a_prop_that_starts_just_above_another_one_on_uneven_ground_is_not_thrown():
    world = on(f"{BOX},0.0425", BOX, ground="stairs:0.02,0.2,0.07")
    assert simulate(crawler(), None, world).measures["prop_height"][0] < 0.06


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("ground", "sense"), [pytest.param(None, False, marks=pytest.mark.slow), ("rough:0.004,0.03", True)]
)
def test_the_gradient_is_that_of_central_differences(ground, sense):
    """Of what the robot does and of what becomes of the prop, through their contact."""
    reflexes = Reflexes(("strain", "touch", "velocity", "clock"), gain=0.05) if sense else None
    robot = crawler(reflexes)
    terrain = on("box:0.01,0.01,0.01,0,0,0.0125", "box:0.02,0.02,0.01,0.045,0.002", ground=ground)
    rng = np.random.default_rng(1)
    point = robot.start + np.where(np.arange(len(robot.start)) > 1, 0.3 * rng.normal(size=len(robot.start)), 0.0)
    names = ("distance", "prop_distance", "prop_height", "energy")
    found = robot.differentiate(point, terrain, measures=names, compute=Compute(threads=1))
    assert found.steps[0] > 2000 and found.measures["prop_distance"][0] != 0
    spans = [free.high - free.low for free in robot.free.values()]
    directions = rng.normal(size=(4, len(point))) * spans
    errors = {name: [] for name in names}
    for step in (1e-7, 1e-8, 1e-9):
        run = robot.simulate(
            point + step * np.concatenate([directions, -directions]), terrain, compute=Compute(threads=1)
        )
        for name in names:
            plus, minus = np.split(run.measures[name], 2)
            slope, exact = (plus - minus) / (2 * step), directions @ found.gradients[name][0]
            errors[name].append(np.abs(slope - exact) / np.abs(exact).max())
    for name, each in errors.items():
        assert np.min(each, axis=0).max() < 1e-4, name


def test_searches_know_what_becomes_of_props():
    robot = crawler()
    named = RobotProblem(robot, (on(BEHIND),), objective=("mean", "prop_distance"))
    assert named.objective_names == ("prop_distance",)
    with pytest.raises(ValueError, match="prop_distance"):
        _ = RobotProblem(robot, (on(BEHIND), Terrain()), objective=("mean", "prop_distance")).objective_names


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Terrain.parse("flat+box:0.1,0.1,0.1"),
            "prop: .* is not allowed; give box:LX,LY,LZ,X,Y",
        ),
        (lambda: Terrain.parse("flat+ball:0,0.1,0"), "size: 0"),
        (lambda: Terrain.parse("flat+ball:0.1,there,0"), "x: 'there'"),
        (lambda: Prop("cone", (0.1,), 0.0, 0.0), "prop: 'cone'"),
        (lambda: Prop("ball", (0.1, 0.2), 0.0, 0.0), r"size: \(0.1, 0.2\) is not allowed; give DIAMETER"),
        (lambda: Prop("ball", (0.1,), 0.0, 0.0, -1.0), "z: -1"),
        (lambda: Terrain(props=(3,)), "props: 3 is not allowed"),
        (lambda: Prop.parse("box:9,9,9,20,0").cells(0.01), "size: .* with voxels of 0.01 m"),
        (lambda: crawler().on(on("box:0.02,0.02,0.02,0.035,0")), "prop: box:.* is not allowed .* m from the robot"),
        (lambda: crawler().on(on(BEHIND, BEHIND)), "prop: box:.* from another prop"),
        (lambda: ACTUATION.on(on(BEHIND)), "props: box:.* only lattice robots meet any"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match="^" + message):
        make()


@pytest.mark.kernels
def test_beside_props_a_robot_has_the_bits_that_it_has_alone():
    """In its motion, which follows strains that it feels, and in every measure."""
    robot = crawler(Reflexes(("strain",), gain=0.05))
    points = robot.start + 0.1 * np.random.default_rng(0).normal(size=(5, len(robot.start)))
    world = on("box:0.03,0.03,0.03,0.052,0.0")
    together = simulate(robot, points, world, threads=1)
    for number, point in enumerate(points):
        alone = simulate(robot, point, world, threads=1)
        assert {name: v[number] for name, v in together.measures.items()} == {
            n: v[0] for n, v in alone.measures.items()
        }


@pytest.mark.kernels
def test_heights_are_told_above_the_ground_that_a_robot_begins_on():
    """On top of a wide hill, where the robot lies still."""
    still = dataclasses.replace(crawler(settling=0.3), drives=(Drive("legs", (0, 1, 2), amplitude=0.0),))
    box, hill = "box:0.02,0.02,0.02,0.08,0.0", "rough:0.02,5.0,3"
    found, raised = (simulate(still, None, on(box, ground=ground)) for ground in (None, hill))
    assert Ground(hill).relief(0.0, 0.01).rise(still.body.start_positions, 0.01) > 0.015
    for name in ("jump", "prop_height"):
        assert raised.measures[name][0] == pytest.approx(found.measures[name][0], abs=1e-4), name


def test_props_are_in_no_chamber_of_their_own():
    robot = crawler()
    body = dataclasses.replace(robot.body, chambers=np.ones(robot.body.voxel_count, int))
    assert set(dataclasses.replace(robot, body=body).on(on(BEHIND)).body.chambers.tolist()) == {1}


@pytest.mark.parametrize("density", [1000.0, 60.0])
@pytest.mark.parametrize("modulus", [2e4, 1e5, 4e5])
def test_designs_of_free_moduli_keep_the_time_steps_of_their_search_among_props(modulus, density, tmp_path):
    """Whatever sets them: links of the robot or of props, or their contact."""
    robot = dataclasses.replace(soft_quadruped(), moduli={0: Free(2e4, 4e5)})
    world = Terrain(props=(Prop("box", (0.02, 0.02, 0.02), 0.08, 0.0, density=density),))
    point = robot.start
    point[-1] = modulus
    searched = robot.on(world).cycle
    assert robot.filled(point).on(world).cycle == searched
    robot.save(point, tmp_path / "saved.json")
    saved = load_robot(tmp_path / "saved.json")
    assert saved.on(world).cycle == searched and saved.cycle == robot.cycle
    assert saved.body.materials[0].youngs_modulus == modulus and not saved.parameters


@pytest.mark.parametrize("heading", [0.0, 30.0, 45.0, 50.0, 90.0, 135.0, 180.0, 200.0, -90.0, 270.0])
def test_walls_turn_with_the_heading_by_quarter_turns(heading):
    """Their edges are along the heading, across it and up, as near as the axes of the voxels allow."""
    robot = crawler(heading=heading).on(on("wall:0.02,0.06,0.04,0.15,0.02"))
    starts = (robot.body.start_positions + robot.placed.shift)[robot.placed.of(1)]
    along_y = abs(np.sin(np.deg2rad(heading))) > abs(np.cos(np.deg2rad(heading))) + 1e-6
    edges = [0.06, 0.02, 0.04] if along_y else [0.02, 0.06, 0.04]
    assert np.ptp(starts, axis=0) + 0.01 == pytest.approx(edges)
    left = np.array([-robot.direction[1], robot.direction[0], 0.0])
    middle = starts.mean(axis=0) - robot.placed.robot.start_positions.mean(axis=0)
    assert (middle @ robot.direction, middle @ left) == pytest.approx((0.15, 0.02))


@pytest.mark.parametrize("ground", [{}, {"static_friction": 0.5, "kinetic_friction": 0.4}])
def test_their_friction_is_drawn_with_that_of_the_robot(ground):
    """It stayed at 1.0 and 0.8, unless the terrain gave one, which is drawn for both."""
    robot, terrain, drawn = (
        soft_quadruped(),
        Terrain(props=("box:0.02,0.02,0.02,0.08,0",), **ground),
        Perturbation(0.7, 0.7),
    )
    usual, there = robot.on(terrain), robot.perturbed(drawn).on(robot.drawn_terrain(terrain, drawn))
    assert len(there.body.materials) == len(robot.body.materials) + 1
    for before, after in zip(usual.body.materials, there.body.materials, strict=True):
        assert after.static_friction == pytest.approx(0.7 * before.static_friction)
        assert after.kinetic_friction == pytest.approx(0.7 * before.kinetic_friction)
