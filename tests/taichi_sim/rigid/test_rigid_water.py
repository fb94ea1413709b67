"""Rigid robots in water: closed forms of what floats, sinks and rises, energy, and gradients on a shore."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rigid_differences import error_of_gradient
from rigid_walkers import swinging, walker
from scipy.optimize import brentq

from taichi_sim.ground import Relief
from taichi_sim.ground.relief import Water
from taichi_sim.rigid import Body, Box, Capsule, Hinge, Motor, Physics, RigidEngine, Sphere, Tree, Weld
from taichi_sim.rigid.pose import rotation_matrix

pytestmark = pytest.mark.kernels

GRAVITY, DENSITY = 9.81, 1000.0
HERE = {"precision": "f64", "threads": 1}
SOLIDS = {"ball": Sphere(0.1), "box": Box((0.3, 0.2, 0.1)), "capsule": Capsule(0.05, 0.3)}
BOTH = [pytest.param("momentum"), pytest.param("velocity", marks=pytest.mark.slow)]


def sea(level: float = 0.0, bottom: float = -50.0, **water) -> Relief:
    return Relief(np.full((2, 2), bottom), 1.0, (-0.5, -0.5), water=Water(level, **{"gravity": GRAVITY, **water}))


def shore(level: float = 0.05) -> Relief:
    """A beach that goes down along x, where the walker stands with its front in the water."""
    heights = np.array([[0.2, 0.2], [-0.2, -0.2]])
    return Relief(heights, 4.0, (-2.0, -2.0), water=Water(level, gravity=GRAVITY))


def one(solid, density: float, height: float = 0.0) -> Tree:
    return Tree([Body("it", (0.0, 0.0, height), density * solid.volume, [solid])])


def engine_of(tree, ground=None, time_step: float = 2e-3, **world) -> RigidEngine:
    return RigidEngine(tree, Physics(time_step, **world), ground=sea() if ground is None else ground, **HERE)


@pytest.mark.parametrize("integration", BOTH)
def test_a_ball_floats_at_the_depth_of_archimedes_and_bobs_about_it(integration):
    """Its period is that of the water line's stiffness and its mass with half of what it displaces."""
    radius, share = 0.1, 0.6
    ball = Sphere(radius)
    s = brentq(lambda s: s * s * (3 - 2 * s) - share, 0, 1)
    depth = radius * (2 * s - 1)
    engine = engine_of(one(ball, share * DENSITY, -depth), time_step=1e-3, integration=integration)
    still = engine.run(1000)
    assert still.position[0, 2] == pytest.approx(-depth, abs=1e-12)
    raised = replace(engine.rest(), position=np.array([[0.0, 0.0, 1e-4 - depth]]))
    bobbing = engine.run(3000, record_every=1, start=raised)
    heights = bobbing.frames.position[:, 0, 2] + depth
    (falling,) = np.nonzero((heights[:-1] > 0) & (heights[1:] <= 0))
    stiffness = DENSITY * GRAVITY * math.pi * (radius**2 - depth**2)
    mass = share * ball.volume * DENSITY * 1.5
    period = np.diff(bobbing.frames.times[falling]).mean()
    assert period == pytest.approx(2 * math.pi * math.sqrt(mass / stiffness), rel=5e-3)


@pytest.mark.parametrize("integration", BOTH)
@pytest.mark.parametrize(
    ("solid", "pressure", "friction"),
    [
        (Sphere(0.1), math.pi * 0.1**2 / 2, 8 / 3 * math.pi * 0.1**2),
        (Box((0.2, 0.1, 0.05)), 0.02, 2 * (0.2 + 0.1) * 0.05),
        (Capsule(0.05, 0.3, (1.0, 0.0, 0.0)), 0.02 + math.pi * 0.05**2 / 2, math.pi * 0.05 * (0.3 + 8 / 3 * 0.05)),
        (Capsule(0.05, 0.3), math.pi * 0.05**2 / 2, math.pi * 0.05 * (2 * 0.3 + 8 / 3 * 0.05)),
    ],
    ids=["ball", "box", "across", "along"],
)
def test_what_sinks_reaches_the_speed_at_which_drag_bears_its_weight(solid, pressure, friction, integration):
    engine = engine_of(one(solid, 3 * DENSITY, -1.0), sea(bottom=-1e3), integration=integration)
    velocity = engine.run(4000).velocities[0, 0]
    drag = 0.5 * DENSITY * (1.2 * pressure + 0.02 * friction)
    weight = 2 * DENSITY * solid.volume * GRAVITY
    assert velocity == pytest.approx([0, 0, 0, 0, 0, -math.sqrt(weight / drag)], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS)
