"""Hinges with servos, rotors, dampers, springs and friction: against their equations of motion."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco_motion import coordinates_under

from taichi_sim.rigid import Body, Hinge, Motor, Passive, Physics, RigidEngine, Servo, State, Tree, slots
from taichi_sim.rigid.model.files import read_model

pytestmark = pytest.mark.kernels

STEP = 1e-3
INERTIA = 0.02  # kg m^2, of the flywheel about its hinge
BASE = Body("base", (0.0, 0.0, 0.0), 20.0, inertia=np.eye(3))
FLYWHEEL = Body("flywheel", (0.0, 0.0, 0.0), 0.5, inertia=INERTIA * np.eye(3))


def wheel(motor=None, passive=None, stops=None, fixed=True):
    """A flywheel on a hinge through its centre, which gravity does not turn."""
    hinge = Hinge("base", "flywheel", (0, 0, 0), (0, 1, 0), motor, 0, stops, passive=passive or Passive())
    return Tree((BASE, FLYWHEEL), (hinge,), fixed=fixed)


def turned(tree, steps, angle=0.0, rate=0.0, step=STEP, commands=None, **world):
    """Angles at all steps, from an angle and a rate."""
    engine = RigidEngine([tree], Physics(step, gravity=0.0, **world), threads=1)
    start = replace(engine.rest(), angles=np.array([[angle]]), rates=np.array([[rate]]))
    run = engine.run(steps, start=start, commands=commands, record_every=1)
    assert run.residual.max() == 0
    return run.frames.angles.reshape(-1)


@pytest.mark.parametrize("integration", ["momentum", "velocity"])
@pytest.mark.parametrize("rotor", [0.0, 0.3])
@pytest.mark.parametrize("stiffness", [0.5, 1e3, 1e7])
def test_a_spring_swings_by_the_trapezoidal_rule_without_loss(stiffness, rotor, integration):
    spring = Passive(rotor, 0.0, stiffness, 0.2)
    found = turned(wheel(passive=spring), 2000, 0.5, integration=integration) - 0.2
    inertia = INERTIA + rotor
    frequency = 2 / STEP * np.arctan(STEP / 2 * np.sqrt(stiffness / inertia))
    # Semi-implicit Euler: the rate of rest belongs to half a step before the angle, so that the phase lags by half one.
    phase = frequency * STEP * (np.arange(2001) + 0.5)
    expected = 0.3 * np.cos(phase) / np.cos(0.5 * frequency * STEP)
    assert found == pytest.approx(expected, abs=1e-8 * abs(expected).max() * max(1.0, frequency))


def test_a_rotor_of_a_drive_slows_it_down():
    pushed = [turned(wheel(Servo(0.4), Passive(rotor)), 100, commands=np.ones((1, 1, 1)))[-1] for rotor in (0.0, 0.06)]
    assert pushed[0] == pytest.approx(0.5 * 0.4 / INERTIA * 0.1 * 0.101, rel=1e-9)
    assert pushed[0] / pushed[1] == pytest.approx((INERTIA + 0.06) / INERTIA, rel=1e-9)


def test_a_damper_takes_its_share_of_the_rate_in_each_step():
    found = np.diff(turned(wheel(passive=Passive(0.01, 0.3)), 50, rate=2.0)) / STEP
    kept = 1 / (1 + STEP * 0.3 / (INERTIA + 0.01))
    assert found == pytest.approx(2.0 * kept ** np.arange(1, 51), rel=1e-9)


def test_a_rate_servo_comes_to_its_rate_and_a_weak_one_to_what_friction_leaves():
    servo, commands = Servo(0.5 * 6.0, by_rate=0.5), np.full((1, 1, 1), 0.5)
    rates = np.diff(turned(wheel(servo), 2000, commands=commands)) / STEP
    assert rates[-1] == pytest.approx(3.0, rel=1e-9)
    assert rates[0] == pytest.approx(STEP * 1.5 / (INERTIA + STEP * 0.5), rel=1e-9)
    weak = replace(servo, torque=0.1)
    rates = np.diff(turned(wheel(weak, Passive(damping=0.2)), 2000, commands=commands)) / STEP
    assert rates[0] == pytest.approx(STEP * 0.1 / (INERTIA + STEP * 0.2), rel=1e-9)
    assert rates[-1] == pytest.approx(0.5, rel=1e-8)


@pytest.mark.parametrize("stiffness, damping", [(5.0, 0.2), (500.0, 5.0), (1e8, 1e4)])
def test_a_position_servo_comes_to_its_angle_whatever_its_stiffness(stiffness, damping):
    servo = Servo.position(-0.5, 1.5, stiffness, damping)
    found = turned(wheel(servo), 3000, commands=np.full((1, 1, 1), 0.2))
    assert found[-1] == pytest.approx(0.7, abs=1e-6)


@pytest.mark.parametrize("motor", [None, Servo(1.0, torque=0.0), Motor(0.0, 1.0)])
def test_a_wheel_with_friction_runs_down_and_stays(motor):
    given = None if motor is None else np.ones((1, 1, 1))
    rates = np.diff(turned(wheel(motor, Passive(friction=0.05)), 1000, rate=1.0, commands=given)) / STEP
    slowing = 0.05 / INERTIA * STEP
    assert rates == pytest.approx(np.maximum(1.0 - slowing * np.arange(1, 1001), 0.0), abs=1e-9)
    assert (rates[410:] == 0).all()


@pytest.mark.parametrize("side", [1, -1])
def test_friction_holds_what_a_drive_cannot_move(side):
    """A torque, a spring and a motor that wants a rate: below the friction nothing moves, beyond it the rest does."""
    commands = np.full((1, 1, 1), float(side))
    for share, drive, passive in (
        (0.3, Servo(0.3), Passive()),
        (0.3, Motor(0.3, 50.0), Passive()),
        (0.3, Servo(0.0), Passive(stiffness=1.0, spring_rest=0.3 * side)),
    ):
        held = turned(wheel(drive, replace(passive, friction=1.01 * share)), 200, commands=commands)
        assert (held == 0).all()
        found = turned(wheel(drive, replace(passive, friction=0.9 * share)), 30, commands=commands)
        assert np.diff(found)[0] * side / STEP == pytest.approx(STEP * 0.1 * share / INERTIA, rel=1e-4)


def test_a_motor_keeps_its_rate_against_friction_as_far_as_its_torque_goes():
    commands = np.ones((1, 1, 1))
    rates = np.diff(turned(wheel(Motor(0.5, 2.0), Passive(friction=0.4)), 800, commands=commands)) / STEP
    assert rates[0] == pytest.approx(STEP * 0.1 / INERTIA, rel=1e-9) and rates[-1] == pytest.approx(2.0, rel=1e-9)
    turning = np.repeat([1.0, -1.0, 0.0], 500)[None, :, None]
    rates = np.diff(turned(wheel(Motor(0.5, 2.0), Passive(friction=0.4)), 1500, commands=turning)) / STEP
    assert rates[[499, 999]] == pytest.approx([2.0, -2.0], rel=1e-9) and (rates[1200:] == 0).all()
    assert rates[500] == pytest.approx(2.0 - STEP * 0.9 / INERTIA, rel=1e-9)


def test_friction_takes_its_part_at_stops():
    """An arm that a servo presses on a stop stays there until the servo pulls beyond the friction."""
    commands = np.repeat([1.0, -0.2, -0.6], 300)[None, :, None]
    found = turned(wheel(Servo(1.0), Passive(friction=0.3), stops=(-1.0, 0.2)), 900, commands=commands)
    assert found[[250, 600]] == pytest.approx([0.2, 0.2], abs=1e-9) and found[-1] < 0.2 - 0.1
    assert found[[601]] - found[[600]] == pytest.approx([-STEP * STEP * 0.3 / INERTIA], rel=1e-6)


def test_an_undamped_servo_swings_as_a_spring_does():
    servo = turned(wheel(Servo.position(-0.3, 0.7, 40.0)), 500, 0.5, commands=np.zeros((1, 1, 1)))
    spring = turned(wheel(passive=Passive(stiffness=40.0, spring_rest=0.2)), 500, 0.5)
    assert servo == pytest.approx(spring, abs=1e-12)


def test_a_servo_in_its_bounds_is_weaker_than_one_beyond():
    """From far away its largest torque pulls; near its angle, its spring."""
    found = turned(
        wheel(Servo.position(-2.0, 2.0, 10.0, 1.0, torque=0.5)), 4000, -1.5, commands=np.full((1, 1, 1), 0.5)
    )
    assert np.diff(found, 2)[:100] / STEP**2 == pytest.approx(np.full(100, 0.5 / INERTIA), rel=1e-6)
    assert found[-1] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("side", [1, -1])
def test_a_servo_presses_on_a_stop_and_leaves_it_again(side):
    commands = np.repeat([1.0, -1.0, 1.0], 400)[None, :, None] * side
    for servo in (Servo.position(-1.0, 1.0, 20.0, 0.5), Servo(0.3), Servo(3.0, by_rate=0.5, torque=0.4)):
        found = side * turned(wheel(servo, stops=(-0.25, 0.25)), 1200, commands=commands)
        assert abs(found).max() < 0.25 + 1e-9
        assert found[[350, 800, 1200]] == pytest.approx([0.25, -0.25, 0.25], abs=1e-9)


def test_a_rotor_does_not_turn_a_robot_that_floats():
    """The moment of momentum of base and wheel stays; the rotor takes up no more than the inertia of the hinge."""
    tree = wheel(Servo.position(-1, 1, 5.0, 0.1), Passive(0.05, 0.02, 3.0, 0.4), fixed=False)
    engine = RigidEngine([tree], Physics(STEP, gravity=0.0), threads=1)
    run = engine.run(500, commands=np.ones((1, 1, 1)))
    spins = run.velocities[0, :, 1]
    assert abs(spins).min() > 0.01 and spins @ [1.0, INERTIA] == pytest.approx(0.0, abs=1e-13)


def leg(values):
    """A fixed leg of two links, which swing between stops; of the numbers of its hinges."""
    values = np.asarray(values, float)
    bodies = [
        Body("base", (0.0, 0.0, 1.0), 2.0, inertia=np.eye(3)),
        Body("thigh", (0.05, 0.0, 0.8), 1.0, inertia=0.01 * np.eye(3)),
        Body("shank", (0.0, 0.02, 0.4), 0.6, inertia=0.004 * np.eye(3)),
    ]
    hip = Servo(*values[:4].tolist(), torque=float(values[4]))
    knee = Motor(30.0, 4.0, -6.0, 0.5)
    joints = [
        Hinge("base", "thigh", (0, 0, 1), (0, 1, 0), hip, 0, (-0.4, 0.3), passive=Passive(*values[5:10].tolist())),
        Hinge("thigh", "shank", (0, 0, 0.6), (0.1, 1, 0), knee, 1, passive=Passive(*values[10:15].tolist())),
    ]
    return Tree(bodies, joints, True)


NUMBERS = np.array([6.0, -20.0, 1.0, 0.5, 5.0, 0.03, 0.2, 4.0, 0.1, 0.5, 0.02, 0.1, 2.0, -0.2, 0.3])
SLOTS = [*range(slots.BY_COMMAND, slots.OFFSET + 1), slots.BY_RATE, slots.TORQUE]
BESIDE = [*range(slots.ROTOR, slots.SPRING_REST + 1), slots.DRY_FRICTION]
PLACES = [(1, s) for s in SLOTS] + [(n, s) for n in (1, 2) for s in BESIDE]


@pytest.mark.parametrize("integration", ["momentum", "velocity"])
def test_gradients_are_those_of_differences(integration):
    """By all numbers of a servo, passive forces and friction, in bounds, at bounds and at stops, and by the start."""
    rng, steps, change = np.random.default_rng(4), 300, 1e-6
    commands = rng.uniform(-1.5, 1.5, (1, 10, 2))
    world = Physics(2e-3, integration=integration)

    def engine(numbers):
        return RigidEngine([leg(numbers)], world, threads=1)

    def start(rates):
        return replace(engine(NUMBERS).rest(), rates=np.array([rates]))

    def cost(numbers, rates):
        return engine(numbers).run(steps, commands=commands, hold=30, start=start(rates)).angles[0] @ [1.0, -2.0]

    given = np.array([1.0, -3.0])
    tape = engine(NUMBERS).record(steps, commands=commands, hold=30, start=start(given))
    found = tape.pull_back(angles=np.array([[1.0, -2.0]]))
    slopes = np.array([found.parameters[0, body, slot] for body, slot in PLACES])
    moves = change * np.maximum(abs(NUMBERS), 0.1)[:, None] * np.eye(len(NUMBERS))
    expected = [(cost(NUMBERS + move, given) - cost(NUMBERS - move, given)) / (2 * move.max()) for move in moves]
    assert slopes == pytest.approx(expected, rel=2e-4, abs=1e-6) and (abs(slopes) > 1e-6).all()
    run = engine(NUMBERS).run(steps, commands=commands, hold=30, start=start(given), record_every=1)
    hip = run.frames.angles[:, 0, 0]
    assert hip.max() > 0.299 or hip.min() < -0.399


def test_wrong_numbers_are_refused():
    for make, said in (
        (lambda: Passive(-1.0), "rotor_inertia: -1.0 is not allowed"),
        (lambda: Passive(stiffness=np.nan), "stiffness: nan is not allowed"),
        (lambda: Servo(1.0, by_angle=2.0), "by_angle: 2.0 is not allowed"),
        (lambda: Servo(1.0, torque=-1.0), "torque: -1.0 is not allowed"),
        (lambda: Servo.position(-1, 1, 0.0), "stiffness: 0.0 is not allowed"),
    ):
        with pytest.raises(ValueError, match=said):
            make()


def test_a_run_goes_on_from_its_state_with_the_rate_that_rotors_have():
    tree = wheel(passive=Passive(0.1, 0.0, 3.0), fixed=True)
    whole = turned(tree, 60, 0.5, 1.0)
    half = RigidEngine([tree], Physics(STEP, gravity=0.0), threads=1)
    start = State(*(np.zeros((1, n)) for n in (3, 4, 1, 6, 1)))
    middle, rate = whole[30], (whole[30] - whole[29]) / STEP
    start = replace(
        start, orientation=np.array([[1.0, 0, 0, 0]]), angles=np.array([[middle]]), rates=np.array([[rate]])
    )
    assert half.run(30, start=start).angles[0, 0] == pytest.approx(whole[60], rel=1e-9)


SWINGS = """<mujoco><worldbody><body name="arm" pos="0 0 1">
<joint name="a" axis="0 1 0" armature=".02" damping=".1" stiffness="4" springref="-20" range="-70 70"
limited="{limited}"/>
<geom type="sphere" size=".1" pos="0 0 -.5" mass="2"/>
<body name="hand" pos="0 0 -.5"><joint name="b" axis="0 1 0" armature=".01" stiffness=".5" frictionloss="{friction}"
solreffriction="1e-4 1"/>
<geom type="sphere" size=".05" pos=".3 0 0" mass=".5"/></body></body></worldbody>
<actuator>{drives}</actuator></mujoco>"""
DRIVES = {
    "by angle and rate": '<position joint="a" kp="40" kv="2" ctrlrange="-1 1" forcerange="-6 6"/>'
    '<velocity joint="b" kv=".5" ctrlrange="-8 8" forcerange="-1 1"/>',
    "with gears": '<position joint="a" kp="9" gear="-2" dampratio=".4" ctrlrange="-1 1.5"/>'
    '<velocity joint="b" kv=".1" gear="2" ctrlrange="-8 8"/>',
    "by torque": '<motor joint="a" ctrlrange="-8 8"/><motor joint="b" gear=".5" ctrlrange="-1 2"/>',
}


@pytest.mark.parametrize("limited", ["false", "true"])
@pytest.mark.parametrize("drives", DRIVES)
def test_robots_of_files_move_as_in_mujoco(drives, limited):
    """Drives, rotors, dampers, springs and stops, under random commands: as near as MuJoCo with the same steps."""
    text = SWINGS.format(drives=DRIVES[drives], limited=limited, friction=0.1 * (drives != "by torque"))
    told = np.random.default_rng(1).uniform(-1, 1, (12, 2))
    theirs = mujoco.MjModel.from_xml_string(text)
    tree = read_model(text).tree
    free = Tree([replace(body, shapes=()) for body in tree.bodies], tree.joints, tree.fixed)
    run = RigidEngine([free], Physics(STEP), threads=1).run(1200, commands=told[None], hold=100, record_every=100)
    exact, alike = (coordinates_under(theirs, told, step, 0.1) for step in (1e-5, STEP))
    assert np.abs(exact).max() > 0.8
    assert np.abs(run.frames.angles[1:, 0] - exact).max() < 1.5 * np.abs(alike - exact).max() + 2e-3
