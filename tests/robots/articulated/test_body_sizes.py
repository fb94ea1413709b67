"""Sizes of the bodies of robots of files: beside files that were rewritten by hand, alone and in batches."""

import json
import math

import numpy as np
import pytest
from articulated_files import CART, CRAWLER

from optim.named import robot as robot_named
from robots.articulated import ArticulatedRobot, DriveReflexes, differentiate, simulate
from robots.articulated.kind import ArticulatedKind
from robots.articulated.loading import robot_of_record
from robots.articulated.variants import SIZES
from robots.articulated.worlds import GROUND
from robots.free import Free
from robots.own_measures import OwnMeasure
from robots.robot import load_design
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.rigid.model.scaling import scaled_tree

HERE = {"precision": "f64", "threads": 1}
FREE = {"front": Free(0.5, 2.0, 1.0), "trunk": Free(0.5, 2.0, 1.0)}
pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")

LIMB = """<body name="{0}" pos="{1} 0 {2}"><joint name="{0} hip" axis="0 1 0" pos="0 0 {3}" range="-60 60"/>
<geom type="capsule" fromto="0 0 {3} {3} 0 {4}" size="{5}" mass="{6}"/>
<body name="{0} toe" pos="{3} 0 {4}"><joint name="{0} toe" axis="0 1 0" range="-60 60"/>
<geom type="sphere" pos="0 0 {7}" size="{8}" mass="{9}"/>
<body name="{0} nail" pos="0 0 {7}"><geom type="box" size="{10} {10} {10}" pos="{10} 0 0" mass="{11}"/></body>
</body></body>"""


def walker(trunk: float = 1.0, thigh: float = 1.0, toe: float = 1.0, nail: float = 1.0, rise: float = 0.0) -> str:
    """A file of a robot with two limbs, its numbers scaled by hand; joints keep their place on what carries them."""
    limbs = ""
    for name, x in (("fore", 0.2), ("hind", -0.2)):
        hip = 0.02 * thigh  # the joint is above the frame of the thigh
        numbers = (x * trunk, 0.07 * trunk - hip, hip, -0.18 * thigh, 0.02 * thigh, 0.3 * thigh**3)
        feet = (-0.05 * toe, 0.02 * toe, 0.1 * toe**3, 0.02 * nail, 0.05 * nail**3)
        limbs += LIMB.format(name, *numbers, *feet)
    return f"""<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="1 1 1"/>
<body name="trunk" pos="0 0 {0.25 + rise}"><freejoint/>
<geom type="box" size="{0.3 * trunk} {0.1 * trunk} {0.05 * trunk}" mass="{2 * trunk**3}" pos="{0.05 * trunk} 0 0"/>
{limbs}
</body></worldbody><actuator>
{"".join(f'<position joint="{n} hip" kp="30" ctrlrange="-0.8 0.8" forcerange="-8 8"/>' for n in ("fore", "hind"))}
</actuator></mujoco>"""


def crawler(**settings) -> ArticulatedRobot:
    return ArticulatedRobot(CRAWLER, **{"duration": 0.3, "friction": math.inf, "body_sizes": FREE, **settings})


def some_points(robot, count: int, seed: int = 0) -> np.ndarray:
    low, high = np.array([(p.low, p.high) for p in robot.parameters]).T
    return low + (high - low) * np.random.default_rng(seed).uniform(0.2, 0.8, (count, len(low)))


def lowest(tree) -> float:
    centres, radii = tree.balls()
    return float((centres[:, 2] - radii).min())


def numbers_of(tree) -> np.ndarray:
    """All numbers of a tree in one row."""
    found = []
    for body, joint in tree.ordered:
        found += [*body.position, body.mass, *np.ravel(body.inertia), *getattr(joint, "anchor", ())]
        for shape in body.shapes:
            found += [*np.ravel([(*centre, radius) for centre, radius in shape.points()]), shape.volume]
    return np.array(found, float)


@pytest.mark.parametrize(
    "sizes",
    [
        {"trunk": 1.5},
        {"thigh": 0.6},
        {"toe": 1.7},
        {"nail": 2.0},
        {"trunk": 0.7, "thigh": 1.4, "toe": 0.5, "nail": 1.2},
    ],
    ids=str,
)
def test_a_scaled_robot_is_that_of_a_file_scaled_by_hand(sizes):
    """About joints that lie apart from their frames, on what they hang, and with what is welded to them."""
    names = {"trunk": "trunk", "thigh": "????", "toe": "* toe", "nail": "* nail"}
    tree = ArticulatedRobot(walker(), body_sizes={names[each]: size for each, size in sizes.items()}).tree
    as_file = ArticulatedRobot(walker()).tree
    rise = lowest(as_file) - lowest(ArticulatedRobot(walker(**sizes, rise=1.0)).tree) + 1.0
    by_hand = ArticulatedRobot(walker(**sizes, rise=rise)).tree
    assert numbers_of(tree) == pytest.approx(numbers_of(by_hand), abs=1e-12)
    assert lowest(tree) == pytest.approx(lowest(as_file), abs=1e-12)