def test_a_light_body_rises_as_its_added_mass_lets_it(solid):
    """With (rho_w - rho) g / (rho + rho_w / 2) at first, and displaced volumes add up to its own."""
    density, step = 200.0, 1e-4
    velocity = engine_of(one(solid, density, -1.0), time_step=step).run(1).velocities[0, 0, 3:]
    assert velocity / step == pytest.approx([0, 0, (DENSITY - density) * GRAVITY / (density + DENSITY / 2)], rel=1e-9)


def test_a_pendulum_below_water_swings_more_slowly():
    """By what its bob weighs there, and by its added mass; its base is fixed to the world."""
    length, ball = 0.4, Sphere(0.05)
    bodies = [Body("base", (0.0, 0.0, 0.0), 1.0, [ball]), Body("bob", (0.0, 0.0, -length), 1.0, [ball])]
    tree = Tree(bodies, [Hinge("base", "bob", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))], fixed=True)
    engine = engine_of(tree, sea(0.5), 1e-3, pressure_drag=0.0, friction_drag=0.0)
    swung = engine.run(6000, start=replace(engine.rest(), angles=np.array([[1e-3]])), record_every=1)
    angles = swung.frames.angles[:, 0, 0]
    (back,) = np.nonzero((angles[:-1] > 0) & (angles[1:] <= 0))
    displaced = DENSITY * ball.volume
    inertia = length**2 * (1 + displaced / 2) + np.asarray(bodies[1].inertia)[0, 0]
    period = 2 * math.pi * math.sqrt(inertia / ((1 - displaced) * GRAVITY * length))
    assert np.diff(swung.frames.times[back]).mean() == pytest.approx(period, rel=1e-3)


@pytest.mark.parametrize("degrees", [2.0, 10.0])
@pytest.mark.parametrize(("size", "share"), [((0.3, 0.3, 0.1), 0.3), ((0.3, 0.3, 0.1), 0.5), ((0.6, 0.2, 0.1), 0.7)])
def test_a_box_rights_itself_by_its_metacentric_height(size, share, degrees):
    """The moment of a wall-sided body, W sin(t) (GM + BM tan(t)^2 / 2); of blocks, which are few, to an eighth."""
    solid, angle, step = Box(size), math.radians(degrees), 1e-6
    draught = share * size[2]
    tree = one(solid, share * DENSITY, size[2] / 2 - draught)
    engine = engine_of(tree, sea(added_mass=0.0), step)
    turned = np.array([[math.cos(angle / 2), math.sin(angle / 2), 0.0, 0.0]])
    spin = engine.run(1, start=replace(engine.rest(), orientation=turned)).velocities[0, 0, 0]
    body = tree.bodies[0]
    metacentre = size[1] ** 2 / (12 * draught)
    lever = draught / 2 + metacentre - size[2] / 2 + metacentre * math.tan(angle) ** 2 / 2
    expected = -body.mass * GRAVITY * lever * math.sin(angle)
    assert body.inertia[0, 0] * spin / step == pytest.approx(expected, rel=0.125)


def energy(engine: RigidEngine, done, gravity: float = GRAVITY) -> float:
    """Of a single body: kinetic with added mass, and potential in the air and the water [J]."""
    tree, rotation = engine.tree, rotation_matrix(done.orientation)[0]
    body, place = tree.bodies[0], done.position[0]
    spin, velocity = done.velocities[0, 0, :3], done.velocities[0, 0, 3:]
    turning = spin @ rotation @ np.asarray(body.inertia) @ rotation.T @ spin
    found = 0.5 * (body.mass * velocity @ velocity + turning) + gravity * body.mass * place[2]
    for _, part in tree.portions():
        arm = rotation @ part.centre
        reach = math.sqrt((rotation @ part.spread @ rotation.T)[2, 2])
        s = np.clip((1 - (place[2] + arm[2]) / reach) / 2, 0, 1)
        above = max(-(place[2] + arm[2]) - reach, 0.0)
        share, depths = (s * s * (3 - 2 * s), s**3 * (2 - s)) if part.is_ball else (s, s * s)
        moving = velocity + np.cross(spin, arm)
        found += 0.25 * DENSITY * part.volume * share * moving @ moving
        found += DENSITY * gravity * part.volume * (reach * depths + above)
    return found


