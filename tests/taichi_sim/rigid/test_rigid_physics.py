"""The rigid engine against closed forms: free flight, pendulums, rolling, sliding, friction, motors, stops, welds."""

import numpy as np
import pytest
from scipy.special import ellipk

from robots.quadruped import WHEELED, engine
from taichi_sim.rigid import (
    Body,
    Box,
    Capsule,
    Hinge,
    Motor,
    Physics,
    RigidEngine,
    Sphere,
    State,
    Tree,
    Weld,
    poses,
)
from taichi_sim.rigid.pose import momenta, velocities

pytestmark = pytest.mark.kernels

UPRIGHT = np.array([[1.0, 0, 0, 0]])
BOTH = pytest.mark.parametrize("integration", ["momentum", "velocity"])


def simulate(tree, world, steps, start=None, **more):
    return RigidEngine(tree, world, precision="f64", threads=1).run(steps, start=start, record_every=1, **more)


def moving(tree, velocity, rates=0.0, angles=0.0, position=None):
    """A state of the tree at rest, but for what is given; velocities angular first."""
    hinges = np.zeros((1, len(tree.hinges)))
    at = tree.ordered[0][0].position if position is None else position
    return State(np.array([at], float), UPRIGHT, hinges + angles, np.array([velocity], float), hinges + rates)


# free flight


def acrobat():
    """A body with an arm and a leg of two limbs, all driven."""
    trunk = Body("trunk", (0, 0, 5), 3.0, [Box((0.3, 0.4, 0.6))])
    arm = Body("arm", (0.4, 0, 5.2), 0.7, [Capsule(0.05, 0.4, (1, 0, 0))])
    thigh = Body("thigh", (0, 0.1, 4.5), 1.2, [Capsule(0.07, 0.4)])
    shin = Body("shin", (0, 0.1, 4.1), 0.6, [Capsule(0.04, 0.4)])
    drive = Motor.velocity(4.0, 20.0)
    return Tree(
        [trunk, arm, thigh, shin],
        [
            Hinge("trunk", "arm", (0.15, 0, 5.2), (0, 1, 0), drive, 0),
            Hinge("trunk", "thigh", (0, 0.1, 4.7), (1, 0, 0.3), Motor.position(-1, 1, 5.0, 30.0), 1),
            Hinge("thigh", "shin", (0, 0.1, 4.3), (1, 0, 0), drive, 2),
        ],
    )


def momentum_of_last_step(tree, result):
    """Momentum, and moment of momentum about the origin of the world, as the last step's solution left them.

    ``RigidResult.velocities`` are those that the last move was made with: of the poses before it.
    """
    last = result.frames
    places, turns = poses(tree, last.position[-2], last.orientation[-2], last.angles[-2])
    each = momenta(tree, places, turns, result.velocities)[0]
    moment, momentum = each[:, :3].sum(0), each[:, 3:].sum(0)
    return momentum, moment + np.cross(places[0, 0], momentum)


THROWN = (0.4, -0.9, 0.7, 1.0, -2.0, 3.0), (1.0, -2.0, 0.5)  # velocity of the acrobat, and rates of its hinges
COMMANDS = np.random.default_rng(0).uniform(-1, 1, (1, 50, 3))


def floating(tree):
    """Thrown, but so that the momenta of all bodies sum to zero: then their moment is the same about any point."""
    state = moving(tree, *THROWN)
    places, turns = poses(tree, state.position, state.orientation, state.angles)
    each = velocities(tree, places, turns, state.velocity, state.rates)
    masses = np.array([body.mass for body, _ in tree.ordered])
    state.velocity[0, 3:] -= masses @ each[0, :, 3:] / masses.sum()
    return state


def test_free_flight_conserves_momentum_and_its_moment_while_motors_run():
    tree, world = acrobat(), Physics(0.05, 0.0)
    found = {n: simulate(tree, world, n, floating(tree), commands=COMMANDS, hold=20) for n in (1, 2, 300, 1000)}
    assert np.ptp(found[1000].frames.angles[:, 0], axis=0).min() > 0.5  # they do run
    (_, moment), *later = [momentum_of_last_step(tree, result) for result in found.values()]
    for momentum_then, moment_then in later:
        assert np.linalg.norm(momentum_then) < 1e-12
        assert np.linalg.norm(moment_then - moment) < 1e-6 * np.linalg.norm(moment)


