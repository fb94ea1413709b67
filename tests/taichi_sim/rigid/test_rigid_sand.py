"""Rigid robots on sand: closed forms of what sinks, stands, comes out and is dragged, energy, batches, gradients."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from rigid_differences import error_of_gradient
from rigid_oracle import Oracle
from rigid_walkers import swinging
from rigid_walkers import walker as two_legged
from scipy.integrate import quad
from scipy.optimize import brentq

from robots.quadruped import LEGGED
from taichi_sim.ground import Relief
from taichi_sim.ground.relief import Water
from taichi_sim.rigid import Body, Box, Capsule, Physics, RigidEngine, Sphere, State, Tree
from taichi_sim.rigid.pose import rotation_matrix

pytestmark = pytest.mark.kernels

GRAVITY, YIELD, DRAGGED = 9.81, 2e5, 0.37
HERE = {"precision": "f64", "threads": 1}
BOTH = [pytest.param("momentum"), pytest.param("velocity", marks=pytest.mark.slow)]
SIDES = (0.2, 0.1, 0.1)
walker = partial(two_legged, lean=0.3)
AREA, MASS = SIDES[0] * SIDES[1], 4.0
BORNE = MASS * GRAVITY / (YIELD * AREA)  # m: how deep the box is where the sand bears it


def sand(limit: float | None = YIELD, **more) -> Relief:
    return Relief(np.zeros((2, 2)), 1.0, (-0.5, -0.5), yield_per_depth=limit, **more)


def slope(limit: float | None) -> Relief:
    """Sand that goes down along x."""
    return Relief(np.array([[0.2, 0.2], [-0.2, -0.2]]), 4.0, (-2.0, -2.0), yield_per_depth=limit)


def one(solid, mass: float, height: float) -> Tree:
    return Tree([Body("it", (0.0, 0.0, height), mass, [solid])])


def box(depth: float = 0.0) -> Tree:
    return one(Box(SIDES), MASS, SIDES[2] / 2 - depth)


def engine_of(tree, ground=None, time_step: float = 1e-4, **world) -> RigidEngine:
    return RigidEngine(tree, Physics(time_step, **world), ground=sand() if ground is None else ground, **HERE)


def bearing_of_ball(radius: float):
    """Of depth, the integral of depth by cos^2 over its surface below."""

    def bears(depth: float) -> float:
        c = 1 - depth / radius
        return math.pi * radius**3 / 6 * (3 - 4 * c + max(c, 0) ** 4)

    return bears


@pytest.mark.parametrize("integration", BOTH)
def test_a_box_that_is_let_go_sinks_to_twice_the_depth_at_which_it_is_borne(integration):
    """And stays there, level."""
    done = engine_of(box(), integration=integration).run(3000, record_every=1)
    depths = SIDES[2] / 2 - done.frames.position[:, 0, 2]
    assert depths[-1] == pytest.approx(2 * BORNE, rel=1e-3)
    assert (np.diff(depths) > -1e-12).all() and np.ptp(depths[-1000:]) < 1e-8
    assert done.orientation[0] == pytest.approx([1, 0, 0, 0], abs=1e-12) and done.residual[0] == 0


@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_a_ball_that_is_let_go_sinks_until_the_sand_has_done_its_work(mass):
    """To less than its radius and to more."""
    radius = 0.05
    bears = bearing_of_ball(radius)
    depth = brentq(lambda d: mass * GRAVITY * d - YIELD * quad(bears, 0, d, points=[min(d, radius)])[0], 1e-3, 1)
    done = engine_of(one(Sphere(radius), mass, radius), friction=0.5).run(3000)
    assert radius - done.position[0, 2] == pytest.approx(depth, rel=1e-3)


def test_what_stands_deep_enough_stays_and_what_does_not_sinks_as_far_beyond():
    """About the depth at which it is borne; the ground of neither pushes out."""
    depths = BORNE * np.array([0.8, 0.95, 1.001, 3.0])
    done = engine_of([box(depth) for depth in depths], friction=0.5).run(2000)
    found = SIDES[2] / 2 - done.position[:, 2]
    assert found == pytest.approx([1.2 * BORNE, 1.05 * BORNE, *depths[2:]], rel=1e-3)
    assert found[2:] == pytest.approx(depths[2:], abs=1e-7)


def test_withdrawal_is_free():
    """What is thrown up from within the sand rises as in the air."""
    thrown = replace(engine_of(box(2 * BORNE)).rest(), velocity=np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.3]]))
    for ground in (sand(), sand(1.0)):
        done = engine_of(box(2 * BORNE), ground).run(200, start=thrown)
        assert done.velocities[0, 0, 5] == pytest.approx(0.3 - GRAVITY * 0.02, abs=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("integration", BOTH)
def test_a_box_that_is_dragged_ploughs_with_the_closed_form(friction, integration):
    """0.37 YIELD W d^2 / 2, beside Coulomb's friction of its weight: it is pulled by gravity with so much more."""
    depth, surplus, steps = 2 * BORNE, 3.0, 500
    hold = DRAGGED * YIELD * SIDES[1] * depth**2 / 2 + friction * MASS * GRAVITY
    world = {"gravity_across": (hold / MASS + surplus, 0.0), "friction": friction, "integration": integration}
    done = engine_of(box(depth), **world).run(steps)
    assert done.velocities[0, 0, 3] == pytest.approx(surplus * steps * 1e-4, rel=1e-6)
    assert done.position[0, 2] == pytest.approx(SIDES[2] / 2 - depth, abs=1e-9)
    world["gravity_across"] = (0.9 * hold / MASS, 0.0)
    held = engine_of(box(depth), **world).run(steps)
    assert abs(held.velocities[0, 0, 3]) < 1e-3  # it creeps


