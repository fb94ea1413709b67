"""Articulated robots of files: against the engine itself, central differences, and their own files."""

import json
import math
import warnings

import numpy as np
import pytest
from articulated_files import CART as URDF
from articulated_files import CRAWLER
from crawlers import HERE, crawler, some_points

from optim.named import robot as robot_named
from robots.articulated import ArticulatedRobot, differentiate, load_robot, simulate
from robots.articulated.loading import robot_of_record
from robots.articulated.reflexes import DriveReflexes
from robots.articulated.simulation import centre_slopes, centres, rhythm
from robots.articulated.worlds import GROUND
from robots.own_measures import OwnMeasure
from robots.robot import KINDS, find_robot, load_design, make_robot
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.rigid import RigidEngine

pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


def test_what_is_free_follows_from_the_model():
    assert [p.name for p in crawler().parameters] == [
        "frequency",
        *(f"{drive}_{part}" for drive in "ab" for part in ("amplitude", "phase", "offset")),
    ]
    seeing = crawler(controller="network", light=(2.0, 0.0, 0.3))
    sensors = ("touch front", "touch trunk", "light")
    assert [p.name for p in seeing.parameters] == [f"{s} to {drive}" for s in sensors for drive in "ab"]
    assert ArticulatedRobot(URDF).drives == ("axle",)


@pytest.mark.kernels
def test_distances_along_any_heading_have_the_bits_of_a_robot_alone():
    robot = crawler(heading=33.0)
    points = some_points(robot, 5)
    together = simulate(robot, points, **HERE).distance
    assert together.tolist() == [simulate(robot, point[None], **HERE).distance[0] for point in points]


def test_options_from_python_may_be_descriptions(tmp_path):
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    reflexes, own = DriveReflexes(("tilt",)), OwnMeasure("high", "m", law=lambda motion: motion.places[:, 0, 2])
    made = robot_named(tmp_path / "crawler.xml", reflexes=reflexes, own_measures=[own], duration=np.float32(0.5))
    assert (made.reflexes, made.own_measures, made.duration) == (reflexes, (own,), 0.5)


def test_a_urdf_robot_is_fixed_by_an_option(tmp_path):
    (tmp_path / "cart.urdf").write_text(URDF)
    kind, source = find_robot(str(tmp_path / "cart.urdf"))
    free, fixed = (make_robot(kind, source, options) for options in ({}, {"fixed": True}))
    assert fixed.model.tree.fixed and not free.model.tree.fixed


def test_a_rhythm_stays_within_what_drives_take_and_repeats():
    robot = crawler(duration=2.0, command_rate=100.0)
    points = some_points(robot, 5)
    points[:, 0] = 2.0
    commands = rhythm(robot, points)
    assert commands.shape == (5, 200, 2) and np.abs(commands).max() <= 1
    assert np.allclose(commands[:, :50], commands[:, 50:100], atol=1e-12)
    amplitude, phase, offset = points[3, 4:7]
    assert commands[3, 7, 1] == pytest.approx(
        amplitude * math.sin(2 * math.pi * (2 * 0.07 + phase)) + (1 - amplitude) * offset
    )


def test_a_rhythm_keeps_its_command_rate_with_any_time_step():
    cart = ArticulatedRobot(URDF)
    assert (cart.physics.time_step, cart.physics.friction, cart.hold, cart.steps) == (0.002, 1.0, 10, 2500)
    slow = ArticulatedRobot(URDF, time_step=0.02, friction=0.5)
    assert (slow.physics.time_step, slow.physics.friction, slow.hold, slow.steps) == (0.02, 0.5, 1, 250)
    assert ArticulatedRobot(URDF, time_step=0.05).hold == 1
    crawling = crawler(controller="network", time_step=0.05)
    assert KINDS["articulated"].from_description(crawling.describe()).steps == 8