@pytest.mark.parametrize("gravity", [0.0, -1.0])
def test_what_is_thrown_keeps_its_momentum_but_for_its_weight(gravity):
    tree, world = acrobat(), Physics(0.05, gravity)
    start = moving(tree, *THROWN, position=(0, 0, 200.0))
    first, *later = (simulate(tree, world, n, start, commands=COMMANDS, hold=20) for n in (1, 100, 300))
    weight = np.array([0, 0, gravity * world.time_step * sum(body.mass for body in tree.bodies)])
    momentum, _ = momentum_of_last_step(tree, first)
    for result in later:
        expected = momentum + (result.steps[0] - 1) * weight
        assert np.linalg.norm(momentum_of_last_step(tree, result)[0] - expected) < 1e-13 * np.linalg.norm(expected)


@pytest.mark.parametrize(("gravity", "speed"), [(0.0, 100.0), (-9.81, 0.0)], ids=["fast", "falling"])
def test_bodies_of_a_robot_move_alike_however_fast_all_of_it_flies(gravity, speed):
    tree, steps = acrobat(), 400
    start, fast = (moving(tree, *THROWN, position=(0, 0, 3000.0)) for _ in range(2))
    fast.velocity[0, 3] += speed
    floats = simulate(tree, Physics(0.05, 0.0), steps, start, commands=COMMANDS, hold=20)
    flies = simulate(tree, Physics(0.05, gravity), steps, fast, commands=COMMANDS, hold=20)
    assert np.abs(floats.frames.angles - flies.frames.angles).max() < 1e-9
    assert np.abs(floats.frames.orientation - flies.frames.orientation).max() < 1e-9


def test_integration_by_velocity_does_not_conserve_the_moment_of_momentum():
    """Which is why there are two: the other one steps as the solver of the published experiment does."""
    tree, world = acrobat(), Physics(0.05, 0.0, integration="velocity")
    runs = [simulate(tree, world, n, floating(tree)) for n in (1, 100)]
    (_, before), (_, after) = (momentum_of_last_step(tree, result) for result in runs)
    assert np.linalg.norm(after - before) > 1e-3 * np.linalg.norm(before)


# pendulums

GRAVITY, LENGTH, RADIUS = 9.81, 0.8, 0.1


def pendulum(motor=None, stops=None):
    bob = Body("bob", (0, 0, 3 - LENGTH), 2.0, [Sphere(RADIUS)])
    stand = Body("stand", (0, 0, 3), 1.0, [Sphere(0.05)])
    return Tree([stand, bob], [Hinge("stand", "bob", (0, 0, 3), (0, -1, 0), motor, 0, stops)], fixed=True)


def swing(angle, time_step, integration, periods=3):
    """Angles of a pendulum let go, and its period after the elliptic integral."""
    tree = pendulum()
    inertia = LENGTH**2 + 0.4 * RADIUS**2  # of a kilogram
    period = 4 * ellipk(np.sin(angle / 2) ** 2) * np.sqrt(inertia / (GRAVITY * LENGTH))
    steps = int(periods * period / time_step)
    found = simulate(
        tree, Physics(time_step, -GRAVITY, integration=integration), steps, moving(tree, [0] * 6, 0, angle)
    )
    return found.frames.angles[:, 0, 0], period


@BOTH
@pytest.mark.parametrize("angle", [0.1, 1.0, 2.5])
def test_a_pendulum_has_the_period_of_the_elliptic_integral(angle, integration):
    time_step, tolerance = 0.001, 1e-5 if integration == "momentum" else 1e-4
    angles, period = swing(angle, time_step, integration)
    falls = np.nonzero((angles[:-1] > 0) & (angles[1:] <= 0))[0]
    times = time_step * (falls + angles[falls] / (angles[falls] - angles[falls + 1]))
    assert len(times) == 3 and np.allclose(np.diff(times), period, rtol=tolerance)