def test_mass_grows_with_the_cube_and_inertia_with_the_fifth_power():
    robot = crawler(body_sizes={"front": 2.0, "rear": Free(0.5, 2.0, 0.5)})
    (trunk, front, rear), (trunk_1, front_1, rear_1) = (
        [b for b, _ in t.ordered] for t in (robot.tree, robot.model.tree)
    )
    assert (front.mass, rear.mass, trunk.mass) == pytest.approx((8 * front_1.mass, rear_1.mass / 8, trunk_1.mass))
    assert front.inertia == pytest.approx(32 * front_1.inertia) and np.array_equal(trunk.inertia, trunk_1.inertia)
    told = dict(row[:2] for row in robot.facts())
    assert (
        told["Robot"].endswith(f"{1 + 8 * 0.3 + 0.3 / 8:.3g} kg") and told["Bodies"] == "sizes front 2, rear 0.5 to 2"
    )
    assert robot.facts_of([*robot.start[:-1], 2.0]) == [("Mass", f"{1 + 16 * 0.3:.3g} kg")]


def test_sizes_of_one_leave_a_tree_as_it_is_and_a_fixed_base_stays():
    robot = crawler()
    assert scaled_tree(robot.model.tree, [1, 1, 1]) is robot.model.tree is robot.tree
    cart = ArticulatedRobot(CART, fixed=True, body_sizes={"*": 0.5})
    base, wheel = cart.tree.bodies
    assert np.array_equal(base.position, cart.model.tree.bodies[0].position)
    assert wheel.position == pytest.approx(np.add(base.position, (0.15, 0, 0)))
    free = ArticulatedRobot(CART, body_sizes={"*": 2.0})
    assert lowest(free.tree) == pytest.approx(lowest(free.model.tree))


def test_what_a_robot_hangs_on_is_no_body_of_it():
    swing = CRAWLER.replace("<freejoint/>", '<joint name="pivot" pos="0 0 0.3"/>')
    robot = ArticulatedRobot(swing, body_sizes={"*": 0.5})
    assert robot.tree.masses == pytest.approx([0.0, 0.125, 0.0375, 0.0375])
    assert robot.tree.hinges[0].anchor == pytest.approx(robot.model.tree.hinges[0].anchor)
    with pytest.raises(ValueError, match=r"^body_sizes: 'world' is no body; give one of trunk, front, rear, or a"):
        ArticulatedRobot(swing, body_sizes={"world": 2.0})
    with pytest.raises(ValueError, match=r"^body_sizes: with \*=2 its start 380 mm deep in the ground, z = 0, is not"):
        ArticulatedRobot(swing, body_sizes={"*": (0.5, 2.0)})


ARM = """<mujoco><worldbody><body name="upper" pos="0 0 0.3"><joint name="shoulder" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.02"/>
<body name="fore" pos="0 0 0.5"><joint name="elbow" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0.1 0 -0.6" size="0.02"/></body></body></worldbody><actuator>
<position joint="shoulder" ctrlrange="-0.5 0.5"/><position joint="elbow" ctrlrange="-0.5 0.5"/></actuator></mujoco>"""


def test_a_fixed_robot_starts_above_the_ground_at_all_sizes_between_its_bounds():
    """An upper arm that goes up and a fore arm that hangs: deepest where one is smallest and the other is largest."""
    deep = r"^body_sizes: with upper=0.5, fore=2 its start 690 mm deep in the ground, z = 0, is not allowed"
    for sizes in (
        {"upper": (0.5, 2.0), "fore": (0.5, 2.0)},
        {"upper": 0.5, "fore": 2.0},
        {"upper": 0.5, "fore": (1.0, 2.0)},
    ):
        with pytest.raises(ValueError, match=deep):
            ArticulatedRobot(ARM, body_sizes=sizes)
    ArticulatedRobot(ARM, body_sizes={"upper": (1.0, 2.0), "fore": (0.5, 1.25)})
    a_little = ARM.replace('pos="0 0 0.3"', 'pos="0 0 0.1199"')
    with pytest.raises(ValueError, match=r"^body_sizes: with fore=2 its start"):
        ArticulatedRobot(a_little, body_sizes={"fore": 2.0})


