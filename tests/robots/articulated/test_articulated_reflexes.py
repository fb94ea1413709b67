"""Articulated robots that feel: rhythms, senses, answers, and derivatives through both."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from articulated_files import CART, CRAWLER

from robots.articulated import ArticulatedRobot, DriveReflexes, differentiate, simulate
from robots.articulated.kind import REFLEXES
from robots.articulated.loading import robot_of_record
from robots.articulated.reflexes import ReflexLoop, Rhythms, network_of
from robots.articulated.senses import SENSES, Anatomy, DriveReader
from robots.robot import find_robot, load_design, make_robot
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.rigid.feedback import Felt

QUICK = {"duration": 0.4, "friction": math.inf, "light": (3.0, 1.0, 0.2)}
HERE = {"precision": "f64", "threads": 1}
KINDS = [{}, {"hidden": (3,)}, {"kind": "oscillators"}]
pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


def crawler(reflexes=None, **settings) -> ArticulatedRobot:
    """Three bodies with two drives."""
    return ArticulatedRobot(CRAWLER, reflexes=reflexes, **{**QUICK, **settings})


def every(**given) -> DriveReflexes:
    """Reflexes with all senses."""
    return DriveReflexes(tuple(SENSES), **{"gain": 0.4, **given})


def some_points(robot: ArticulatedRobot, count: int, seed: int = 0) -> np.ndarray:
    """Points in the middle of what is allowed."""
    low, high = np.array([(p.low, p.high) for p in robot.parameters]).T
    return low + (high - low) * np.random.default_rng(seed).uniform(0.3, 0.7, (count, len(low)))


@pytest.mark.kernels
@pytest.mark.parametrize("given", KINDS)
@pytest.mark.parametrize("friction", [math.inf, 0.8])
def test_without_weights_the_rhythm_plays(given, friction):
    """To the bit, with frames; derivatives by the rhythm are as without reflexes to the last digits."""
    plain, feeling = crawler(friction=friction), crawler(every(**given), friction=friction)
    points = some_points(plain, 3)
    still = np.column_stack([points, np.zeros((3, len(feeling.parameters) - points.shape[1]))])
    alone, fed = simulate(plain, points, record_every=4, **HERE), simulate(feeling, still, record_every=4, **HERE)
    assert np.array_equal(alone.distance, fed.distance)
    assert np.array_equal(alone.runs[0].frames.neurons, fed.runs[0].frames.neurons)
    if friction == math.inf:
        expected = differentiate(plain, points, **HERE).gradient
        assert differentiate(feeling, still, **HERE).gradient[:, : points.shape[1]] == pytest.approx(expected, rel=1e-9)


@pytest.mark.kernels
@pytest.mark.parametrize("terrain", [None, pytest.param("rough:0.02,0.2", marks=pytest.mark.slow)])
@pytest.mark.parametrize("given", [*KINDS, {"hidden": (3,), "noise": 0.05, "delay": 2}])
def test_derivatives_are_central_differences(given, terrain):
    """By weights and rhythm at once, through every sense but touch, with contact."""
    robot = crawler(every(**given), heading=20.0, duration=0.3)
    world = {} if terrain is None else {"terrain": Terrain.parse(terrain)}
    points = some_points(robot, 2, seed=3)
    found = differentiate(robot, points, **world, **HERE)
    assert np.array_equal(found.distance, simulate(robot, points, **world, **HERE).distance)
    rhythm = robot.rhythm_size
    for n in range(6):
        along = np.random.default_rng(n).normal(size=points.shape[1])
        along[rhythm:] *= n != 0
        along[:rhythm] *= n != 1
        errors = []
        for shift in (1e-5, 1e-6, 1e-7):  # of a stiff contact smaller shifts meet rounding, larger ones curvature
            ends = [simulate(robot, points + sign * shift * along, **world, **HERE).distance for sign in (1, -1)]
            expected = (ends[0] - ends[1]) / (2 * shift)
            errors.append(np.abs(found.gradient @ along - expected) / (np.abs(expected) + 1e-3))
        assert np.min(errors, axis=0).max() < 4e-6, errors


@pytest.mark.kernels
def test_reflexes_matter_and_robots_of_a_batch_have_their_own():
    """Each does what it does alone; commands stay within what drives take."""
    robot = crawler(every(kind="oscillators"))
    points = some_points(robot, 3)
    together = simulate(robot, points, record_every=1, **HERE)
    assert np.array_equal(together.distance, [simulate(robot, p[None], **HERE).distance[0] for p in points])
    still = points.copy()
    still[:, robot.rhythm_size :] = 0.0
    assert np.abs(simulate(robot, still, **HERE).distance - together.distance).min() > 1e-6
    strong = crawler(every(gain=5.0))
    found = simulate(strong, some_points(strong, 3), record_every=1, **HERE)
    assert np.abs(found.runs[0].frames.neurons).max() == 1.0


def felt(name: str, number: int = 0, noise: float = 0.0, seed: int = 0, **given) -> np.ndarray:
    """What a robot at its start feels by a sense, in the second command after it moved by ``moved``."""
    anatomy = Anatomy(touch=2, hinges=2, light=True, drives=1, length=0.5)
    now = {
        "position": np.zeros((1, 3)),
        "orientation": np.array([[1.0, 0, 0, 0]]),
        "angles": np.array([[0.1, -0.2]]),
        "readings": np.array([[1.0, 0.0, 0.25]]),
    }
    rhythms = Rhythms(np.array([[2.0, 0, 0, 0]]), np.zeros((1, 3, 1)), 0.02)
    reflexes = DriveReflexes((name,), noise=noise)
    width = network_of(reflexes, anatomy).weight_count
    loop = ReflexLoop(reflexes, anatomy, np.zeros((1, width)), rhythms, np.zeros((1, 3)), seed)
    for each in range(number + 1):
        loop.decide(each, Felt(**{**now, **given}) if each == number else Felt(**now))
    return loop.readings[-1][0]


def test_senses_feel_what_they_say():
    """By hand."""
    assert felt("touch").tolist() == [1, 0] and felt("light").tolist() == [0.25]
    assert felt("angles").tolist() == [0.1, -0.2]
    lean = np.array([[np.cos(0.1), 0, np.sin(0.1), 0]])  # 0.2 rad about y
    assert felt("tilt", orientation=lean) == pytest.approx([np.sin(0.2), 0])
    assert felt("velocity", 1, position=np.array([[0.01, 0.02, 0.3]])) == pytest.approx([1.0, 2.0])
    assert felt("clock", 2) == pytest.approx([np.sin(0.16 * np.pi), np.cos(0.16 * np.pi)])
    assert np.isfinite(felt("tilt", orientation=np.full((1, 4), np.nan))).all()


def test_noise_is_of_the_seed_and_by_default_as_ever():
    """Runs of earlier versions, which had one noise for all, go on to the same bits."""
    drawn = [[felt("angles", number, 0.1, seed) - felt("angles") for number in range(3)] for seed in (0, 1, 2)]
    ever = [np.random.default_rng(number).normal(0.0, 0.1, 2) for number in range(3)]
    assert np.array_equal(drawn[0], [felt("angles") + each - felt("angles") for each in ever])
    assert len(np.unique(np.round(drawn, 12))) == 18  # no seed and no reading has the numbers of another


@pytest.mark.kernels
def test_the_seed_of_a_robot_is_that_of_its_noise():
    robot = crawler(every(noise=0.05))
    point, other = some_points(robot, 1), replace(robot, seed=7)
    told = [simulate(each, point, **HERE).distance.tolist() for each in (robot, other, replace(robot, seed=0))]
    assert told[0] == told[2] != told[1]
    assert "seed" not in robot.describe()  # a record is as before there was any
    assert robot_of_record(robot.describe()).seed == 0 and robot_of_record(other.describe()).seed == 7
    with pytest.raises(ValueError, match=r"^seed: -1 is not allowed; give a whole number, at least 0$"):
        replace(robot, seed=-1)


def test_acceleration_is_that_of_a_fall():
    """The second difference of the place in lengths a second^2; 0 at first, and at a constant speed."""
    anatomy, span = Anatomy(touch=0, hinges=0, light=False, drives=1, length=0.5), 0.02
    falls = 0.3 + np.array([0.2, -0.1, 5.0]), np.array([0.7, 0.4, 1.0]), np.array([0.0, 0.0, -9.81])
    for gravity in (falls[2], np.zeros(3)):
        reader = DriveReader(("acceleration",), anatomy, span, np.zeros((1, 4)), np.array([[9.0, 9.0, 9.0]]))
        for number in range(5):
            time = number * span
            place = falls[0] + falls[1] * time + gravity * time * time / 2
            found = reader.read(number, Felt(place[None], np.zeros((1, 4)), np.zeros((1, 0)), np.zeros((1, 0))))
            assert found[0] == pytest.approx(gravity / 0.5 if number > 1 else [0, 0, 0], abs=1e-9)


@pytest.mark.parametrize("sooner", [0.0, 0.005, 0.011, 0.018])
def test_acceleration_is_that_of_a_fall_where_the_last_reading_is_sooner(sooner):
    """As where a trial ends within a command; its derivatives are those of differences."""
    anatomy, span, rest = Anatomy(touch=0, hinges=0, light=False, drives=1, length=0.5), 0.02, np.zeros((1, 4))
    reader = DriveReader(("acceleration",), anatomy, span, rest, np.array([[9.0, 9.0, 9.0]]))
    times = np.array([0, span, 2 * span, 3 * span - sooner])
    places = np.array([0.7, 0.4, 1.0]) * times[:, None] + np.array([0.1, 0.0, -9.81]) * times[:, None] ** 2 / 2

    def last(places):
        for number, place in enumerate(places):
            reader.sooner = sooner if number == 3 else 0.0
            found = reader.read(number, Felt(place[None], rest, np.zeros((1, 0)), np.zeros((1, 0))))
        return found[0]

    assert last(places) == pytest.approx([0.2, 0, -19.62], abs=1e-9)
    seeds, back = np.array([1.0, -2.0, 0.5]), []
    for number in reversed(range(4)):
        by, _ = reader.pull_back(number, seeds[None] if number == 3 else None)
        reader.sooner = 0.0
        back.insert(0, by.position[0])
    for number in range(4):  # the law is linear in places
        for axis, by in enumerate(back[number]):
            step = np.zeros((4, 3))
            step[number, axis] = 1e-3
            assert by == pytest.approx(seeds @ (last(places + step) - last(places - step)) / 2e-3, abs=1e-6)


def test_help_lists_every_sense():
    """As the table has them."""
    assert f": {', '.join(SENSES)}, then" in REFLEXES


@pytest.mark.kernels
def test_what_is_felt_is_told_over_time():
    """Of a batch as of each robot; the clock reads sines of the rhythm's time."""
    robot = crawler(DriveReflexes(("clock", "angles"), gain=0.4))
    points = some_points(robot, 2)
    found = robot.readings(points, robot.worlds[0], 1000, Compute(**HERE))
    decisions = -(-robot.steps // robot.hold)
    assert robot.feels and found.shape[0] == 2 and found.shape[2] == decisions
    angle = 2 * np.pi * points[:, :1] * np.arange(decisions) * robot.hold * robot.physics.time_step
    assert found[:, 0] == pytest.approx(np.sin(angle), abs=1e-12) and np.ptp(found[:, 2]) > 0
    alone = robot.readings(points[1:], robot.worlds[0], 1000, Compute(**HERE))
    assert np.array_equal(alone[0], found[1])
    assert robot.readings(points, robot.worlds[0], 5, Compute(**HERE)).shape[2] <= 5
    assert not crawler().feels
    with pytest.raises(ValueError, match="feels nothing"):
        crawler().readings(some_points(crawler(), 1), robot.worlds[0], 5)


def test_a_design_is_one_file(tmp_path):
    """With what it feels; weights are free, or fixed."""
    path = tmp_path / "crawler.xml"
    path.write_text(CRAWLER)
    kind, source = find_robot(str(path))
    reflexes = DriveReflexes.parse("touch,tilt+hidden:3+gain:0.3+delay:1+oscillators+coupling:1")
    assert reflexes == DriveReflexes(("touch", "tilt"), (3,), 0.3, delay=1, kind="oscillators", coupling=1.0)
    robot = make_robot(kind, source, {"reflexes": reflexes})
    assert [p.name for p in robot.parameters][6:8] == ["b_offset", "reflex_1"]
    assert len(robot.parameters) == 7 + 3 * 5 + 6 * 4 and robot.start[7:].tolist() == [0.0] * 39
    assert ("Reflexes", "feels touch and tilt, 1 reading late, 3 hidden nodes, coupled oscillators") in robot.facts()
    robot.save(robot.start, tmp_path / "design.json")
    assert load_design(tmp_path / "design.json").robot.reflexes == reflexes
    assert robot_of_record(json.loads(json.dumps(robot.describe()))).reflexes == reflexes
    assert "reflexes" not in crawler().describe()
    fixed = crawler(DriveReflexes(("tilt",), weights=(0.5,) * 6))
    assert len(fixed.parameters) == 7


@pytest.mark.kernels
def test_fixed_weights_do_what_free_ones_do():
    """In results and in derivatives by the rhythm."""
    free = crawler(DriveReflexes(("tilt",)))
    point = some_points(free, 1)
    fixed = crawler(DriveReflexes(("tilt",), weights=tuple(point[0, 7:].tolist())))
    one, other = differentiate(free, point, **HERE), differentiate(fixed, point[:, :7], **HERE)
    assert one.distance[0] == other.distance[0] and np.array_equal(one.gradient[:, :7], other.gradient)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DriveReflexes(("slip",)), "senses: 'slip' is unknown; choose one of touch, angles"),
        (lambda: DriveReflexes.parse("tilt+hiden:3"), "reflexes: 'hiden:3' is not allowed; give oscillators, hidden:8"),
        (lambda: DriveReflexes.parse("tilt+hidden:x"), "hidden: 'x'"),
        (lambda: DriveReflexes.parse("tilt+delay:0.5"), "delay: 0.5"),
        (lambda: crawler(every(), controller="network"), "reflexes: not allowed beside a network"),
        (lambda: crawler(every(), light=None), "senses: light is not allowed without sensors of it; give a light"),
        (lambda: ArticulatedRobot(CART, reflexes=DriveReflexes(("touch",))), "senses: touch is not allowed without"),
        (lambda: crawler(DriveReflexes(("tilt",), weights=(1.0,))), "weights: 1 are not allowed; give 6"),
        (lambda: crawler(every(kind="oscillators"), command_rate=20.0), "command_rate: 20 Hz is not allowed; give 32"),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()