@pytest.mark.parametrize("integration", BOTH)
@pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS)
@pytest.mark.parametrize("drag", [0.0, 1.2])
def test_water_at_rest_never_gives_energy(solid, drag, integration):
    """To what is thrown in, turning, comes up again, bobs and rolls."""
    engine = engine_of(one(solid, 500.0, 0.5), time_step=5e-4, pressure_drag=drag, friction_drag=0.0)
    session = engine.session(start=replace(engine.rest(), velocity=np.array([[2.0, 3.0, 1.0, 0.6, 0.2, -1.0]])))
    energies = np.array([energy(engine, session.advance(steps=10)) for _ in range(800)])
    excess = (energies - np.minimum.accumulate(energies)).max()
    assert excess < 2e-3 * (energies[0] - energies[-1] if drag else energies[0])
    assert energies[-1] < 0.9 * energies[0]


KEEL = Body("it", (0.0, 0.0, -0.2), 3.0, [], np.diag([0.02, 0.02, 0.01]), [Sphere(0.1, (0.0, 0.0, 0.2))])
UNLIKE = Body("it", (0.0, 0.0, -5.0), 4.0, [], np.diag([0.01, 0.012, 0.014]), [Box((0.4, 0.1, 0.1))])


@pytest.mark.parametrize("integration", BOTH)
@pytest.mark.parametrize(
    ("body", "motion"),
    [
        (KEEL, (3.0, 0.0, 6.0, 0.5, 0.0, 0.0)),  # the middle of its mass is below that of its water
        (UNLIKE, (3.0, 6.0, 1.0, 0.0, 0.0, 0.0)),  # its mass and its water turn most easily about other axes
        (one(SOLIDS["box"], 500.0).bodies[0], (0.0, 15.0, 0.0, 0.0, 0.0, 0.0)),  # its wet half changes as it turns
    ],
    ids=["keel", "unlike", "half out"],
)
def test_water_at_rest_never_gives_energy_to_what_turns(body, motion, integration):
    """Momentum of water that turned with a body without a push would give a quarter of it in a second."""
    engine = engine_of(Tree([body]), time_step=1e-3, integration=integration, pressure_drag=0.0, friction_drag=0.0)
    session = engine.session(start=replace(engine.rest(), velocity=np.array([motion])))
    energies = np.array([energy(engine, session.advance(steps=10)) for _ in range(300)])
    assert (energies - np.minimum.accumulate(energies)).max() < 2e-3 * np.ptp(energies)


@pytest.mark.parametrize("integration", BOTH)
@pytest.mark.parametrize("step", [1e-3, 2e-3])
def test_a_fast_spin_about_no_axis_of_symmetry_gains_no_more_in_water_than_in_air(step, integration):
    """What is guessed of the spin before a step must not feed itself: at half the order this rod tripled its energy."""
    solid = Capsule(0.06, 0.3, (0.0, 0.0, 1.0), (0.0, 0.0, 0.15))
    body = Body("it", (0.0, 0.0, 0.0), 6.0, [], np.diag([0.03, 0.03, 0.012]), [solid])
    world = {"gravity": 0.0, "pressure_drag": 0.0, "friction_drag": 0.0, "integration": integration}
    engine = engine_of(Tree([body]), sea(50.0), step, **world)
    start = replace(engine.rest(), velocity=np.array([[3.0, 0.0, 30.0, 0.5, 0.0, 0.0]]))
    session = engine.session(start=start)
    kinetic = np.array([energy(engine, session.advance(steps=round(0.05 / step)), 0.0) for _ in range(160)])
    assert kinetic.max() < 1.15 * kinetic[0]