def test_the_error_of_a_pendulums_energy_halves_with_the_time_step():
    errors = []
    for time_step in (0.02, 0.01, 0.005, 0.0025):
        angles, _ = swing(1.5, time_step, "momentum")
        rates = np.diff(angles) / time_step
        inertia = LENGTH**2 + 0.4 * RADIUS**2
        energy = inertia * rates**2 / 2 - GRAVITY * LENGTH * np.cos(angles[1:])
        errors.append(np.abs(energy + GRAVITY * LENGTH * np.cos(1.5)).max())
    assert errors[-1] < 0.05 and np.allclose(np.divide(errors[:-1], errors[1:]), 2, atol=0.1)


# rolling and sliding


def slipping(speed, per_step, steps):
    """Speeds that shrink by a factor of 1 / (1 + per_step) in each step."""
    return speed / (1 + per_step) ** np.arange(1, steps + 1)


@BOTH
def test_a_sphere_that_slides_ends_rolling_at_five_sevenths_of_its_speed(integration):
    """Friction on its lowest point changes its slip by 7/2 of what it does to a mass (1 / m + r^2 / I = 7 / 2 m)."""
    radius, mass, world = 0.1, 2.0, Physics(0.01, slip=0.05, integration=integration)
    ball = Tree([Body("ball", (0, 0, radius), mass, [Sphere(radius)])])
    found = simulate(ball, world, 400, moving(ball, (0, 0, 0, 0.7, 0, 0)))
    speeds = np.diff(found.frames.position[:, 0, 0]) / world.time_step
    slips = slipping(0.7, 3.5 * world.time_step / (mass * world.slip), 400)
    assert np.allclose(speeds, 0.5 + 2 / 7 * slips, rtol=0, atol=1e-9)
    assert np.allclose(found.velocities[0, 0], [0, 0.5 / radius, 0, 0.5, 0, 0], atol=1e-9)
    assert np.ptp(found.frames.position[:, 0, 2]) < 1e-9


def plate(width=1.0, mass=2.0):
    """A flat box on the ground."""
    return Tree([Body("plate", (0, 0, 0.01), mass, [Box((width, width, 0.02))])])


@BOTH
def test_a_plate_that_slides_on_four_corners_slows_down_exponentially(integration):
    """Each corner pulls with v / slip, so that m v' = -4 v / slip."""
    tree, world = plate(), Physics(0.01, slip=0.1, integration=integration)
    found = simulate(tree, world, 100, moving(tree, (0, 0, 0, 0.03, -0.04, 0)))
    speeds = np.linalg.norm(np.diff(found.frames.position[:, 0], axis=0), axis=1) / world.time_step
    assert np.allclose(speeds, slipping(0.05, 4 * world.time_step / (2.0 * world.slip), 100), rtol=1e-6)


@pytest.mark.parametrize("torque", [0.05, 0.2])
def test_what_is_pulled_over_the_ground_creeps_at_the_force_times_the_slip(torque):
    """A mast turns an arm whose end lies on the ground: F = torque / reach, and its speed is F / 100."""
    reach, radius = 0.5, 0.05
    mast = Body("mast", (0, 0, 1), 1.0, [Sphere(0.1)])
    hub = Body("hub", (0, 0, 0.3), 0.1, [Sphere(0.05)])
    arm = Body("arm", (reach, 0, radius), 1.0, [Sphere(radius)])
    tree = Tree(
        [mast, hub, arm],
        [
            Hinge("mast", "hub", (0, 0, 0.3), (0, 0, 1), Motor.velocity(100.0, torque)),
            Hinge("hub", "arm", (0, 0, 0.3), (0, 1, 0)),
        ],
        fixed=True,
    )
    found = simulate(tree, Physics(0.01, -1.0, slip=0.01), 600, commands=np.ones((1, 1, 1)))
    rate = np.diff(found.frames.angles[-2:, 0, 0])[0] / 0.01
    assert np.isclose(rate * reach, torque / reach / 100, rtol=1e-6)