def test_ploughing_acts_at_any_heading_and_on_any_slope():
    """A ball's is the same on each, against its motion, and joins what it has of friction."""
    radius, mass, depth, speed = 0.05, 1.0, 0.04, 0.3
    s = depth / radius
    ploughs = DRAGGED * YIELD * math.pi * radius**3 / 24 * s**3 * (4 - s)
    for ground, tilt in ((sand(), 0.0), (slope(YIELD), math.atan(0.1))):
        normal = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
        along = np.array([math.cos(tilt), 0.0, -math.sin(tilt)])
        for heading in (along, np.array([0.0, 1.0, 0.0])):
            engine = engine_of(one(Sphere(radius), mass, 1.0), ground, 1e-5, gravity=0.0, friction=0.0)
            start = replace(engine.rest(), position=(normal * (radius - depth))[None])
            start = replace(start, velocity=np.concatenate([np.zeros(3), speed * heading])[None])
            slowed = engine.run(10, start=start).velocities[0, 0, 3:]
            expected = (speed - 1e-4 * ploughs / mass) * heading
            assert slowed == pytest.approx(expected, abs=1e-4 * ploughs / mass * 1e-2)


def test_hard_sand_is_firm_ground_that_does_not_push_out():
    """Of a walker that falls, lands and walks, for 30 steps; later, as its corners land, to a tenth of a millimetre."""
    commands, world = swinging(30), {"time_step": 5e-3, "error_reduction": 0.0}
    firm, hard = (
        engine_of(walker(), ground, **world).run(30, commands=commands, hold=10) for ground in (sand(None), sand(1e12))
    )
    assert firm.position == pytest.approx(hard.position, abs=1e-9) and firm.angles == pytest.approx(
        hard.angles, abs=1e-9
    )


@pytest.mark.parametrize("integration", BOTH)
@pytest.mark.parametrize("friction", [0.0, 0.6, math.inf])
@pytest.mark.parametrize(
    "solid", [Sphere(0.1), Box((0.3, 0.2, 0.1)), Capsule(0.05, 0.3)], ids=["ball", "box", "capsule"]
)
def test_sand_never_gives_energy(solid, friction, integration):
    """To what is thrown onto it, turning."""
    tree = one(solid, 3.0, 0.25)
    engine = engine_of(tree, sand(5e4), 5e-4, friction=friction, integration=integration)
    session = engine.session(start=replace(engine.rest(), velocity=np.array([[2.0, 3.0, 1.0, 0.6, 0.2, -1.0]])))
    energies = []
    for _ in range(400):
        done = session.advance(steps=2)
        spin, velocity = done.velocities[0, 0, :3], done.velocities[0, 0, 3:]
        local = rotation_matrix(done.orientation)[0].T @ spin
        turning = local @ np.asarray(tree.bodies[0].inertia) @ local
        energies.append(0.5 * (3.0 * velocity @ velocity + turning) + 3.0 * GRAVITY * done.position[0, 2])
        assert done.residual[0] == 0
    excess = np.array(energies) - np.minimum.accumulate(energies)
    assert excess.max() < 1e-3 * energies[0] and energies[-1] < 0.5 * energies[0]