def test_records_of_earlier_versions_mean_what_they_meant_or_are_refused():
    """There was no time step in them; commands came at most once a step, and ``fixed`` said nothing of MJCF."""
    now = crawler().describe()
    before = {name: value for name, value in now.items() if name != "time_step"} | {"command_rate": 50.0, "fixed": True}
    assert KINDS["articulated"].from_description(before).describe() == now
    other = KINDS["articulated"].from_description(before | {"command_rate": 25.0})
    assert other.command_rate == 25.0 and KINDS["articulated"].from_description(now).describe() == now
    cart = ArticulatedRobot(URDF).describe()
    assert KINDS["articulated"].from_description(cart).describe() == cart
    del cart["time_step"]
    with pytest.raises(
        ValueError, match=r"^robot: it is of a URDF file and of an earlier version, in which such robots"
    ):
        KINDS["articulated"].from_description(cart)


def test_records_of_earlier_versions_keep_their_slip():
    """It was 0.01 m/(N s) in all of them, and they did not tell it."""
    now = crawler().describe()
    assert now["slip"] is None and crawler().physics.slip is None
    before = {name: value for name, value in now.items() if name != "slip"}
    former = KINDS["articulated"].from_description(before)
    assert former.physics.slip == 0.01 and former.describe() == before == crawler(slip=0.01).describe()
    for slip in (None, 1e-3):
        assert KINDS["articulated"].from_description(crawler(slip=slip).describe()).physics.slip == slip


HEAVY = """
<mujoco><worldbody><geom type="plane" size="5 5 .1"/>
<body name="b" pos="0 0 .1"><freejoint/><geom type="box" size=".3 .2 .1" mass="MASS"/>
<body pos="0 0 .15"><joint name="j" type="hinge" axis="0 1 0" range="-10 10"/><geom type="sphere" size=".03" mass=".1"/>
</body></body></worldbody>
<actuator><position joint="j" kp="10" ctrlrange="-0.1 0.1" forcerange="-1 1"/></actuator></mujoco>
"""


@pytest.mark.kernels
@pytest.mark.parametrize("mass", ["1", "50", "1000"])
def test_a_robot_of_any_mass_stands_on_a_hill(mass):
    """Friction is 1, so it holds on 10 degrees."""
    robot = ArticulatedRobot(HEAVY.replace("MASS", mass), duration=1.0)
    still = simulate(robot, [[0.5, 0.0, 0.0, 0.0]], terrain=Terrain(10.0), **HERE)
    assert abs(still.distance[0]) < 1e-4


@pytest.mark.kernels
@pytest.mark.parametrize("controller", ["rhythm", "network"])
def test_it_does_what_the_engine_does(controller):
    robot = crawler(controller=controller, light=(3.0, 1.0, 0.2), heading=30.0, friction=None)
    points = some_points(robot, 3)
    found = simulate(robot, points, record_every=10, **HERE)
    engine = RigidEngine(robot.model.tree, robot.model.world, robot.senses, robot.network, **HERE)
    if controller == "network":
        driven = {"weights": points.reshape(3, 3, 2)}
    else:
        driven = {"commands": rhythm(robot, points), "hold": 2}
    done = engine.run(40, **driven, lights=np.array([[3.0, 1.0, 0.2]]), record_every=10)
    assert np.array_equal(found.runs[0].position, done.position) and robot.model.world.friction == 1.0
    assert found.runs[0].frames.times.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    start = centres(robot.model.tree, *(a[0, :1] for a in vars_of(done.frames)))
    moved = centres(robot.model.tree, done.position, done.orientation, done.angles) - start
    along = [math.cos(math.radians(30)), math.sin(math.radians(30)), 0]
    assert found.distance == pytest.approx(moved @ along, abs=1e-12) and set(found.status) == {"ok"}
    assert set(found.steps) == {40}


def vars_of(frames):
    return frames.position, frames.orientation, frames.angles


@pytest.mark.kernels
@pytest.mark.parametrize("controller", ["rhythm", "network"])
def test_derivatives_are_central_differences(controller):
    robot = crawler(controller=controller, light=(3.0, 1.0, 0.2), heading=20.0, duration=0.2)
    points, shift = some_points(robot, 2, seed=3), 1e-6
    found = differentiate(robot, points, **HERE)
    assert np.array_equal(found.distance, simulate(robot, points, **HERE).distance)
    for n in range(points.shape[1]):
        moved = shift * np.eye(points.shape[1])[n]
        ends = [simulate(robot, points + sign * moved, **HERE).distance for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * shift)
        assert found.gradient[:, n] == pytest.approx(difference, rel=1e-4, abs=1e-8)