@pytest.mark.parametrize(("joints", "share"), [("wheels", 0.5), ("swivels", 1.0)])
def test_a_wheel_beside_one_that_stands_still_drives_at_half_speed(joints, share):
    """Wheel and swivel lie on the same spot: driven wheels drag the swivels along, driven swivels take the wheels."""
    commands = np.zeros((1, 1, 8))
    commands[..., 4 * (joints == "wheels") :][..., :4] = 1.0
    found = engine(WHEELED, precision="f64", threads=1).run(400, commands=commands, record_every=1)
    speed = np.linalg.norm(found.frames.position[-1, 0] - found.frames.position[-2, 0]) / 0.05
    assert np.isclose(speed, share * 0.5 * 10 * np.pi / 4 * 0.1, rtol=1e-4)


@BOTH
def test_with_a_coefficient_of_friction_a_plate_stops_after_v_over_mu_g(integration):
    """At the end it creeps at slip times force, as long as that is inside the cone."""
    tree, world = plate(), Physics(0.01, -GRAVITY, slip=1e-5, friction=0.3, integration=integration)
    found = simulate(tree, world, 120, moving(tree, (0, 0, 0, 1.2, -1.6, 0)))
    along = found.frames.position[:, 0, :2] @ [0.6, -0.8]
    speeds = np.diff(along) / world.time_step
    expected = np.maximum(2.0 - 0.3 * GRAVITY * world.time_step * np.arange(1, 121), 0)
    assert expected[66] > 0 and expected[67] == 0
    assert np.abs(speeds - expected).max() < 1e-4 and np.abs(speeds[68:]).max() < 1e-7


SLIDERS = {
    "plate": [Box((0.4, 0.4, 0.02))],
    "small plate": [Box((0.2, 0.2, 0.02))],
    "block": [Box((0.2, 0.2, 0.1))],
    "feet": [Sphere(0.02, (x, y, -0.03)) for x in (-0.1, 0.1) for y in (-0.1, 0.1)],
}


@BOTH
@pytest.mark.parametrize("slip", [1e-5, 1e-2])
@pytest.mark.parametrize("name", SLIDERS)
def test_friction_stays_in_its_cone_where_it_makes_a_body_pitch(integration, slip, name):
    """Friction below the middle loads the points in front and takes the load off those behind."""
    solids = SLIDERS[name]
    height = 0.05 if name == "feet" else solids[0].size[2] / 2
    tree = Tree([Body("slider", (0, 0, height), 1.0, solids, np.eye(3) * 0.004)])
    world = Physics(0.01, -GRAVITY, slip=slip, friction=0.3, integration=integration)
    found = simulate(tree, world, 40, moving(tree, (0, 0, 0, 2.0, 0, 0)))
    speeds = np.diff(found.frames.position[:, 0, 0]) / world.time_step
    assert np.abs(speeds[5:] - (2.0 - 0.3 * GRAVITY * world.time_step * np.arange(6, 41))).max() < 5e-3


@BOTH
@pytest.mark.parametrize(("degrees", "slides"), [(14.0, False), (20.0, True), (35.0, True)])
def test_a_block_slides_where_the_ground_is_steeper_than_its_friction(integration, degrees, slides):
    angle = np.radians(degrees)
    tree = Tree([Body("block", (0, 0, 0.05), 1.0, [Box((0.2, 0.2, 0.1))])])
    across = (GRAVITY * np.sin(angle), 0.0)
    about = {"gravity_across": across, "integration": integration}
    world = Physics(0.01, -GRAVITY * np.cos(angle), slip=1e-4, friction=0.3, **about)
    found = simulate(tree, world, 100)
    moved = found.frames.position[-1, 0, 0]
    expected = GRAVITY * (np.sin(angle) - 0.3 * np.cos(angle)) / 2 if slides else 0.0
    assert moved == pytest.approx(expected, rel=0.02, abs=1e-3)


def tilted(time_step, degrees, friction, **settings):
    """A world whose ground falls along x."""
    down, along = GRAVITY * np.cos(np.radians(degrees)), GRAVITY * np.sin(np.radians(degrees))
    return Physics(time_step, -down, friction=friction, gravity_across=(along, 0.0), **settings)