@pytest.mark.parametrize("limit", [2e4, 2e5])
@pytest.mark.parametrize(("friction", "tolerance"), [(math.inf, 1e-10), (0.4, 1e-6)])
@pytest.mark.parametrize("integration", BOTH)
def test_the_engine_is_its_dense_oracle_on_sand(friction, tolerance, limit, integration):
    """Walkers that are thrown onto it, turning, with changing commands."""
    rng, tree = np.random.default_rng(5), walker()
    world = Physics(5e-3, slip=1e-2, friction=friction, integration=integration)
    engine = RigidEngine(tree, world, ground=sand(limit), **HERE)
    for _ in range(2):
        turn = rng.normal(size=(1, 4)) * [3, 1, 1, 1]
        start = State(
            np.array([[0.0, 0.0, 0.3]]),
            turn / np.linalg.norm(turn),
            rng.uniform(-0.5, 0.5, (1, 2)),
            rng.normal(size=(1, 6)),
            rng.normal(size=(1, 2)),
        )
        commands = rng.uniform(-1, 1, (60, 2))
        done = engine.run(60, commands=commands[None], start=start, record_every=1)
        oracle, worst = Oracle(tree, world, start, limit), 0.0
        for step in range(61):
            ours = np.append(done.frames.position[step, 0], done.frames.angles[step, 0])
            worst = max(worst, np.abs(ours - np.append(oracle.position, oracle.angles)).max())
            oracle.step(commands[min(step, 59)])
        assert worst < tolerance and done.residual[0] == 0 and oracle.saturated > 10


def test_all_normals_are_solved_where_many_points_share_few_bodies():
    """Of quadrupeds of 24 points that are thrown onto soft sand; pivoting does not end there."""
    rng, tree, count = np.random.default_rng(1), LEGGED.tree(), 8
    turn = rng.normal(size=(count, 4))
    start = State(
        np.tile([0, 0, 0.8], (count, 1)),
        turn / np.linalg.norm(turn, axis=1)[:, None],
        rng.uniform(-0.7, 0.7, (count, 8)),
        rng.normal(size=(count, 6)),
        rng.normal(size=(count, 8)),
    )
    engine = RigidEngine(tree, Physics(0.02, friction=0.5), ground=sand(1e4), **HERE)
    done = engine.run(100, commands=rng.uniform(-1, 1, (count, 50, 8)), hold=2, start=start)
    assert (done.status == "ok").all() and (done.residual == 0).all()


@pytest.mark.parametrize("ground", [sand(2e4), slope(2e4)], ids=["level", "slope"])
@pytest.mark.parametrize(
    ("part", "integration"),
    [
        *((part, "momentum") for part in ("commands", "position", "orientation", "angles")),
        *(pytest.param(part, "velocity", marks=pytest.mark.slow) for part in ("commands", "position")),
    ],
)
def test_gradients_agree_with_differences(part, ground, integration):
    """Of a walker that falls onto sand and sinks in, its motors at their limits: through the touching down, too."""
    steps = 200
    engine = engine_of(walker(), ground, 5e-3, integration=integration)
    assert error_of_gradient(engine, part, steps, swinging(steps), (1e-6, 1e-7)) < 1e-6


@pytest.mark.parametrize(
    ("tree_of", "value"),
    [
        (walker, 0.06),
        (lambda size: one(Box((size, 0.2, 0.1)), 3.0, 0.05), 0.3),
        (lambda size: one(Box((0.5, 0.2, size)), 3.0, 0.06), 0.1),
        (lambda size: one(Capsule(0.05, size, (1.0, 0.0, 0.2)), 3.0, 0.1), 0.25),
        (lambda mass: one(Capsule(0.06, 0.3, (1.0, 0.0, 0.4)), mass, 0.1), 2.0),
    ],
    ids=["radius", "size", "height", "length", "mass"],
)
def test_gradients_by_a_design_agree_with_differences(tree_of, value):
    """Through surfaces and masses."""
    aim, step, steps = np.array([[1.0, -0.5, 2.0]]), 1e-6, 150
    commands = swinging(steps)[..., : tree_of(value).motors]

    def engine(size: float) -> RigidEngine:
        return engine_of(tree_of(size), sand(3e4), 5e-3)

    tape = engine(value).record(steps, commands=commands, hold=10)
    (found,) = tape.pull_back(position=aim).by_design(tree_of, value)
    high, low = (engine(value + x).run(steps, commands=commands, hold=10).position @ aim[0] for x in (step, -step))
    assert found == pytest.approx((high - low)[0] / (2 * step), rel=1e-6)


