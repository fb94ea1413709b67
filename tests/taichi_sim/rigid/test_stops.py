"""Stops of hinges: motors that press on them, that leave them, and that have not the torque to leave."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_sim.rigid import Body, Capsule, Hinge, Motor, Physics, RigidEngine, Tree, slots

pytestmark = pytest.mark.kernels

STEP = 1e-3
MASS, ARM, INERTIA = 0.5, 0.2, 4e-3
ABOUT = INERTIA + MASS * ARM**2  # the hinge [kg m^2]
LOAD = MASS * 9.81 * ARM  # of the arm that lies at its stop [N m]
BASE = Body("base", (0.0, 0.0, 0.0), 20.0, inertia=np.eye(3))
WEIGHT = Body("arm", (ARM, 0.0, 0.0), MASS, inertia=np.diag([1e-3, INERTIA, INERTIA]))


def arm(torque, wanted, stops=(0.0, 1.5), up=-1.0, swings=0.0):
    """An arm that lies on its stop, fixed to the world; its motor, which wants a rate, lifts it about ``up`` y."""
    motor = Motor(torque, swings, offset=wanted)
    hinge = Hinge("base", "arm", (0.0, 0.0, 0.0), (0.0, up, 0.0), motor, 0, stops)
    return Tree((BASE, WEIGHT), (hinge,), fixed=True)


def angles(tree, seconds, **world):
    run = RigidEngine([tree], Physics(STEP, **world), threads=1).run(round(seconds / STEP), record_every=1)
    return run.frames.angles.reshape(-1)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("torque", [10.0, 100.0, 1e4])
def test_a_motor_leaves_a_stop_at_the_rate_that_it_wants_and_no_faster(torque, side):
    stops = (0.0, 1.5) if side > 0 else (-1.5, 0.0)
    found = side * angles(arm(torque, 2.0 * side, stops, up=-1.0 * side), 1.0)
    rates = np.diff(found) / STEP
    assert rates.max() < 2.0 + 1e-9 and found.max() < 1.5 + 1e-9
    held = rates[round(0.2 / STEP) : round(0.6 / STEP)]
    assert held == pytest.approx(np.full(len(held), 2.0), rel=1e-9)
    assert rates[0] == pytest.approx(min(2.0, STEP * (torque - LOAD) / ABOUT), rel=1e-4)


@pytest.mark.parametrize("step, rate", [(1e-3, 50.0), (0.01, 50.0), (0.05, 300.0)])
def test_no_rate_passes_a_stop(step, rate):
    """However far a step would lead: a motor that swings to and fro, and what swings without one."""
    commands = np.repeat([1.0, -1.0, 1.0, -1.0], 10)[None, :, None]
    driven = arm(1e3, 0.0, (-0.2, 0.2), swings=rate)
    run = RigidEngine([driven], Physics(step), threads=1).run(40, commands=commands, record_every=1)
    assert abs(run.frames.angles).max() < 0.2 + 1e-9 and np.ptp(run.frames.angles) == pytest.approx(0.4)
    assert run.residual.max() == 0
    free = Tree((BASE, WEIGHT), (Hinge("base", "arm", (0, 0, 0), (0, -1.0, 0), stops=(-1.2, 0.3)),), fixed=True)
    fallen = RigidEngine([free], Physics(step), threads=1).run(400, record_every=1).frames.angles.reshape(-1)
    assert fallen.min() > -1.2 - 1e-9 and fallen[-1] == pytest.approx(-1.2, abs=1e-9)


@pytest.mark.parametrize("share, leaves", [(0.5, False), (0.99, False), (1.01, True)])
def test_a_motor_leaves_a_stop_with_the_torque_that_lifts_its_load(share, leaves):
    found = angles(arm(share * LOAD, 2.0), 0.3)
    if not leaves:
        assert abs(found).max() < 1e-12
        return
    falls = 0.5 * 0.01 * LOAD / ABOUT * 0.1**2  # of a hundredth of the load, before the arm is higher
    assert found[round(0.1 / STEP)] == pytest.approx(falls, rel=0.05)


def test_a_motor_that_presses_stays_at_its_stop():
    assert abs(angles(arm(100.0, -3.0), 0.2)).max() < 1e-12


def test_a_loaded_arm_that_falls_on_its_stop_is_held():
    weak = arm(0.2 * LOAD, 5.0, stops=(-0.4, 0.4))
    found = angles(weak, 3.0)
    assert found.min() > -0.4 - 1e-9 and found[-500:] == pytest.approx(np.full(500, -0.4), abs=1e-4)


def test_stops_of_the_studies_are_as_they_were():
    """ODE's rule: the whole torque in a step, whatever rate that gives."""
    found = angles(arm(100.0, 2.0), 0.01, integration="velocity")
    assert found[1] / STEP > 3.0