@BOTH
@pytest.mark.parametrize("friction", [0.5, np.inf])
def test_friction_holds_boxes_of_any_mass_on_a_slope(integration, friction):
    """Each point creeps at slip times its quarter of the force along the slope, less than 5 micrometres a second."""
    boxes = [Tree([Body("box", (0, 0, 0.1), mass, [Box((0.2, 0.2, 0.2))])]) for mass in (0.01, 1.0, 100.0, 1000.0)]
    found = simulate(boxes, tilted(0.005, 10.0, friction, integration=integration), 400)
    assert np.abs(found.position[:, :2]).max() < 1e-5 and not found.residual.any()
    assert np.ptp(found.position[:, 0]) < 1e-7 < found.position[:, 0].min()  # they creep alike, if a little


@BOTH
@pytest.mark.parametrize("mass", [1.0, 100.0])
def test_a_ball_of_any_mass_rolls_down_a_slope(integration, mass):
    """A homogeneous ball that does not slip is accelerated by 5/7 of the gravity along the slope."""
    ball = Tree([Body("ball", (0, 0, 0.1), mass, [Sphere(0.1)])])
    found = simulate(ball, tilted(0.002, 10.0, 0.8, integration=integration), 500)
    assert found.position[0, 0] == pytest.approx(5 / 14 * GRAVITY * np.sin(np.radians(10.0)), rel=3e-3)


def test_slip_is_that_of_the_mass_that_moves():
    """A given slip counts whatever the mass; a heavy base that is fixed to the world does not count."""
    assert Physics(0.01, slip=0.02).slip_strength(1.0) == Physics(0.01, slip=0.02).slip_strength(9.0) == 0.01 / 0.02
    assert Physics(0.01).slip_strength(3.0) == pytest.approx(0.01 * 3.0 * 9.81 / 1e-4)

    def arm(mass):
        stand, pad = Body("stand", (0, 0, 1), mass, [], np.eye(3)), Body("pad", (0.5, 0, 0.1), 1.0, [Sphere(0.1)])
        return Tree([stand, pad], [Hinge("stand", "pad", (0, 0, 0.5), (0, 0, 1), Motor.velocity(2.0, 9.0))], fixed=True)

    light, heavy = (simulate(arm(m), Physics(0.01), 50, commands=np.ones((1, 1, 1))) for m in (1.0, 1e6))
    assert light.angles[0, 0] > 1e-6 and np.array_equal(light.angles, heavy.angles)


# resting, stops, motors, welds


@BOTH
def test_a_plate_at_rest_stays_so_on_four_corners_that_carry_its_weight(integration):
    """Nothing moves, so their impulses sum to m g h in every step; also where the weight lies off its middle."""
    off = Body("plate", (0.2, -0.1, 0.01), 2.0, [Box((1.0, 1.0, 0.02), (-0.2, 0.1, 0))], np.eye(3) * 0.2)
    for tree in (plate(), Tree([off])):
        found = simulate(tree, Physics(0.05, integration=integration), 200)
        assert np.abs(found.frames.position - found.frames.position[0]).max() < 1e-8
        assert np.abs(found.frames.orientation - found.frames.orientation[0]).max() < 1e-8


@BOTH
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_stop_holds_what_falls_on_it(integration, side):
    """It comes to rest there; in the studies' solver the arm is seen behind it, and pushed back by a part in a step."""
    stand = Body("stand", (0, 0, 3), 1.0, [Sphere(0.05)])
    arm = Body("arm", (0.5, 0, 3), 2.0, [Capsule(0.05, 0.5, (1, 0, 0))])
    hinge = Hinge("stand", "arm", (0, 0, 3), (0, side, 0), stops=(-0.6, 0.6))  # it falls to the side of the axis
    world = Physics(0.005, -GRAVITY, integration=integration)
    found = simulate(Tree([stand, arm], [hinge], fixed=True), world, 400)
    angles = side * found.frames.angles[:, 0, 0]
    fastest = np.diff(angles).max()
    assert 0.6 - 1e-9 < angles.max() < 0.6 + (fastest if integration == "velocity" else 1e-9)
    assert np.abs(angles[-100:] - 0.6).max() < 1e-3 + fastest / 20