def results(engine, **more):
    done = engine.run(100, commands=swinging(100), hold=10, **more)
    return [getattr(done, part) for part in ("position", "orientation", "angles", "velocities", "residual")]


@pytest.mark.parametrize("friction", [0.5, math.inf])
def test_robots_of_a_batch_are_on_grounds_of_their_own(friction):
    """Firm ones, too, as each is alone, to the bit, whatever the width."""
    grounds = [sand(2e4), sand(None), sand(2e5), replace(slope(None), spacing=1.0), slope(3e4)]
    grounds = [replace(each, spacing=1.0) for each in grounds]
    alone = [results(engine_of(walker(), each, 5e-3, friction=friction)) for each in grounds]
    assert len({found[0][0, 2] for found in alone}) == len(grounds)
    for width in (None, 1, 4):
        engine = RigidEngine(walker(), Physics(5e-3, friction=friction), ground=grounds, width=width, **HERE)
        for part, *each in zip(results(engine), *alone, strict=True):
            assert np.array_equal(part, np.concatenate(each))


@pytest.mark.slow
def test_firm_robots_whose_pivots_are_used_up_have_no_more_beside_one_on_sand():
    """Bodies of 80 points in f32, which do not converge in the rounds that there are: they go on as they do alone."""
    count, rng = 64, np.random.default_rng(3)
    solids = [Box((0.1, 0.1, 0.1), (0.12 * i - 0.24, 0.12 * j - 0.06, 0)) for i in range(5) for j in range(2)]
    trees = [Tree([Body("it", (0, 0, 0.2), 3.0, solids, np.diag([0.03, 0.05, 0.06]))])] * count
    orientation = rng.normal(size=(count, 4)) * [3, 1, 1, 1]
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    thrown = {"orientation": orientation, "velocity": rng.normal(size=(count, 6))}

    def runs(grounds):
        engine = RigidEngine(trees, Physics(5e-3, friction=0.3, slip=1e-2), ground=grounds, precision="f32", threads=1)
        return engine.run(200, start=replace(engine.rest(), **thrown))

    alone, beside = runs([sand(None)] * count), runs([sand(None)] * (count - 1) + [sand(YIELD)])
    assert (alone.residual > 1e-3).any() and np.array_equal(alone.residual > 1e-3, beside.residual > 1e-3)
    for name in ("position", "orientation", "velocities"):
        assert np.array_equal(getattr(alone, name)[:-1], getattr(beside, name)[:-1]), name


def test_gradients_of_a_mixed_batch_are_those_that_robots_have_alone():
    """To the bit."""
    grounds = [sand(2e4), sand(None), sand(2e5)]

    def gradient(ground):
        tape = engine_of(walker(), ground, 5e-3).record(60, commands=swinging(60), hold=10)
        count = len(tape.result.position)
        return tape.pull_back(position=np.tile([1.0, 2.0, 3.0], (count, 1)))

    together, alone = gradient(grounds), [gradient(each) for each in grounds]
    for name in ("commands", "points", "masses", "orientation", "carried"):
        assert np.array_equal(getattr(together, name), np.concatenate([getattr(each, name) for each in alone])), name


def test_robots_sink_into_sand_under_water():
    """The box that floats not is lighter by what it displaces, and so sinks less."""
    wet = sand(water=Water(10.0, added_mass=0.0))
    engine = engine_of(box(), wet, pressure_drag=0.0, friction_drag=0.0)
    lighter = 1 - 1000.0 * np.prod(SIDES) / MASS
    assert SIDES[2] / 2 - engine.run(3000).position[0, 2] == pytest.approx(2 * BORNE * lighter, rel=1e-3)


@pytest.mark.slow
def test_single_precision_agrees():
    found = []
    for precision in ("f64", "f32"):
        engine = RigidEngine(walker(), Physics(5e-3, friction=0.5), ground=sand(2e4), precision=precision, threads=1)
        found.append(engine.run(100, commands=swinging(100), hold=10).position)
    assert np.abs(found[0] - found[1]).max() < 1e-3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sand(0.0), "yield_per_depth: 0"),
        (lambda: sand(1e13), "yield_per_depth: 10000000000000.0 is not allowed"),
        (
            lambda: engine_of(walker(), friction=0.5).record(1, commands=swinging(10)),
            "friction: 0.5 has no derivatives",
        ),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()
