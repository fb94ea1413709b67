"""Uneven ground under rigid robots: the same as a plane where it is one, and its gradients."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rigid_differences import error_of_gradient

from taichi_sim.ground import Relief
from taichi_sim.rigid import Body, Box, Capsule, Hinge, Motor, Physics, RigidEngine, Senses, Sphere, State, Tree
from taichi_sim.rigid.pose import rotation_matrix

pytestmark = pytest.mark.kernels

STEPS = 300
WORLDS = [
    {"friction": friction, "integration": integration}
    for friction in (math.inf, 0.6)
    for integration in ("momentum", "velocity")
]


def rough(seed: int = 0, height: float = 5e-3, friction: bool = False, nodes: int = 60) -> Relief:
    rng = np.random.default_rng(seed)
    heights = height * rng.standard_normal((nodes, nodes))
    return Relief(heights, 0.05, (-1.513, -1.487), rng.uniform(0.7, 1.3, heights.shape) if friction else None)


def level(height: float = 0.0) -> Relief:
    return Relief(np.full((2, 2), height), 1.0, (-0.5, -0.5))


def walker(height: float = 0.0, radius: float = 0.06) -> Tree:
    """A trunk with a leg before and behind, one a ball, the other a capsule."""
    trunk = Body("trunk", (0.0, 0.0, 0.3 + height), 2.0, [Box((0.4, 0.2, 0.1))])
    front = Body("front", (0.25, 0.0, 0.09 + height), 0.3, [Sphere(radius)])
    back = Body("back", (-0.25, 0.0, 0.08 + height), 0.3, [Capsule(0.05, 0.2, (0.0, 1.0, 0.0))])
    motor = Motor(4.0, 3.0, -5.0)
    hinges = [
        Hinge("trunk", "front", (0.25, 0.0, 0.3 + height), (0.0, 1.0, 0.0), motor, command=0),
        Hinge("trunk", "back", (-0.25, 0.0, 0.3 + height), (0.0, 1.0, 0.0), motor, command=1),
    ]
    return Tree([trunk, front, back], hinges)


def swinging(steps: int = STEPS) -> np.ndarray:
    times = np.arange(steps // 10)[:, None]
    return np.sin(2 * math.pi * (0.08 * times + [0.0, 0.3]))[None]


def walk(ground, height: float = 0.0, width: int | None = None, precision: str = "f64", **world):
    engine = RigidEngine(
        walker(height),
        Physics(time_step=0.005, **world),
        Senses(touch=("front", "back")),
        ground=ground,
        precision=precision,
        threads=1,
        width=width,
    )
    return engine.run(STEPS, commands=swinging(), hold=10)


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("world", WORLDS)
def test_level_ground_has_the_bits_of_the_floor(world, precision):
    """A grid of zeros, of many cells, too."""
    floor = walk(None, precision=precision, **world)
    assert (floor.readings == 1).any() and np.abs(floor.position[0, :2]).max() > 0.01
    many = Relief(np.zeros((50, 40)), 0.04, (-1.0, -0.9), None if math.isinf(world["friction"]) else np.ones((50, 40)))
    for ground in (level(), many):
        found = walk(ground, precision=precision, **world)
        for part in ("position", "orientation", "angles", "velocities", "readings", "residual"):
            assert np.array_equal(getattr(floor, part), getattr(found, part)), part


@pytest.mark.parametrize("width", [1, 4])
def test_width_makes_no_difference(width):
    """One robot in a real, or several."""
    found = [walk(rough(friction=True), 0.02, width=each, friction=0.7) for each in (width, 8)]
    for part in ("position", "orientation", "angles", "velocities"):
        assert np.array_equal(*(getattr(each, part) for each in found))
    assert np.abs(found[0].position - walk(level(), 0.02, friction=0.7).position).max() > 1e-3


def turned_about(degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and quaternion that turn x uphill."""
    slope = math.radians(degrees)
    matrix = np.array([[math.cos(slope), 0, -math.sin(slope)], [0, 1, 0], [math.sin(slope), 0, math.cos(slope)]])
    return matrix, np.array([[math.cos(slope / 2), 0, -math.sin(slope / 2), 0]])


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("degrees", [5.0, -12.0, 25.0])
def test_a_ramp_is_a_tilted_plane(degrees, world):
    """A body on a ramp, turned with it, does what gravity that is tilted makes it do on the level floor."""
    matrix, quaternion = turned_about(degrees)
    heights = math.tan(math.radians(degrees)) * np.array([[-5.0, -5.0], [5.0, 5.0]])
    found = []
    for ramp in (False, True):
        tree = walker()
        ground = Relief(heights, 10.0, (-5.0, -5.0)) if ramp else None
        turn = matrix if ramp else np.eye(3)
        *across, down = turn @ matrix.T @ [0.0, 0.0, -9.81]
        physics = Physics(0.005, down, gravity_across=across, **world)
        engine = RigidEngine(tree, physics, ground=ground, precision="f64", threads=1)
        start = engine.rest()
        moving = np.array([0.1, 0.2, 0.3, 0.4, 0.1, -0.6])
        velocity = np.concatenate([turn @ moving[:3], turn @ moving[3:]])[None]
        orientation = quaternion if ramp else start.orientation
        start = State(start.position @ turn.T, orientation, start.angles, velocity, start.rates)
        done = engine.run(STEPS, commands=swinging(), hold=10, start=start)
        found.append((done.position @ turn, done.angles, done.steps))
    tolerance = 1e-6  # what slides amplifies rounding, and so does what holds
    for level_one, tilted in zip(*found, strict=True):
        assert np.abs(level_one - tilted).max() < tolerance
    assert np.abs(found[0][0] - [0, 0, 0.3]).max() > 0.03