def test_bodies_of_a_pattern_share_one_parameter():
    robot = crawler(body_sizes={"[fr]*": (0.5, 3.0)})
    (size,) = robot.parameters[-1:]
    assert (size.name, size.low, size.high, size.first) == ("body_size", 0.5, 3.0, 1.0)
    masses = [body.mass for body in robot.variants.tree_of(np.array([2.0])).bodies]
    assert masses == pytest.approx([1.0, 2.4, 2.4])
    assert crawler(body_sizes={"front*": (1.5, 2)}).parameters[-1].first == 1.75
    for sizes, names in (
        (FREE, ["front_size", "trunk_size"]),
        ({"fr*": (1, 2), "?e*r": (1, 2)}, ["fr_size", "er_size"]),
    ):
        assert [each.name for each in crawler(body_sizes=sizes).parameters[-2:]] == names


@pytest.mark.kernels
def test_a_batch_of_sizes_moves_as_files_that_were_rewritten():
    robot = ArticulatedRobot(walker(), duration=0.3, body_sizes={"????": (0.5, 2), "* toe": (0.5, 2), "trunk": 1.0})
    points = some_points(robot, 3)
    found = simulate(robot, points, **HERE)
    alone = [simulate(robot, point, **HERE).distance[0] for point in points]
    assert found.distance.tolist() == alone and set(found.status) == {"ok"} and len(found.trees) == 3
    for n, point in enumerate(points):
        base = found.trees[n].bodies[0].position
        file = walker(thigh=point[-2], toe=point[-1], rise=base[2] - 0.25)
        by_hand = simulate(ArticulatedRobot(file, duration=0.3), point[:-2], **HERE)
        assert found.distance[n] == pytest.approx(by_hand.distance[0], abs=1e-9)
        assert found.runs[0].position[n] == pytest.approx(by_hand.runs[0].position[0], abs=1e-9)


@pytest.mark.kernels
def test_at_sizes_of_one_a_robot_has_the_bits_of_its_file():
    robot, usual = crawler(), crawler(body_sizes={})
    points = some_points(usual, 2)
    sized = np.column_stack([points, np.ones((2, 2))])
    assert np.array_equal(simulate(robot, sized, **HERE).distance, simulate(usual, points, **HERE).distance)


def high(motion):
    """How high the centre of mass ends above where it began."""
    return (motion.centres(motion.places) - motion.centres(motion.start_places))[:, 2]


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("settings", "world"),
    [
        ({}, GROUND),
        ({"reflexes": DriveReflexes(("velocity", "tilt"), hidden=())}, GROUND),
        ({}, Terrain(ground="rough:0.02,0.2")),
        pytest.param({"controller": "network", "light": (3.0, 1.0, 0.2)}, GROUND, marks=pytest.mark.slow),
        pytest.param({"slip": 0.01}, Terrain(ground="ramp:-10,0.1+sand:3e4+water:0.02"), marks=pytest.mark.slow),
    ],
    ids=("rhythm", "reflexes", "rough", "network", "beach"),
)
def test_derivatives_by_sizes_are_central_differences(settings, world):
    """Of the distance and of own measures: through masses, places, standing heights and what is felt."""
    robot = crawler(**settings, own_measures=(OwnMeasure("high", "m", law=high),), duration=0.2)
    points, step, measures = some_points(robot, 2, seed=3), 1e-6, ("distance", "high")
    found = robot.differentiate(points, world, measures=measures)
    for k in (-2, -1):
        moved = step * np.eye(points.shape[1])[k]
        ends = [robot.simulate(points + side * moved, world).measures for side in (1, -1)]
        for name in measures:
            difference = (ends[0][name] - ends[1][name]) / (2 * step)
            assert found.gradients[name][:, k] == pytest.approx(difference, rel=1e-5, abs=1e-7), (name, k)


@pytest.mark.kernels
def test_derivatives_at_the_largest_size_that_a_fixed_robot_may_have():
    """Its start is then just so deep as is allowed, 5 mm, and deeper with the sizes that differences are taken of."""
    longest = 0.805 / 0.62 - 1e-9  # elbow 0.8 m high, fore arm 0.62 m long
    robot = ArticulatedRobot(ARM, body_sizes={"fore": (0.5, longest)}, friction=math.inf, duration=0.1)
    points = np.array([robot.start] * 2)
    points[:, -1] = longest, longest - 1e-4
    at_it, near_it = differentiate(robot, points, **HERE).gradient[:, -1]
    assert at_it == pytest.approx(near_it, rel=0.01) and near_it != 0


@pytest.mark.kernels
def test_derivatives_are_of_each_robot_alone(monkeypatch):
    robot = crawler(duration=0.1)
    points = some_points(robot, 3)
    whole = differentiate(robot, points, **HERE).gradient
    monkeypatch.setattr("robots.articulated.simulation.TAPE_BYTES", 1)
    assert np.array_equal(differentiate(robot, points, **HERE).gradient, whole)


