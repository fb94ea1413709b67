"""Uneven ground: the same as a plane where it is one, and its gradients."""

from dataclasses import replace

import numpy as np
import pytest
from gradient_scene import STEPS, TIME_STEP, Cost, body, program, repeated, start

from taichi_sim.ground.laws import ground, into_plane, out_of_plane
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, Material, ProgramBuilder, Quantity, Relief

pytestmark = pytest.mark.kernels

EDGE = 0.01
GRAVITY = 9.80665


def rough(seed: int = 0, height: float = 1e-3, nodes: int = 60, **options) -> Relief:
    """Bumps narrower than a voxel, with friction of their own."""
    rng = np.random.default_rng(seed)
    heights = height * rng.standard_normal((nodes, nodes))
    return Relief(heights, 0.005, (-0.1, -0.1), rng.uniform(0.7, 1.3, heights.shape), **options)


def level(height: float = 0.0) -> Relief:
    return Relief(np.full((2, 2), height), 1.0, (-0.5, -0.5))


def block(friction: tuple[float, float] = (1.0, 0.8), **options) -> LatticeBody:
    voxels = [(x, y, z) for x in range(5) for y in range(3) for z in range(2)]
    rubber = Material(1e5, 1e3, static_friction=friction[0], kinetic_friction=friction[1], **options)
    return LatticeBody(voxels=voxels, materials=(rubber,), material_index=[0] * len(voxels), voxel_size=EDGE)


def thrown(engine: LatticeEngine, height: float, velocity=(0.2, 0.05, 0.0)) -> None:
    """From so far above the ground, sideways."""
    at = engine.state()
    move = np.broadcast_to(velocity, at.velocities.shape)
    engine.set_state(replace(at, positions=at.positions + np.array([0, 0, height]), velocities=move.copy()))


def landed(floor, steps: int = 1500, **options) -> LatticeState:
    engine = LatticeEngine(block(), floor=floor, gravity=GRAVITY, **options)
    thrown(engine, 0.002)
    engine.run(ProgramBuilder(1).build(steps))
    return engine.state()


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_level_ground_has_the_bits_of_the_floor(driver, precision):
    """A grid of zeros, of many cells, too."""
    many = Relief(np.zeros((50, 40)), 0.004, (-0.05, -0.03), np.ones((50, 40)))
    floor = landed(True, driver=driver, precision=precision)
    for ground_given in (level(), many):
        found = landed(ground_given, driver=driver, precision=precision)
        for part in floor.__dataclass_fields__:
            assert np.array_equal(getattr(floor, part), getattr(found, part))


def test_drivers_agree_to_the_last_bit_on_rough_ground():
    """One robot's voxels in lanes, and a thread per link or voxel."""
    packed, stepped = (landed(rough(), driver=driver) for driver in ("packed", "stepped"))
    assert np.array_equal(packed.positions, stepped.positions)
    assert np.abs(packed.positions - landed(True).positions).max() > 1e-4


@pytest.mark.parametrize("degrees", [5.0, -12.0, 25.0])
def test_a_ramp_is_a_tilted_plane(degrees):
    """A body placed on a ramp and turned with it does what gravity that is tilted makes it do on the level floor."""
    slope, steps = np.radians(degrees), 2000
    turn = np.array([[np.cos(slope), 0, -np.sin(slope)], [0, 1, 0], [np.sin(slope), 0, np.cos(slope)]])
    down = np.array([0, 0, -GRAVITY])
    heights = np.tan(slope) * np.array([[-5.0, -5.0], [5.0, 5.0]])
    # The plane goes through the origin of the floor z = -h/2 whichever way it is tilted.
    pivot = np.array([0, 0, -EDGE / 2])
    found = []
    for floor, tilt in ((True, turn.T), (Relief(heights, 10.0, (-5.0, -5.0)), np.eye(3))):
        engine = LatticeEngine(block(), floor=floor, precision="f64")
        if floor is not True:
            at = engine.state()
            half = np.array([np.cos(slope / 2), 0, -np.sin(slope / 2), 0])
            places = (at.positions - pivot) @ turn.T + pivot
            engine.set_state(replace(at, positions=places, orientations=np.broadcast_to(half, at.orientations.shape)))
        builder = ProgramBuilder(1)
        for axis, value in enumerate(tilt @ down):
            builder.set(Quantity.ACCELERATION + axis, value, regions=0)
        engine.run(builder.build(steps))
        found.append(engine.state().positions[0])
    assert np.abs((found[1] - pivot) @ turn + pivot - found[0]).max() < 1e-6
    moved = found[0][:, 0].mean() - block().start_positions[:, 0].mean()
    assert (abs(degrees) > 20) or abs(moved) < 1e-3


