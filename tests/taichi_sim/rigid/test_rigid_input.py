"""Descriptions of rigid robots: bad input is told in one line, and trees mean the same however they are listed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.quadruped import LEGGED, Quadruped, simulate
from taichi_sim.rigid import (
    Body,
    Box,
    Capsule,
    Hinge,
    Motor,
    Network,
    Physics,
    RigidEngine,
    Senses,
    Sphere,
    State,
    Tree,
    Weld,
    poses,
)

BALL = Body("ball", (0, 0, 1), 1.0, [Sphere(0.1)])
BOX = Body("box", (0, 0, 2), 1.0, [Box((0.1, 0.1, 0.1))])
JOINT = Hinge("ball", "box", (0, 0, 1.5), (1, 0, 0), Motor.velocity(1, 1))
PAIR = Tree([BALL, BOX], [JOINT])
WEIGHTS = np.zeros((2, 5, 8))


def engine(**settings):
    return RigidEngine(PAIR, senses=Senses(["ball"], [("box", (0, 0, 0))]), precision="f32", threads=1, **settings)


def state(**changes):
    at = {
        "position": [[0, 0, 1]],
        "orientation": [[1, 0, 0, 0]],
        "angles": [[0]],
        "velocity": [[0] * 6],
        "rates": [[0]],
    }
    return State(**{name: np.array(value, float) for name, value in {**at, **changes}.items()})


BAD = {
    "a body without mass": (lambda: Body("b", (0, 0, 0), 0.0, [Sphere(1)]), "mass of b: 0.0 is not allowed"),
    "a body without mass that is free": (
        lambda: Tree([Body("b", (0, 0, 0), 0.0, [Sphere(1)], np.eye(3))]),
        "mass of b: 0.0 is not allowed; give a positive finite number",
    ),
    "a body without mass on a fixed base": (
        lambda: Tree(
            [Body(name, (0, 0, 0), 0.0, (), np.eye(3)) for name in "ab"], [Hinge("a", "b", (0, 0, 0), (0, 0, 1))], True
        ),
        "mass of b: 0.0 is not allowed",
    ),
    "a negative mass": (lambda: Body("b", (0, 0, 0), -1.0, [Sphere(1)]), "mass of b: -1.0 is not allowed"),
    "a mass that is no number": (lambda: Body("b", (0, 0, 0), np.nan, [Sphere(1)]), "mass of b: nan is not allowed"),
    "a place that is none": (lambda: Body("b", (0, 0), 1.0, [Sphere(1)]), "position of b: (0, 0) is not allowed"),
    "no way to know the inertia": (lambda: Body("b", (0, 0, 0), 1.0), "inertia of b: None is not allowed"),
    "an inertia of a line": (lambda: Body("b", (0, 0, 0), 1.0, [], np.diag([0, 1, 1])), "inertia of b: not allowed"),
    "a sphere without size": (lambda: Sphere(0.0), "radius: 0.0 is not allowed"),
    "a negative capsule": (lambda: Capsule(0.1, -1.0), "length: -1.0 is not allowed"),
    "a capsule without direction": (lambda: Capsule(0.1, 1.0, (0, 0, 0)), "axis: (0, 0, 0) is not allowed"),
    "a flat box": (lambda: Box((1, 1, 0)), "size: 0.0 is not allowed"),
    "a negative robot": (lambda: Quadruped("legged", limb_length=-0.3), "limb_length: -0.3"),
    "a robot without mass": (lambda: Quadruped("legged", mass=0), "mass: 0"),
    "an unknown robot": (lambda: Quadruped("winged"), "kind: 'winged' is unknown; choose legged, wheeled, whegged"),
    "a negative torque": (lambda: Motor(-1.0, 1.0), "torque: -1.0 is not allowed"),
    "a motor that may not move": (lambda: Motor(1.0, 1.0, fastest=0.0), "fastest: 0.0 is not allowed"),
    "an endless rate": (lambda: Motor(1.0, np.inf), "by_command: inf is not allowed"),
    "an axis that is none": (lambda: Hinge("a", "b", (0, 0, 0), (0, 0, 0)), "axis of b: (0, 0, 0) is not allowed"),
    "stops that exclude the start": (
        lambda: Hinge("a", "b", (0, 0, 0), (1, 0, 0), stops=(0.1, 0.5)),
        "stops of b: (0.1, 0.5) is not allowed; give two angles around the start",
    ),
    "stops the wrong way round": (lambda: Hinge("a", "b", (0, 0, 0), (1, 0, 0), stops=(0.5, -0.5)), "stops of b"),
    "stops that are three": (lambda: Hinge("a", "b", (0, 0, 0), (1, 0, 0), stops=(-1, 0, 1)), "stops of b"),
    "a single stop": (lambda: Hinge("a", "b", (0, 0, 0), (1, 0, 0), stops=1.0), "stops of b: 1.0 is not allowed"),
    "a motor that flees": (lambda: Motor.position(-1, 1, -5.0, 1), "speed: -5.0 is not allowed"),
    "an angle that is none": (lambda: Motor.position(-1, None, 5.0, 1), "highest: None is not allowed"),
    "a solid without a list": (lambda: Body("b", (0, 0, 0), 1.0, Sphere(1)), "shapes of b: Sphere("),
    "no bodies": (lambda: Tree([]), "bodies: [] is not allowed"),
    "a name twice": (lambda: Tree([BALL, BALL]), "bodies: ['ball', 'ball'] is not allowed"),
    "a loop": (
        lambda: Tree([BALL, BOX, Body("c", (0, 0, 3), 1.0, [Sphere(1)])], [Weld("box", "c"), Weld("c", "box")]),
        "joints: 'box' does not hang on the base 'ball'; give a tree without loops",
    ),
    "a body carried twice": (lambda: Tree([BALL, BOX], [JOINT, Weld("ball", "box")]), "joints: 'box' is carried twice"),
    "a base that is carried": (lambda: Tree([BALL, BOX], [Weld("box", "ball")]), "joints: 'ball' is carried twice or"),
    "a body that hangs nowhere": (lambda: Tree([BALL, BOX]), "joints: 'box' does not hang on the base 'ball'"),
    "a joint of a stranger": (lambda: Tree([BALL], [JOINT]), "joints: there is no body 'box'; there are ball"),
    "a step back in time": (lambda: Physics(-0.1), "time_step: -0.1 is not allowed"),
    "friction less than none": (lambda: Physics(friction=-1.0), "friction: -1.0 is not allowed"),
    "an unknown integration": (lambda: Physics(integration="exact"), "integration: 'exact' is unknown"),
    "no trees": (lambda: RigidEngine([]), "trees: an empty list is not allowed"),
    "trees of two structures": (lambda: RigidEngine([PAIR, Tree([BALL])]), "trees: number 1 has another structure"),
    "touch of a stranger": (lambda: RigidEngine(PAIR, senses=Senses(["leg"])), "bodies: there is no body 'leg'"),
    "touch without a shape": (
        lambda: RigidEngine(Tree([Body("b", (0, 0, 1), 1.0, [], np.eye(3))]), senses=Senses(["b"])),
        "touch: 'b' has no shape that could touch",
    ),
    "steps that are no number": (lambda: engine().run(1.5), "steps: 1.5 is not allowed"),
    "steps that are a truth": (lambda: engine().run(True), "steps: True is not allowed"),
    "a width with gaps": (lambda: engine(width=3).run(1), "width: 3 is not allowed; give one of 1, 2, 4, 8, 16, 32"),
    "no width": (lambda: engine(width=0).run(1), "width: 0 is not allowed"),
    "no commands over time": (lambda: engine().run(1, commands=np.zeros((1, 0, 1))), "commands: none over time"),
    "commands held for no time": (lambda: engine().run(1, hold=0), "hold: 0 is not allowed"),
    "commands beside weights": (
        lambda: engine().run(1, commands=np.zeros((1, 1, 1)), weights=np.zeros((1, 2, 1))),
        "commands: not allowed beside weights",
    ),
    "commands of two motors": (
        lambda: engine().run(1, commands=np.zeros((1, 1, 2))),
        "commands: shape (1, 1, 2) is not allowed; give (B, K, 1)",
    ),
    "batches that differ": (
        lambda: engine().run(1, commands=np.zeros((3, 1, 1)), lights=np.ones((2, 3))),
        "lights: 2 rows are not allowed; give one, or 3",
    ),
    "weights of another shape": (
        lambda: engine().run(1, weights=np.zeros((4, 1, 1))),
        "weights: shape (4, 1, 1) is not allowed; give (B, 2, 1)",
    ),
    "weights that are no numbers": (
        lambda: engine().run(1, weights=np.full((1, 2, 1), np.nan)),
        "weights: nan is not allowed; give finite numbers",
    ),
    "weights of another robot": (lambda: simulate(LEGGED, np.zeros((2, 8, 5))), "weights: shape (2, 8, 5) is not"),
    "a light on the robot": (
        lambda: engine().run(1, lights=[(0, 0, 1)]),
        "lights: a light on the robot is not allowed",
    ),
    "places of lights in space": (
        lambda: simulate(LEGGED, WEIGHTS, [(9, 0, 0)]),
        "lights: shape (1, 3) is not allowed",
    ),
    "no look at the sensors": (lambda: simulate(LEGGED, WEIGHTS, steps=0), "steps: 0"),
    "robots of two kinds": (
        lambda: simulate([LEGGED, Quadruped("wheeled")], WEIGHTS),
        "robots: several kinds are not allowed at once",
    ),
    "fewer robots than controllers": (lambda: simulate([LEGGED] * 3, WEIGHTS), "robots: 3 are not allowed"),
    "a start that is not turned": (
        lambda: engine().run(1, start=state(orientation=[[0, 0, 0, 0]])),
        "orientation: not allowed; give unit quaternions",
    ),
    "a start without an angle": (
        lambda: engine().run(1, start=state(angles=[[0, 0]])),
        "angles: shape (1, 2) is not allowed; give (B, 1)",
    ),
    "a start without any angle": (
        lambda: engine().run(1, start=state(angles=np.zeros((1, 0)))),
        "angles: shape (1, 0) is not allowed; give (B, 1)",
    ),
}


@pytest.mark.kernels
@pytest.mark.parametrize("bad", BAD)
def test_bad_input_is_one_line(bad):
    attempt, message = BAD[bad]
    with pytest.raises(ValueError) as error:
        attempt()
    assert str(error.value).startswith(message) and "\n" not in str(error.value)


# trees


def grown(seed, bodies):
    """A tree of bodies of all shapes at random places, and its joints; the base comes first."""
    rng = np.random.default_rng(seed)
    parts, joints = [], []
    for n in range(bodies):
        place = rng.uniform((-0.5, -0.5, 0.7), (0.5, 0.5, 1.7))
        shape = [
            Sphere(rng.uniform(0.05, 0.2)),
            Capsule(0.05, rng.uniform(0.1, 0.4), rng.normal(size=3)),
            Box(rng.uniform(0.1, 0.3, 3)),
        ][rng.integers(3)]
        parts.append(Body(f"body {n}", place, rng.uniform(0.5, 2), [shape]))
        if n:
            parent = parts[rng.integers(n)]
            motor = [None, Motor.velocity(2.0, 3.0), Motor.position(-1, 1, 5.0, 3.0)][rng.integers(3)]
            stops = [None, (-0.5, 0.3)][rng.integers(2)]
            hinge = Hinge(
                parent.name, f"body {n}", (place + parent.position) / 2, rng.normal(size=3), motor, n % 3, stops
            )
            joints.append(hinge if rng.uniform() < 0.8 else Weld(parent.name, f"body {n}"))
    return parts, joints


trees = st.tuples(st.integers(0, 10**6), st.integers(1, 7))


@given(trees, st.randoms(use_true_random=False))
def test_a_tree_puts_parents_first_however_it_is_listed(tree, random):
    (base, *others), joints = grown(*tree)
    random.shuffle(others)
    random.shuffle(joints)
    found = Tree([base, *others], joints)
    assert sorted(found.order) == list(range(len(others) + 1)) and found.order[0] == 0
    assert found.parents[0] == -1 and all(parent < n for n, parent in enumerate(found.parents))
    for n, (body, joint) in list(enumerate(found.ordered))[1:]:
        assert joint.child == body.name and found.ordered[found.parents[n]][0].name == joint.parent
        assert found.place_of(body.name) == n


@given(trees)
def test_at_rest_bodies_are_where_they_were_described(tree):
    found = Tree(*grown(*tree))
    base = found.ordered[0][0].position
    places, turns = poses(found, base, np.array([1.0, 0, 0, 0]), np.zeros(len(found.hinges)))
    assert np.allclose(places, [body.position for body, _ in found.ordered], rtol=0, atol=1e-14)
    assert np.allclose(turns, [1, 0, 0, 0])


@pytest.mark.kernels
@settings(max_examples=12)
@given(trees, st.randoms(use_true_random=False), st.sampled_from(["momentum", "velocity"]))
def test_the_order_of_bodies_changes_no_result(tree, random, integration):
    """But for rounding: they fall, land and are driven, in the order given and in another."""
    (base, *others), joints = grown(*tree)
    shuffled, joints_again = list(others), list(joints)
    random.shuffle(shuffled)
    random.shuffle(joints_again)
    commands = np.random.default_rng(tree[0]).uniform(-1, 1, (1, 1, 3))
    found = []
    for bodies, hung in ((others, joints), (shuffled, joints_again)):
        one = Tree([base, *bodies], hung)
        engine = RigidEngine(one, Physics(0.01, integration=integration), precision="f64", threads=1)
        result = engine.run(60, commands=commands[..., : one.motors])
        angles = dict(zip([hinge.child for hinge in one.hinges], result.angles[0], strict=True))
        found.append([*result.position[0], *result.orientation[0], *(angles[name] for name in sorted(angles))])
    assert np.allclose(*found, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Network(memory=np.nan), "memory: nan is not allowed; give a finite number"),
        (lambda: Network(touch_values=(0.0, np.inf)), "touch_values: .* is not allowed; give two finite numbers"),
        (lambda: Physics(friction="x"), "friction: 'x' is not allowed; give a number of at least 0, or infinity"),
        (lambda: Physics(error_reduction="x"), "error_reduction: 'x' is not allowed; give a number from 0 to 1"),
        (lambda: Motor.velocity("x", 1.0), "by_command: 'x' is not allowed; give a finite number"),
    ],
)
def test_settings_that_are_no_numbers_are_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        make()