@pytest.mark.kernels
def test_derivatives_do_not_depend_on_how_many_are_taken_at_once(monkeypatch):
    robot = crawler(duration=0.1)
    points = some_points(robot, 3)
    whole = differentiate(robot, points, **HERE)
    monkeypatch.setattr("robots.articulated.simulation.TAPE_BYTES", 1)
    done = []
    assert np.array_equal(differentiate(robot, points, progress=done.append, **HERE).gradient, whole.gradient)
    assert done == pytest.approx([1 / 3, 2 / 3, 1.0])


def test_the_slopes_of_the_centre_of_mass_are_central_differences():
    tree, rng, shift = crawler().model.tree, np.random.default_rng(5), 1e-6
    q = rng.normal(size=(2, 4))

    class Pose:
        position, orientation = rng.normal(size=(2, 3)), q / np.linalg.norm(q, axis=1, keepdims=True)
        angles = rng.uniform(-1, 1, (2, 2))

    way = np.array([0.6, 0.0, 0.8])
    slopes = centre_slopes(tree, Pose, way)
    for name, found in zip(("position", "orientation", "angles"), slopes, strict=True):
        for n in range(found.shape[1]):
            ends = []
            for sign in (1, -1):
                values = {each: getattr(Pose, each).copy() for each in ("position", "orientation", "angles")}
                values[name][:, n] += sign * shift
                ends.append(centres(tree, **values) @ way)
            if name != "orientation":
                assert found[:, n] == pytest.approx((ends[0] - ends[1]) / (2 * shift), abs=1e-8)
    turn = 1e-6 * np.array([0.3, -0.5, 0.2])  # an orientation moves on its sphere
    w, x, y, z = Pose.orientation.T
    a, b, c = turn
    change = np.stack(
        [-(a * x + b * y + c * z), a * w + b * z - c * y, b * w + c * x - a * z, c * w + a * y - b * x], 1
    )
    ends = [centres(tree, Pose.position, Pose.orientation + s * change / 2, Pose.angles) @ way for s in (1, -1)]
    assert (slopes[1] * change / 2).sum(1) == pytest.approx((ends[0] - ends[1]) / 2, rel=1e-6, abs=1e-13)


def test_a_design_is_one_file_without_the_model(tmp_path):
    path = tmp_path / "crawler.xml"
    path.write_text(CRAWLER)
    kind, source = find_robot(str(path))
    robot = make_robot(
        kind, source, {"duration": 0.4, "friction": math.inf, "controller": "network", "light": (3.0, 1.0, 0.2)}
    )
    assert kind is KINDS["articulated"] and robot.name == "crawler"
    point = some_points(robot, 1)[0]
    robot.save(point, tmp_path / "design.json")
    path.unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what is ignored was told before
        design = load_design(tmp_path / "design.json")
    assert design.robot.describe() == robot.describe() and np.array_equal(design.point, point)
    design.save((), tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "design.json").read_bytes()
    assert find_robot(str(tmp_path / "design.json"))[0] is kind
    assert str(tmp_path) not in (tmp_path / "design.json").read_text()


@pytest.mark.kernels
def test_it_offers_what_every_robot_offers(tmp_path):
    robot = KINDS["articulated"].from_description(crawler().describe())
    assert json.loads(json.dumps(robot.describe())) == robot.describe()
    world = robot.worlds[0]
    assert KINDS["articulated"].world_of(KINDS["articulated"].world_record(world)) == world == Terrain()
    points = some_points(robot, 2)
    outcome = robot.differentiate(points, world, measures=["speed", "distance"])
    assert outcome.measures["speed"] == pytest.approx(outcome.measures["distance"] / 0.4)
    assert outcome.gradients["speed"] == pytest.approx(outcome.gradients["distance"] / 0.4)
    replay = robot.design(points[1]).replay((), world, frames=9)
    assert replay.outcome.measures["distance"][0] == outcome.measures["distance"][1]
    assert [channel.name for channel in replay.motion.channels][:4] == ["front on ground", "trunk on ground", "a", "b"]
    said, longer = robot.at_horizon(2)
    assert said == "2 seconds" and longer.steps == 200
    assert robot.facts()[0] == ("Robot", "articulated robot: 3 bodies on 2 hinges, 1.6 kg")