@pytest.mark.parametrize(
    ("part", "integration"),
    [
        *((part, "momentum") for part in ("commands", "position", "orientation", "angles")),
        *(pytest.param(part, "velocity", marks=pytest.mark.slow) for part in ("commands", "position")),
    ],
)
def test_gradients_agree_with_differences(part, integration):
    """With contact on bumps, motors at their limits."""
    steps = 150
    world = Physics(0.005, integration=integration)
    engine = RigidEngine(walker(0.01), world, ground=rough(), precision="f64", threads=1)
    assert error_of_gradient(engine, part, steps, swinging(steps), (1e-6, 1e-7)) < 1e-6


def test_gradients_by_a_size_agree_with_differences():
    """Of a foot's radius, which decides where it touches the ground."""
    aim, radius, step = np.array([[1.0, -0.5, 2.0]]), 0.06, 1e-6

    def engine(size: float) -> RigidEngine:
        return RigidEngine(walker(0.01, size), Physics(0.005), ground=rough(), precision="f64", threads=1)

    tape = engine(radius).record(150, commands=swinging(150), hold=10)
    (found,) = tape.pull_back(position=aim).by_design(lambda size: walker(0.01, size), radius)
    high, low = (engine(radius + x).run(150, commands=swinging(150), hold=10).position @ aim[0] for x in (step, -step))
    assert found == pytest.approx((high - low)[0] / (2 * step), rel=1e-6)


@pytest.mark.parametrize("integration", ["momentum", "velocity"])
def test_gradients_by_a_size_know_how_high_a_robot_then_stands(integration):
    """All of its bodies start as much higher; by velocity they have places of their own, and drifted from the base."""
    aim, radius, step = np.array([[1.0, -0.5, 2.0]]), 0.06, 1e-6
    ground, physics = rough(height=0.02), Physics(0.005, integration=integration)
    lower, upper = (walker(radius=radius + x) for x in (-step, step))

    def engine(tree: Tree) -> RigidEngine:
        return RigidEngine(tree, physics, ground=ground, precision="f64", threads=1)

    robots = [engine(tree) for tree in (lower, walker(), upper)]
    starts = [each.standing() for each in robots]
    low, _, high = (
        each.run(20, commands=swinging(20), hold=10, start=start).position @ aim[0]
        for each, start in zip(robots, starts, strict=True)
    )
    moved = starts[2].position - starts[0].position
    assert abs(moved[0, 2]) > 0.1 * step  # though the base is where it was in the trees
    tape = robots[1].record(20, commands=swinging(20), hold=10, start=starts[1])
    (found,) = tape.pull_back(position=aim).between_trees([lower], [upper], moved)
    assert found == pytest.approx((high - low)[0], rel=1e-6)


def energy(engine: RigidEngine, done) -> float:
    """Kinetic and potential energy of a robot without hinges [J]."""
    body = engine.tree.bodies[0]
    rotation = rotation_matrix(done.orientation)[0]
    spin, velocity = done.velocities[0, 0, :3], done.velocities[0, 0, 3:]
    turning = spin @ rotation @ np.asarray(body.inertia) @ rotation.T @ spin
    return 0.5 * (body.mass * velocity @ velocity + turning) + 9.81 * body.mass * done.position[0, 2]