@pytest.mark.kernels
def test_a_design_keeps_its_sizes_and_is_seen_with_them(tmp_path):
    robot = crawler(friction=None)
    assert "body_sizes" not in crawler(body_sizes={}).describe()
    record = robot.describe()
    assert robot_of_record(json.loads(json.dumps(record))).describe() == record
    point = [*robot.start[:-2], 2.0, 0.5]
    robot.save(point, tmp_path / "design.json")
    design = load_design(tmp_path / "design.json")
    assert design.robot.body_sizes == FREE and design.point.tolist() == point
    with pytest.raises(ValueError, match=r"^body_sizes: .* has its own; leave it out"):
        design.changed({"body_sizes": [{"front": 2.0}]})
    big, usual = (robot.replay([*point[:-2], *sizes], GROUND, frames=3).motion for sizes in ((2.0, 0.5), (1.0, 1.0)))
    toes = [motion.translation[0, [node.name for node in motion.nodes].index("front"), 0] for motion in (big, usual)]
    assert toes == pytest.approx([0.5 * 0.15 + 2 * 0.05, 0.15 + 0.05])  # the middles of capsules


@pytest.mark.kernels
@pytest.mark.parametrize("copies", [None, 2])
def test_environments_have_the_sizes_of_a_design(copies):
    pytest.importorskip("gymnasium")
    from robots.gym.articulated import ArticulatedEnvironment, ArticulatedVector

    robot = crawler(friction=None, own_measures=(OwnMeasure("high", "m", law=high),))
    point = [*robot.start[:-2], 0.6, 1.4]
    given = {"robot": robot.design(point), "actions": "differences", **HERE}
    made = ArticulatedEnvironment(**given) if copies is None else ArticulatedVector(copies, **given)
    made.reset(seed=0)
    left = 1
    while np.max(left):
        *_, info = made.step(np.zeros(made.action_space.shape))
        left = info["left"]
    tried = robot.simulate(point, GROUND, compute=Compute(**HERE)).measures
    for name in ("distance", "high"):
        assert np.ravel(info[name])[0] == pytest.approx(tried[name][0], abs=1e-12)


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ({"tihgh": 2.0}, "body_sizes: 'tihgh' is no body; give one of trunk, front, rear, or a pattern of them"),
        ({"leg*": (0.5, 2)}, "body_sizes: 'leg*' is no body; give one of trunk"),
        ({"f*": 2.0, "*t": 0.5}, "body_sizes: 'f*' and '*t' are both front; give each body once"),
        ({"front": (0.01, 2)}, "body_sizes of front: 0.01 is not allowed; give a number from 0.1 to 10"),
        ({"front": (0.5, 20)}, "body_sizes of front: 20 is not allowed; give a number from 0.1 to 10"),
        ({"front": (2, 0.5)}, "body_sizes of front: 2 to 0.5 is not allowed; give the lower one first"),
        ({"front": Free(20.0, 30.0)}, "body_sizes of front: 20.0 is not allowed"),
        ({"front": 0}, "body_sizes of front: 0 is not allowed; give a number from 0.1 to 10"),
        ({"front": "big"}, "body_sizes of front: 'big' is not allowed"),
        (3.0, "body_sizes: 3.0 is not allowed; give sizes by names of bodies"),
    ],
)
def test_wrong_sizes_are_told_in_one_line(sizes, message):
    with pytest.raises(ValueError) as raised:
        crawler(body_sizes=sizes)
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


def test_a_point_far_beyond_all_sizes_is_refused():
    with pytest.raises(ValueError, match=r"^trunk_size: -1\.0 is not allowed; give a number from 0\.05 to 20"):
        simulate(crawler(), [*crawler().start[:-1], -1.0])


def test_sizes_are_spelled_as_names_and_ranges(tmp_path):
    assert SIZES.parse("thigh*=0.5:2") == {"thigh*": Free(0.5, 2.0, 1.0)} == SIZES.parse("thigh*")
    assert SIZES.parse("torso=1.2") == {"torso": 1.2}
    for text in ("", "=2", "a=", "a=1:2:3", "a=big"):
        with pytest.raises(ValueError, match=r"^body_sizes: .* is not allowed; give NAME, NAME=LOW:HIGH or NAME=SIZE"):
            SIZES.parse(text)
    path = tmp_path / "crawler.xml"
    path.write_text(CRAWLER)
    built = ArticulatedKind().build(str(path), {"body_sizes": [{"front": 2.0}, {"rear": Free(0.5, 2.0)}]})
    assert dict(built.body_sizes) == {"front": 2.0, "rear": Free(0.5, 2.0, 1.0)}
    for given in ({"front": Free(0.5, 2.0)}, "front=0.5:2", ["front"]):
        assert dict(robot_named(path, body_sizes=given).body_sizes) == {"front": Free(0.5, 2.0, 1.0)}
    with pytest.raises(ValueError, match=r"^body_sizes: 'front' is given twice; give each name once$"):
        ArticulatedKind().build(str(path), {"body_sizes": [{"front": 2.0}, {"front": 1.0}]})