def test_a_raised_floor_raises_the_robot():
    """By its height, and by nothing else."""
    floor, raised = landed(True), None
    engine = LatticeEngine(block(), floor=level(0.125), gravity=GRAVITY)
    thrown(engine, 0.127)
    engine.run(ProgramBuilder(1).build(1500))
    raised = engine.state()
    assert np.abs(raised.positions - floor.positions - [0, 0, 0.125]).max() < 1e-9


@pytest.mark.parametrize(("factor", "holds"), [(0.9, False), (1.1, True)])
def test_friction_of_the_ground_decides_whether_a_block_holds(factor, holds):
    """On a slope of 25 degrees with a coefficient of tan 25 times the factor."""
    slope = np.radians(25.0)
    ground_given = Relief(np.zeros((2, 2)), 1.0, (-0.5, -0.5), np.full((2, 2), factor))
    engine = LatticeEngine(block((np.tan(slope),) * 2, collision_damping=1.0), floor=ground_given)
    builder = ProgramBuilder(1)
    builder.set(Quantity.ACCELERATION + 2, -GRAVITY * np.cos(slope), regions=0)
    builder.set(Quantity.ACCELERATION, GRAVITY * np.sin(slope), regions=0, step=1000)
    engine.run(builder.build(1000))
    before = engine.state().positions[..., 0].mean()
    engine.run(ProgramBuilder(1).build(3000))
    slid = engine.state().positions[..., 0].mean() - before
    assert (slid < 1e-3) == holds


def test_resting_bodies_gain_no_energy_on_rough_ground():
    """A block that is dropped onto bumps comes to rest, and its energy never grows beyond what it fell from."""
    engine = LatticeEngine(block(), floor=rough(height=5e-4), gravity=GRAVITY)
    thrown(engine, 0.002, (0.1, 0.0, 0.0))
    mass = 1 / engine.inverse_masses[0, 0, 0]
    energies = []
    for _ in range(40):
        at = engine.state()
        kinetic = 0.5 * mass * (at.velocities**2).sum()
        energies.append(kinetic + mass * GRAVITY * at.positions[..., 2].sum())
        engine.run(ProgramBuilder(1).build(250))
    assert max(energies) <= energies[0] * (1 + 1e-9)
    assert np.abs(engine.state().velocities).max() < 5e-3


def test_a_plane_has_one_normal_beside_nodes_too():
    """Where a place is a rounding error before the node that it is found to be at, or behind it."""
    spacing, nodes = 0.01, 300
    heights = 0.3 * spacing * np.arange(nodes)[:, None] * np.ones((1, nodes))
    plane = Relief(heights, spacing, (-1.0 / 3, -0.7))
    at = -1.0 / 3 + spacing * np.arange(1, nodes - 1)
    for beside in (at, np.nextafter(at, -9), np.nextafter(at, 9), at - 3e-17, at - 2e-16):
        _, normals = plane.planes(beside, np.zeros_like(at))
        np.testing.assert_allclose(normals, np.tile(normals[5], (len(at), 1)), atol=1e-12)
    _, beyond = plane.planes(np.array([-1.0]), np.array([0.0]))
    assert beyond[0].tolist() == [0.0, 0.0, 1.0]


def test_the_normal_is_that_of_the_surface():
    """Against central differences of the height, and against nodes."""
    rng = np.random.default_rng(1)
    given = Relief(0.01 * rng.standard_normal((4, 5)), 0.02, (0.1, -0.2), rng.uniform(0.5, 2, (4, 5)))
    assert np.allclose(given.height(0.1 + 0.02 * 2, -0.2 + 0.02 * 3), given.heights[2, 3])
    cell = given.cells[1, 2]
    x, y = 0.1 + 0.02 * 1.3, -0.2 + 0.02 * 2.6
    corner = (0.1 + 0.02, -0.2 + 0.04)
    height, nx, ny, nz, _ = ground(x, y, *corner, *cell, 50.0)
    assert np.isclose(height, given.height(x, y))
    d = 1e-7
    rise = [
        (given.height(x + d, y) - given.height(x - d, y)) / 2 / d,
        (given.height(x, y + d) - given.height(x, y - d)) / 2 / d,
    ]
    assert np.allclose([-nx / nz, -ny / nz], rise, rtol=1e-6) and np.isclose(nx**2 + ny**2 + nz**2, 1)
    force = rng.normal(size=3)
    assert np.allclose(out_of_plane(*into_plane(*force, nx, ny, nz), nx, ny, nz), force)
    assert np.isclose(into_plane(*force, nx, ny, nz)[2], force @ [nx, ny, nz])