@pytest.mark.parametrize("friction", [math.inf, 0.5])
@pytest.mark.parametrize("solid", [Box((0.3, 0.2, 0.1)), Sphere(0.01)], ids=["box", "ball"])
def test_what_falls_onto_bumps_loses_energy(solid, friction):
    """It never has more than it fell with, nor more than before, but for what pushes it out of the ground."""
    tree = Tree([Body("it", (0.0, 0.0, 0.2), 1.0, [solid])], [])
    engine = RigidEngine(tree, Physics(0.002, friction=friction), ground=rough(2), precision="f64", threads=1)
    session = engine.session(start=replace(engine.rest(), velocity=np.array([[0, 0, 0, 0.3, 0.1, 0]])))
    energies = [energy(engine, session.advance(steps=10)) for _ in range(200)]
    assert np.diff(energies).max() < 2e-3 * energies[0] and max(energies) == energies[0] > 3 * energies[-1]


def test_an_edge_throws_no_ball_however_short_the_steps():
    """Where it passes onto a steeper triangle it is suddenly deep in the ground; it gains nothing by that."""
    at = 0.04 * np.clip(np.arange(80) - 38, 0, None)
    ramp = Relief(np.repeat(math.tan(math.radians(30)) * at[:, None], 10, axis=1), 0.04, (-1.0, -0.2))
    tree, ends = Tree([Body("ball", (0.0, 0.0, 0.1), 1.0, [Sphere(0.1)])]), []
    for step in (2e-3, 2.5e-4):
        engine = RigidEngine(tree, Physics(step, friction=0.0), ground=ramp, threads=1)
        start = replace(engine.rest(), velocity=np.array([[0.0, 0.0, 0.0, 2.0, 0.0, 0.0]]))
        place = engine.run(round(0.8 / step), start=start, record_every=1).frames.position[:, 0]
        energies = 0.5 * (np.diff(place, axis=0) ** 2).sum(axis=1) / step**2 + 9.81 * (place[1:, 2] - 0.1)
        assert energies[0] == pytest.approx(2.0) and energies.max() < 2.0001
        ends.append(energies[-1])
    left, lifted = 2.0 * math.cos(math.radians(30)) ** 2, 9.81 * 0.1 * (1 / math.cos(math.radians(30)) - 1)
    assert ends[0] == pytest.approx(ends[1], rel=0.02) and left < ends[0] < left + lifted


@pytest.mark.parametrize("ground", [None, level()])
def test_what_is_deep_in_the_ground_comes_out_as_if_it_had_fallen_through_it(ground):
    """Shallow parts come out by the error reduction; derivatives know of both."""
    for depth, step in ((0.03, 2e-3), (1e-4, 2e-3), (0.03, 0.05)):
        tree = Tree([Body("ball", (0.0, 0.0, 0.1 - depth), 1.0, [Sphere(0.1)])])
        tape = RigidEngine(tree, Physics(step), ground=ground, threads=1).record(1)
        speed, slope = 0.2 * depth / step, 0.2 / step
        if speed > math.sqrt(2 * 9.81 * depth):
            speed, slope = math.sqrt(2 * 9.81 * depth), 9.81 / math.sqrt(2 * 9.81 * depth)
        assert tape.result.position[0, 2] - 0.1 + depth == pytest.approx(step * speed, rel=1e-6)
        found = tape.pull_back(position=np.array([[0.0, 0.0, 1.0]]))
        assert (found.position + found.places.sum(axis=1))[0, 2] == pytest.approx(1 - step * slope, rel=1e-6)


def test_robots_of_a_batch_stand_on_ground_of_their_own():
    """As each does alone."""
    grounds = [rough(1), rough(2, nodes=40), Relief(np.zeros((3, 4)), 0.05, (-0.1, 0.2))]
    alone = np.concatenate([walk(each, 0.02).position for each in grounds])
    assert np.array_equal(walk(grounds, 0.02).position, alone)


def test_robots_stand_on_their_ground():
    """Each as far above it as above the plane z = 0, whose bits it has without."""
    grounds = [Relief(np.full((2, 2), 0.125), 0.05), rough(1), rough(2)]
    engine = RigidEngine(walker(0.01), ground=grounds)
    start, tree = engine.standing(), engine.tree
    centres, radii = tree.balls()
    for place, ground in zip(start.position, grounds, strict=True):
        moved = centres + place - np.array(tree.ordered[0][0].position)
        assert ground.rise_of_balls(moved, radii) == pytest.approx(-0.04)
    assert np.array_equal(RigidEngine(walker()).standing().position, RigidEngine(walker()).rest().position)
    assert RigidEngine([walker(), walker(0.1)], ground=rough()).standing().rates.shape == (2, 2)
    with pytest.raises(ValueError, match=r"^ground: 3 reliefs for 2 trees"):
        RigidEngine([walker()] * 2, ground=grounds).standing()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: walk([]), "ground: an empty list is not allowed; give at least one relief"),
        (lambda: walk([level(), rough()]), "ground: the spacing of nodes"),
        (lambda: walk(rough(friction=True)), "ground: factors of friction are not allowed with infinite friction"),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()