@pytest.mark.parametrize("integration", BOTH)
def test_one_body_moves_as_two_that_are_welded_together(integration):
    """Without drag their common middle, with the water's mass, goes straight on while they turn about it."""
    (heavy, keel), (light, float_) = (6.0, Sphere(0.03)), (0.5, Sphere(0.1))
    apart, spin, speed, seconds = 0.3, 4.0, 0.5, 1.5
    masses = np.array([heavy + 0.5 * DENSITY * keel.volume, light + 0.5 * DENSITY * float_.volume])
    middle, own = apart * masses[1] / masses.sum(), apart * light / (heavy + light)
    ends = Sphere(0.03, (-own, 0.0, 0.0)), Sphere(0.1, (apart - own, 0.0, 0.0))
    inertia = sum(m * (0.4 * s.radius**2 * np.eye(3) + np.diag([0, 1, 1]) * s.centre[0] ** 2)
                  for m, s in zip((heavy, light), ends, strict=True))  # fmt: skip
    alone = Tree([Body("it", (own, 0.0, 0.0), heavy + light, [], inertia, ends)])
    welded = Tree(
        [Body("keel", (0.0, 0.0, 0.0), heavy, [keel]), Body("float", (apart, 0.0, 0.0), light, [float_])],
        [Weld("keel", "float")],
    )
    angle = spin * seconds
    there = [middle * (1 - math.cos(angle)), (speed + spin * middle) * seconds - middle * math.sin(angle)]
    for tree, lever in ((alone, own), (welded, 0.0)):
        world = {"gravity": 0.0, "pressure_drag": 0.0, "friction_drag": 0.0, "integration": integration}
        engine = engine_of(tree, sea(20.0), 5e-4, **world)
        start = replace(engine.rest(), velocity=np.array([[0, 0, spin, 0, speed + spin * lever, 0.0]]))
        done = engine.run(int(seconds / 5e-4), start=start)
        at = done.position[0] - rotation_matrix(done.orientation)[0] @ [lever, 0.0, 0.0]
        assert at[:2] == pytest.approx(there, abs=0.01)


@pytest.mark.parametrize("centre", [0.135, 0.03], ids=["middle of the solid", "elsewhere"])
def test_a_limb_that_swings_in_still_water_without_drag_takes_its_robot_nowhere(centre):
    """Wherever the limb's mass is: as in a vacuum, the robot is back after each whole swing."""
    base = Body("base", (0.0, 0.0, 0.0), 1.7, [Sphere(0.08)])
    solid = Capsule(0.04, 0.23, (1.0, 0.0, 0.0), (0.135 - centre, 0.0, 0.0))
    limb = Body("limb", (0.1 + centre, 0.0, 0.0), 0.8, [], np.diag([0.002, 0.004, 0.004]), [solid])
    hinge = Hinge("base", "limb", (0.1, 0.0, 0.0), (0.0, 0.0, 1.0), Motor.velocity(10.0, 1e3), 0)
    engine = engine_of(Tree([base, limb], [hinge]), sea(50.0), gravity=0.0, pressure_drag=0.0, friction_drag=0.0)
    swing = 0.6 * np.cos(2 * math.pi * (np.arange(500) + 0.5) / 500)
    done = engine.run(1000, commands=np.tile(swing, 2)[None, :, None])
    assert np.abs(done.position[0]).max() < 5e-3
    assert np.abs(done.orientation[0, 1:]).max() < 1e-3


@pytest.mark.parametrize("ground", [shore(), sea(0.25, -1.0)], ids=["shore", "sea"])
@pytest.mark.parametrize(
    ("part", "integration"),
    [
        *((part, "momentum") for part in ("commands", "position", "orientation", "angles")),
        *(pytest.param(part, "velocity", marks=pytest.mark.slow) for part in ("commands", "position")),
    ],
)
def test_gradients_agree_with_differences(part, ground, integration):
    """With contact, motors at their limits, slamming, and parts that come out of the water."""
    steps = 200
    engine = engine_of(walker(), ground, 5e-3, integration=integration)
    assert error_of_gradient(engine, part, steps, swinging(steps), (1e-6, 1e-7, 1e-8)) < 1e-6