DIRECTIONS, TOLERANCE = 12, 1e-6


def on_bumps(batch: int = 1, **options) -> LatticeEngine:
    """The eventful scene of the gradients' tests, on bumps."""
    return LatticeEngine(body(), batch, time_step=TIME_STEP, floor=rough(3, 4e-4), **options)


@pytest.mark.parametrize("part", ["positions", "velocities"])
def test_gradients_by_the_start(part):
    """Against central differences, with contact, friction and slip."""
    shape, cost = body(), Cost(body(), 3, sizes=True)
    single = on_bumps()
    single.set_state(repeated(start(shape), 1))
    found = getattr(cost.pull_back(single.record(program())), part)
    first = getattr(start(shape), part)
    scale = {"positions": 1e-3, "velocities": 0.1}[part]
    directions = scale * np.random.default_rng(4).normal(size=(DIRECTIONS, *first.shape))
    engine, errors = on_bumps(2 * DIRECTIONS), []
    for step in (3e-5, 3e-6, 3e-7):
        moves = step * np.concatenate([directions, -directions])
        engine.reset()
        engine.set_state(replace(repeated(start(shape), 2 * DIRECTIONS), **{part: first + moves}))
        values = cost.of(engine, engine.run(program(2 * DIRECTIONS)))
        expected = (values[:DIRECTIONS] - values[DIRECTIONS:]) / (2 * step)
        errors.append(np.linalg.norm((directions * found).sum(axis=(1, 2)) - expected) / np.linalg.norm(expected))
    assert min(errors) <= TOLERANCE, errors


def test_gradients_of_every_driver():
    """They are the same, up to the order of sums."""
    found = []
    for driver in ("packed", "stepped"):
        engine = on_bumps(driver=driver)
        engine.set_state(repeated(start(body()), 1))
        found.append(Cost(body(), 3).pull_back(engine.record(program())))
    for part in ("positions", "velocities", "values"):
        a, b = (np.asarray(getattr(each, part)) for each in found)
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(a).max())
    assert STEPS == 200


def test_robots_of_a_batch_stand_on_ground_of_their_own():
    """As each does alone."""
    grounds = [rough(1), rough(2, nodes=40), Relief(np.zeros((3, 4)), 0.005, (-0.1, 0.2))]
    alone = [landed(each).positions[0] for each in grounds]
    engine = LatticeEngine(block(), 3, floor=grounds, gravity=GRAVITY)
    thrown(engine, 0.002)
    engine.run(ProgramBuilder(3).build(1500))
    assert np.array_equal(engine.state().positions, alone)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Relief([[0.0, np.nan], [0.0, 0.0]], 0.1), "heights: give a table of finite numbers"),
        (lambda: Relief([0.0, 1.0], 0.1), "heights: give a table of finite numbers"),
        (lambda: Relief([[0.0], [0.0]], 0.1), "heights: shape"),
        (lambda: Relief(np.zeros((2, 2)), 0.0), "spacing: 0.0"),
        (lambda: Relief([[0.0, 0.0], [1.0, 1.0]], 0.1), "heights: a slope of 84.3 degrees"),
        (lambda: Relief(np.zeros((2, 2)), 0.1, friction=-np.ones((2, 2))), "friction: -1 is not allowed; give factors"),
        (lambda: Relief(np.zeros((2, 2)), 0.1, friction=np.ones((2, 3))), r"friction: shape \(2, 3\) is not allowed"),
        (lambda: LatticeEngine(block(), 2, floor=[level()] * 3), "floor: 3 reliefs for a batch of 2"),
        (lambda: LatticeEngine(block(), 2, floor=[level(), rough()]), "floor: the spacing of nodes"),
        (lambda: LatticeEngine(block(), floor=level(), fluid=True), "floor: uneven ground is not allowed in a fluid"),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()