def test_a_motor_at_its_torque_limit_stalls_where_the_load_balances_it():
    """m g l sin(a) = torque; a slow motor reaches this angle and stays near it, a strong one goes on."""
    for torque, expected in ((5.0, np.arcsin(5.0 / (2.0 * GRAVITY * LENGTH))), (30.0, 0.05 * 40)):
        tree = pendulum(Motor.velocity(0.05, torque))
        angles = simulate(tree, Physics(0.01, -GRAVITY), 4000, commands=np.ones((1, 1, 1))).frames.angles[:, 0, 0]
        assert np.abs(angles[-1000 if torque < 10 else -1 :] - expected).max() < 0.02


@BOTH
def test_a_motor_within_its_torque_holds_its_rate(integration):
    tree = pendulum(Motor.velocity(2.0, 1000.0))
    found = simulate(tree, Physics(0.01, -GRAVITY, integration=integration), 300, commands=np.full((1, 1, 1), 0.7))
    assert np.allclose(np.diff(found.frames.angles[:, 0, 0]), 0.014, rtol=1e-9)


@BOTH
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_position_drive_goes_no_faster_than_its_largest_rate(integration, side):
    """At that rate until what is missing asks for less, then as any other."""
    tree = pendulum(Motor.position(-2.0, 2.0, 10.0, 1000.0, fastest=0.5))
    world = Physics(0.01, -GRAVITY, integration=integration)
    found = simulate(tree, world, 500, commands=np.full((1, 1, 1), side))
    angles = side * found.frames.angles[:, 0, 0]
    rates = np.diff(angles) / 0.01
    assert np.allclose(rates, np.minimum(10.0 * (2.0 - angles[:-1]), 0.5), atol=1e-9)
    assert np.isclose(angles[-1], 2.0) and (rates > 0.499).sum() == pytest.approx(390, abs=1)


def dumbbell(welded):
    """Two boxes on a rod, of three bodies welded together or of one with the sum of their inertias."""
    rod = Body("rod", (0, 0, 1), 1.0, [Capsule(0.05, 0.6, (1, 0, 0))])
    ends = [Body(f"end {x}", (x, 0, 1), 2.0, [Box((0.1, 0.3, 0.2))]) for x in (-0.4, 0.4)]
    if welded:
        return Tree([rod, *ends], [Weld("rod", end.name) for end in ends])
    away = 2.0 * 0.4**2 * np.diag([0, 1, 1])
    inertia = rod.inertia + sum(end.inertia + away for end in ends)
    shapes = [rod.shapes[0], *(Box((0.1, 0.3, 0.2), (x, 0, 0)) for x in (-0.4, 0.4))]
    return Tree([Body("all", (0, 0, 1), 5.0, shapes, inertia)])


def test_welded_bodies_are_one_body_with_the_sum_of_their_inertias():
    world = Physics(0.01, friction=0.6, slip=1e-3)
    thrown = (2.0, 1.0, -1.0, 0.5, 0.2, 1.0)
    one, welded = (simulate(tree, world, 150, moving(tree, thrown)) for tree in map(dumbbell, (False, True)))
    assert one.frames.position[:, 0, 2].min() < 0.4  # it has fallen down
    assert np.abs(one.frames.position - welded.frames.position).max() < 1e-6  # sliding contacts magnify rounding
    assert np.abs(one.frames.orientation - welded.frames.orientation).max() < 1e-6


@BOTH
def test_a_fixed_base_stays_where_it_is_whatever_hangs_on_it(integration):
    deep = Body("stand", (0, 0, 0.02), 1.0, [Sphere(0.1)])  # inside the ground
    arm = Body("arm", (0.3, 0, 0.2), 1.0, [Capsule(0.05, 0.3, (1, 0, 0))])
    tree = Tree([deep, arm], [Hinge("stand", "arm", (0.1, 0, 0.2), (0, 1, 0))], fixed=True)
    found = simulate(tree, Physics(0.01, integration=integration), 200)
    assert np.array_equal(found.frames.position, np.broadcast_to(deep.position, (201, 1, 3)))
    assert np.array_equal(found.frames.orientation, np.broadcast_to(UPRIGHT[0], (201, 1, 4)))
    assert 0.2 < found.angles[0, 0] < 0.6  # the arm has come to lie on the ground