@pytest.mark.parametrize("side", [1, -1], ids=["on the lower stop", "on the upper stop"])
@pytest.mark.parametrize("torque", [0.5 * LOAD, 1.2 * LOAD, 50.0])
def test_gradients_past_stops_are_those_of_differences(torque, side):
    """By torque and rate of a motor that swings to and fro between stops: presses, leaves, or cannot leave them."""
    steps, change, stops = 400, 1e-6, (-0.02, 0.03) if side > 0 else (-0.03, 0.02)
    commands = np.sin(0.05 * np.arange(steps))[None, :, None]

    def robot(torque, rate):
        return RigidEngine([arm(torque, rate, stops, -1.0 * side, swings=3.0)], Physics(STEP), threads=1)

    def last(torque, rate):
        return robot(torque, rate).run(steps, commands=commands).angles[0, 0]

    given = torque, 0.4 * side
    tape = robot(*given).record(steps, commands=commands)
    found = tape.pull_back(angles=np.ones((1, 1))).parameters[0, 1, [slots.TORQUE, slots.OFFSET]]
    for number, slope in enumerate(found):
        ahead, behind = (np.add(given, sign * change * np.eye(2)[number]) for sign in (1, -1))
        assert slope == pytest.approx((last(*ahead) - last(*behind)) / (2 * change), rel=1e-5, abs=1e-9)
    visited = robot(*given).run(steps, commands=commands, record_every=1).frames.angles.reshape(-1)
    assert (side * visited <= -0.02).sum() > 10


def crawler(rng):
    """A floating chain of six bodies; its five hinges have narrow stops, and motors from weak to far too strong."""
    names = ["base", *(f"limb {n}" for n in range(5))]
    bodies = [Body(name, (0.2 * n, 0.0, 0.1), 0.3, [Capsule(0.05, 0.1, (1, 0, 0))]) for n, name in enumerate(names)]
    hinges = []
    for n in range(5):
        axis = rng.normal(size=3)
        motor = Motor(10.0 ** rng.uniform(-1, 3) * (rng.random() < 0.8), rng.uniform(1, 20))  # some have no torque
        stops = -rng.uniform(0.01, 0.6), rng.uniform(0.01, 0.6)
        hinges.append(Hinge(names[n], names[n + 1], (0.2 * n + 0.1, 0.0, 0.1), tuple(axis), motor, n, stops))
    return Tree(tuple(bodies), tuple(hinges))


@pytest.mark.parametrize("step", [2e-3, 1e-2, 5e-2])
def test_a_start_beyond_a_stop_leads_back_without_haste(step):
    """At most at ten times the way a second, however short the steps: it flew to the other stop at 120 rad/s."""
    engine = RigidEngine([arm(0.0, 0.0, (-0.3, 0.3))], Physics(step, gravity=0.0), threads=1)
    start = replace(engine.rest(), angles=np.full((1, 1), 1.5))
    found = engine.run(round(0.1 / step), start=start, record_every=1).frames.angles.reshape(-1)
    rates = np.diff(found, prepend=1.5) / step
    assert rates.min() > -10 * 1.2 - 1e-9 and found[-1] < 1.1


def shaken(trees, step, friction, commands, **how):
    """Chains whose motors want another rate every 0.15 s, for 1.5 s."""
    engine = RigidEngine(trees, Physics(step, friction=friction), threads=1, **how)
    return engine.run(round(1.5 / step), commands=commands, hold=round(0.15 / step), record_every=1)


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("friction", [0.8, np.inf])
@pytest.mark.parametrize("step", [0.005, 0.02, 0.05])
def test_chains_on_the_ground_stay_within_their_stops(step, friction, precision):
    """Several hinges at stops at once, motors that shake the chain; in f64 every step is solved."""
    for seed in (3, 7, 11):
        rng = np.random.default_rng(seed)
        trees = [crawler(rng) for _ in range(48)]
        run = shaken(trees, step, friction, rng.choice([-1.0, 0.3, 1.0], (48, 10, 5)), precision=precision)
        assert (run.status == "ok").all()
        assert (run.residual == 0).all() if precision == "f64" else (run.residual > 0).mean() < 0.1
        stops = np.array([[hinge.stops for hinge in tree.hinges] for tree in trees])
        frames, slip = run.frames.angles, 1e-9 if precision == "f64" else 2e-5
        assert (frames >= stops[..., 0] - slip).all() and (frames <= stops[..., 1] + slip).all()
        assert ((frames <= stops[..., 0] + slip) | (frames >= stops[..., 1] - slip)).mean() > 0.1


@pytest.mark.parametrize("friction", [0.8, np.inf])
def test_a_chain_between_stops_moves_as_it_does_alone(friction):
    """To the last bit, however long others of its batch take to be solved, and whether they touch the ground or not."""
    rng = np.random.default_rng(23)
    trees = [crawler(rng) for _ in range(16)]
    commands = rng.choice([-1.0, 0.3, 1.0], (16, 10, 5))
    together, alone = (shaken(trees, 0.02, friction, commands, **how) for how in ({}, {"width": 1}))
    assert np.array_equal(together.frames.angles, alone.frames.angles)
    assert np.array_equal(together.residual, alone.residual)