@pytest.mark.kernels
@pytest.mark.parametrize("frames", [9, 41])
def test_a_player_counts_distance_as_the_measures_do(frames):
    robot = crawler(heading=33.0, duration=2.0)
    replay = robot.replay(some_points(robot, 1)[0], GROUND, frames=frames, compute=Compute(**HERE))
    distance, speed = replay.motion.channels[-2:]
    assert (distance.name, speed.name) == ("distance", "speed")
    measured = float(replay.outcome.measures["distance"][0])
    assert distance.values[0] == 0 and distance.values[-1] == pytest.approx(measured, abs=1e-9)
    assert abs(measured) < 0.9 * np.hypot(*np.diff(replay.motion.path[:, :2], axis=0).T).sum()  # its base swings


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ArticulatedRobot("<a/>"), "model: <a> is unknown; give a file of <mujoco>"),
        (lambda: crawler(controller="cat"), "controller: 'cat' is unknown; choose one of rhythm, network"),
        (lambda: crawler(duration=-1), "duration: -1 is not allowed"),
        (lambda: crawler(slowest=3.0), "quickest: 2 Hz is not allowed; give more than slowest, 3"),
        (lambda: ArticulatedRobot(URDF, fixed="no"), "fixed: 'no' is not allowed"),
        (lambda: crawler(time_step=0), "time_step: 0 is not allowed; give a positive"),
        (
            lambda: crawler(time_step=0.05, command_rate=50),
            "command_rate: 50 Hz is not allowed with time steps of 0.05 s; give at most 20 Hz, or a shorter time_step",
        ),
        (lambda: crawler(friction=-1), "friction: -1 is not allowed"),
        (lambda: crawler(slip=0), "slip: 0 is not allowed; give a positive finite number"),
        (lambda: crawler(light=(1, 2)), "light: (1, 2) is not allowed; give a place x, y, z [m]"),
        (lambda: crawler(angles={"knee": 1.0}), "angles: there is no hinge 'knee'"),
        (lambda: ArticulatedRobot(CRAWLER.split("<actuator>")[0] + "</mujoco>"), "model: no hinge of it has a drive"),
        (lambda: ArticulatedRobot(URDF, controller="network"), "controller: a network needs sensors"),
        (
            lambda: simulate(crawler(), np.zeros((2, 3))),
            "points: shape (2, 3) is not allowed; give finite",
        ),
        (lambda: simulate(crawler(), [[math.nan] * 7]), "points: nan of frequency is not allowed; give finite"),
        (
            lambda: differentiate(crawler(friction=0.5), [[0.5] * 7]),
            "friction: 0.5 has no derivatives; give inf, as --fr",
        ),
        (lambda: load_robot("none.xml"), "none.xml: "),
        (lambda: KINDS["articulated"].build(None, {}), "robot: an articulated robot is made of a file"),
    ],
)
def test_bad_input_is_told_in_one_line(make, message):
    with pytest.raises(ValueError) as raised:
        make()
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


def test_a_file_that_starts_deep_in_the_ground_is_refused_but_not_in_records(tmp_path):
    """Records of earlier runs are read, and what they found comes out again."""
    path = tmp_path / "deep.xml"
    path.write_text(CRAWLER.replace('pos="0 0 0.1"', 'pos="0 0 0.01"'))
    with pytest.warns(UserWarning, match="deep in the ground"):
        robot = ArticulatedRobot(path.read_text())
    told = r"deep\.xml: model: its start 80 mm deep in the ground, .* starts at least 0\.08 m higher"
    with pytest.raises(ValueError, match=told), warnings.catch_warnings(action="error"):  # nothing is told twice
        load_robot(path)
    assert robot_of_record(robot.describe()).text == robot.text


def test_it_knows_where_it_begins_and_ends():
    """Along its heading, from the origin of the ground, here that of its file."""
    back, front = crawler().footprint
    assert back < 0 < front
    assert crawler(heading=180.0).footprint == pytest.approx((-front, -back))