@pytest.mark.parametrize(
    ("tree_of", "value"),
    [
        (walker, 0.06),
        (lambda size: one(Box((size, 0.2, 0.1)), 500.0, 0.03), 0.3),
        (lambda size: one(Box((0.5, size, 0.1)), 500.0, 0.03), 0.2),
        (lambda size: one(Capsule(0.05, size), 500.0, 0.03), 0.25),
        (lambda mass: Tree([Body("it", (0.0, 0.0, 0.03), mass, [Capsule(0.06, 0.3, (1.0, 0.0, 0.2))])]), 2.0),
    ],
    ids=["radius", "size", "flat size", "length", "mass"],
)
def test_gradients_by_a_design_agree_with_differences(tree_of, value):
    """Through displaced volumes, drag areas and masses."""
    aim, step, steps = np.array([[1.0, -0.5, 2.0]]), 1e-6, 150
    commands = swinging(steps)[..., : tree_of(value).motors]

    def engine(size: float) -> RigidEngine:
        return engine_of(tree_of(size), sea(0.05, -1.0), 5e-3)

    tape = engine(value).record(steps, commands=commands, hold=10)
    (found,) = tape.pull_back(position=aim).by_design(tree_of, value)
    high, low = (engine(value + x).run(steps, commands=commands, hold=10).position @ aim[0] for x in (step, -step))
    assert found == pytest.approx((high - low)[0] / (2 * step), rel=1e-6)


def test_water_that_nobody_reaches_changes_no_bit():
    """Beside the same ground without any."""
    dry = shore()
    found = [
        engine_of(walker(), each, 5e-3).run(200, commands=swinging(200), hold=10)
        for each in (replace(dry, water=Water(-9.0)), replace(dry, water=None))
    ]
    for part in ("position", "orientation", "angles", "velocities", "residual"):
        assert np.array_equal(*(getattr(each, part) for each in found)), part


def test_robots_of_a_batch_are_in_water_of_their_own():
    """As each is alone, whatever the width."""

    def run(ground, width=None):
        engine = RigidEngine(walker(), Physics(5e-3), ground=ground, width=width, **HERE)
        return engine.run(100, commands=swinging(100), hold=10).position

    waters = [shore(0.05), sea(0.2, -1.0, density=1200.0), sea(0.25, -1.0, added_mass=1.0)]
    grounds = [replace(each, spacing=4.0) for each in waters]
    alone = np.concatenate([run(each) for each in grounds])
    assert np.array_equal(run(grounds), alone) and len(np.unique(alone[:, 2])) == 3
    assert np.array_equal(run(grounds, width=2), alone)


def test_robots_of_a_batch_may_differ_in_all_their_sizes():
    """A plate and a cube have as many portions: the structure is the same."""
    plates = [one(Box(size), 500.0, 0.03) for size in ((0.5, 0.05, 0.02), (0.2, 0.2, 0.2))]
    alone = [engine_of(plate, sea(0.05, -1.0)).run(50).position[0] for plate in plates]
    assert np.array_equal(engine_of(plates, sea(0.05, -1.0)).run(50).position, alone)


def test_water_is_as_heavy_as_the_world_makes_it():
    """So what floats does so at the same depth anywhere."""
    ball, share = Sphere(0.1), 0.5
    for gravity in (-9.81, -1.62):
        found = engine_of(one(ball, share * DENSITY), gravity=gravity).run(200)
        assert found.position[0, 2] == pytest.approx(0.0, abs=1e-12)


def test_solids_that_touch_nothing_are_found_by_water():
    """As if they touched."""
    ball = Sphere(0.1)
    inertia = ball.inertia(2.0)
    trees = [Tree([Body("it", (0.0, 0.0, 0.0), 2.0, *solids)]) for solids in (([ball], inertia), ([], inertia, [ball]))]
    touching, not_touching = (engine_of(tree).run(100).position for tree in trees)
    assert np.array_equal(touching, not_touching) and touching[0, 2] > 1e-3


@pytest.mark.slow
def test_single_precision_agrees():
    found = []
    for precision in ("f64", "f32"):
        engine = RigidEngine(walker(), Physics(5e-3), ground=sea(0.25, -1.0), precision=precision, threads=1)
        found.append(engine.run(100, commands=swinging(100), hold=10).position)
    assert np.abs(found[0] - found[1]).max() < 1e-4


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: engine_of(walker(), gravity_across=(1.0, 0.0)),
            "gravity_across: not allowed with water",
        ),
        (lambda: engine_of(walker(), [sea(), replace(sea(), water=None)]), "ground: water for some robots of a batch"),
        (lambda: Physics(pressure_drag=-1.0), "pressure_drag: -1.0 is not allowed"),
        (
            lambda: engine_of(Tree([Body("it", (0.0, 0.0, 0.0), 1.0, (), np.eye(3))])),
            "ground: water would move nothing, as no body has solids; give solids with a mass",
        ),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()
