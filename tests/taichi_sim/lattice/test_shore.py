"""Water and granular ground: closed forms, what a step gives back, and gradients."""

from dataclasses import replace

import numpy as np
import pytest
from gradient_scene import TIME_STEP, Cost, body, program, repeated, start

from taichi_sim.ground.laws import FIRM, leading_share, outer_share, slid, without_friction
from taichi_sim.ground.relief import Water
from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity, Relief
from taichi_sim.lattice.faces import rotate
from taichi_sim.lattice.laws.fluid import displaced_volumes

pytestmark = pytest.mark.kernels

EDGE, GRAVITY, DENSITY = 0.01, 9.80665, 1000.0
DEEP = -0.3  # m: ground far below
YIELD = 2e5  # N/m^3


def ground(height: float = 0.0, **options) -> Relief:
    return Relief(np.full((2, 2), height), 1.0, (-0.5, -0.5), **options)


def block(density: float, shape=(4, 4, 4), hollow: bool = False, edge: float = EDGE, **options) -> LatticeBody:
    filled = np.ones(shape, bool)
    if hollow:
        filled[1:-1, 1:-1, 1:-1] = False
    voxels = np.argwhere(filled)
    stiff = Material(2e5, density, **options)
    return LatticeBody(voxels=voxels, materials=(stiff,), material_index=[0] * len(voxels), voxel_size=edge)


def dropped(shape: LatticeBody, floor: Relief, height: float = 0.0, **options) -> LatticeEngine:
    """At rest, so far above the floor."""
    engine = LatticeEngine(shape, floor=floor, gravity=GRAVITY, **options)
    engine.set_positions(engine.state().positions + np.array([0, 0, height]))
    return engine


def drive(engine: LatticeEngine, steps: int, **values: float) -> None:
    """Let channels of all voxels have values for so many steps."""
    builder = ProgramBuilder(1)
    for name, value in values.items():
        quantity = Quantity.FORCE + 2 if name == "LIFT" else Quantity[name]
        builder.set(quantity, value, regions=[0])
    assert engine.run(builder.build(steps)).status.tolist() == ["ok"]


def lowest(engine: LatticeEngine) -> float:
    """Height of the lower side above the floor [m]."""
    return float(engine.state().positions[0, :, 2].min())


# water


@pytest.mark.parametrize("hollow", [False, True])
def test_a_block_floats_as_archimedes_says(hollow):
    """Until it displaces its mass; walls displace, in shares, what they close off."""
    shape = block(500.0, (6, 6, 3), hollow)
    engine = dropped(shape, ground(DEEP, water=Water(0.0)), -0.03)
    drive(engine, 6000, RESISTANCE=2000.0, GLOBAL_DAMPING=0.01)
    displaced = displaced_volumes(shape.voxels)
    layers = [displaced[shape.voxels[:, 2] == layer].sum() for layer in range(3)]
    assert sum(layers) == pytest.approx(108)
    draught = EDGE * np.interp(0.5 * shape.voxel_count, np.cumsum([0.0, *layers]), range(4))
    assert lowest(engine) == pytest.approx(-draught, abs=2e-4)


@pytest.mark.parametrize("added", [0.0, 0.5])
def test_a_light_block_rises_as_its_mass_and_the_water_s_let_it(added):
    """(rho_w - rho) g / (rho + C rho_w) under water, g downwards above."""
    engine = dropped(block(400.0), ground(DEEP, water=Water(0.2, added_mass=added)))
    first = engine.state().positions.mean(axis=1)[0, 2]
    steps = 100
    drive(engine, steps)
    time = steps * engine.time_step
    expected = (DENSITY - 400.0) * GRAVITY / (400.0 + added * DENSITY)
    moved = engine.state().positions.mean(axis=1)[0, 2] - first
    assert moved == pytest.approx(0.5 * expected * time**2, rel=0.02)
    above = dropped(block(400.0), ground(DEEP, water=Water(-0.2, added_mass=added)))
    drive(above, steps)
    fallen = above.state().positions.mean(axis=1)[0, 2] - first
    assert fallen == pytest.approx(-0.5 * GRAVITY * time**2, rel=0.02)


def test_water_that_is_not_there_leaves_a_robot_as_on_dry_ground():
    """Below the ground, up to how links are balanced where bodies may float."""
    found = []
    for water in (None, Water(-0.1)):
        engine = dropped(block(1000.0), ground(0.0, water=water), 0.002, time_step=8e-5)
        drive(engine, 300)
        found.append(engine.state().positions)
    assert np.allclose(*found, rtol=0, atol=1e-9)


# granular ground


def test_a_block_that_is_let_go_sinks_until_its_weight_s_work_is_spent():
    """To twice the depth at which the ground bears it: W d = k A d^2 / 2; and there it stays."""
    shape = block(1000.0, (4, 4, 2))
    engine = dropped(shape, ground(yield_per_depth=YIELD))
    drive(engine, 4000)
    depth = -lowest(engine)
    stress = 1000.0 * GRAVITY * 2 * EDGE
    assert depth == pytest.approx(2 * stress / YIELD, rel=0.1)
    drive(engine, 4000)
    assert -lowest(engine) == pytest.approx(depth, abs=1e-7)


def test_what_was_pressed_stays_pressed():
    """A block that is lifted out of its print and comes back bears on the ground where it had left it."""
    engine = dropped(block(1000.0, (4, 4, 2)), ground(yield_per_depth=YIELD))
    drive(engine, 3000)
    depth = -lowest(engine)
    drive(engine, 20, LIFT=3e-2)
    drive(engine, 3000, LIFT=0.0)
    assert -lowest(engine) == pytest.approx(depth, abs=0.2 * depth)


def test_firm_ground_is_that_which_never_yields():
    """Up to ploughing."""
    found = []
    for limit in (None, 1e9):
        engine = dropped(block(1000.0), ground(yield_per_depth=limit))
        drive(engine, 3000)
        found.append(engine.state().positions)
    assert np.allclose(*found, rtol=0, atol=2e-6)


@pytest.mark.parametrize(("share", "moves"), [(0.8, False), (1.3, True)])
def test_it_takes_friction_and_ploughing_to_move_a_block(share, moves):
    """Sideways it holds by kinetic friction times its weight, and 0.37 of the stress on what is buried."""
    shape = block(1000.0, (4, 4, 2), static_friction=0.9, kinetic_friction=0.3)
    engine = dropped(shape, ground(yield_per_depth=YIELD))
    drive(engine, 4000)
    depth, before = -lowest(engine), engine.state().positions.mean(axis=1)[0, 0]
    weight, ahead = 1000.0 * GRAVITY * EDGE**3 * 32, 4
    holds = 0.3 * weight + ahead * 0.5 * 0.37 * YIELD * EDGE * depth**2
    drive(engine, 1500, FORCE=share * holds / shape.voxel_count)
    moved = engine.state().positions.mean(axis=1)[0, 0] - before
    assert (moved > 1e-3) == moves


@pytest.mark.parametrize("parts", [1, 2, 4])
def test_a_block_ploughs_alike_however_fine_its_voxels_are(parts):
    """It sinks to twice the depth at which its lower side bears it, and its leading sides plough as the law says.

    Aslant, two sides of half the stress each do. At the finest, two layers of voxels are below the surface.
    """
    width, height, limit, friction = 0.04, 0.02, 4e4, 0.05
    shape = block(1000.0, (2 * parts, 2 * parts, parts), edge=0.02 / parts, kinetic_friction=friction)
    mass, found = 1000.0 * width**2 * height, []
    for way in (np.array([1.0, 0.0]), np.array([0.0, -1.0]), np.array([0.6, 0.8])):
        engine = dropped(shape, ground(yield_per_depth=limit), time_step=shape.recommended_time_step / 1.3)
        drive(engine, round(0.6 / engine.time_step))
        depth = (shape.start_positions - engine.state().positions[0])[:, 2].mean()
        builder, force, steps = ProgramBuilder(1), 0.2, round(0.02 / engine.time_step)
        for axis in range(2):
            builder.set(Quantity.FORCE + axis, force * way[axis] / shape.voxel_count, regions=[0])
        engine.run(builder.build(steps))
        gained = mass * engine.state().velocities[0, :, :2].mean(axis=0) / (steps * engine.time_step)
        assert abs(gained @ [-way[1], way[0]]) < 1e-2 * force
        found.append((depth, force - gained @ way - friction * mass * GRAVITY))
    depths, ploughing = np.array(found).T
    assert depths == pytest.approx(2 * 1000.0 * GRAVITY * height / limit, rel=0.02)
    assert ploughing == pytest.approx(0.5 * 0.37 * limit * width * depths**2, rel=0.02)


def test_outer_faces_alone_lead():
    """By the square of how straight ahead they look: of a voxel alone always as much, of one inside nothing."""
    turn = np.random.default_rng(2).normal(size=4)
    turn /= np.linalg.norm(turn)
    ahead = rotate(turn, np.array([1.0, 0.0, 0.0]))
    assert outer_share(*turn, *ahead, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0) == pytest.approx(1)
    assert outer_share(*turn, *ahead, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) == 0
    assert outer_share(*turn, *ahead, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0) == pytest.approx(1)
    assert outer_share(*turn, *ahead, 1.0, 1.0, 0.0, -1.0, 1.0, 0.0) == pytest.approx(0)
    aslant = rotate(turn, np.array([0.6, 0.0, -0.8]))
    assert outer_share(*turn, *aslant, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0) == pytest.approx(0.36)
    assert leading_share(0.0, 0.0, *turn, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0) == 0


def test_friction_on_sand_is_undone_by_its_inverse():
    """Of slipping voxels the momentum before friction is found again; of those that it stops none is left."""
    q, impulse = np.array([[3e-5, -2e-5], [1e-5, 1e-6], [-4e-6, 7e-5]]).T, np.array([1e-5, 2e-5, 6.9e-5])
    px, py, stuck = slid(q[0], q[1], 0.0 * impulse, q[0], q[1], impulse, YIELD)
    assert stuck.tolist() == [0, 1, 0] and px[1] == py[1] == 0
    assert np.hypot(px, py) == pytest.approx(np.maximum(np.hypot(*q) - impulse, 0), rel=1e-12)
    found = np.array(without_friction(px, py, impulse))
    assert np.allclose(found[:, [0, 2]], q[:, [0, 2]], rtol=1e-11, atol=0) and not found[:, 1].any()
    firm = slid(q[0], q[1], 0.0 * impulse, 9 * q[0], q[1], impulse, FIRM)
    assert np.array_equal(firm[0], q[0]) and np.array_equal(firm[1], q[1])


@pytest.mark.parametrize("spin", [0.0, 15.0])
def test_granular_ground_gives_no_energy(spin):
    """A block that is thrown onto it, so that it tumbles, loses height and speed only, and comes to rest."""
    engine = dropped(block(1000.0), ground(yield_per_depth=YIELD), 0.01)
    at, turning = engine.state(), np.array([0.3 * spin, spin, 0.5 * spin])
    thrown = np.cross(turning, at.positions - at.positions.mean(axis=1, keepdims=True)) + np.array([0.5, 0.1, 0.0])
    engine.set_state(replace(at, velocities=thrown, angular_velocities=0 * thrown + turning))
    energies = []
    for _ in range(40):
        now = engine.state()
        moving = 0.5 * (now.velocities**2).sum(axis=2).mean()
        moving += EDGE**2 / 12 * (now.angular_velocities**2).sum(axis=2).mean()
        energies.append(moving + GRAVITY * now.positions[..., 2].mean())
        drive(engine, 150)
    assert (np.diff(energies) < 1e-3 * np.ptp(energies)).all()
    assert np.abs(engine.state().velocities).max() < 1e-3


# both


def shore(seed: int = 3) -> Relief:
    """Bumps that yield, half under water."""
    rng = np.random.default_rng(seed)
    heights = 4e-4 * rng.standard_normal((60, 60))
    return Relief(heights, 0.005, (-0.1, -0.1), rng.uniform(0.7, 1.3, heights.shape), Water(0.006), 1e6)


def on_the_shore(batch: int = 1, floor: Relief | None = None, **options) -> LatticeEngine:
    """The eventful scene of the gradients' tests."""
    return LatticeEngine(body(pouch=True), batch, time_step=TIME_STEP, floor=floor or shore(), **options)


def deep_sand(seed: int = 3) -> Relief:
    """Bumps that yield, with the lower layer of voxels and half of the next one in them."""
    heights = 0.014 + 4e-4 * np.random.default_rng(seed).standard_normal((60, 60))
    return Relief(heights, 0.005, (-0.1, -0.1), yield_per_depth=2e5)


@pytest.mark.parametrize(
    ("part", "floor"),
    [
        pytest.param("positions", shore, marks=pytest.mark.slow),
        pytest.param("velocities", shore, marks=pytest.mark.slow),
        ("values", shore),
        ("velocities", deep_sand),
    ],
)
def test_gradients(part, floor):
    """By the start and by what events set, against central differences, with everything that happens on a shore."""
    shape, cost = body(pouch=True), Cost(body(pouch=True), 3, sizes=True)
    single = on_the_shore(floor=floor())
    single.set_state(repeated(start(shape), 1))
    found = getattr(cost.pull_back(single.record(program())), part)
    first = program().events["value"] if part == "values" else getattr(start(shape), part)
    scale = {"positions": 1e-3, "velocities": 0.1, "values": 0.3 * np.abs(first)}[part]
    directions = scale * np.random.default_rng(4).normal(size=(12, *first.shape))
    engine, errors = on_the_shore(24, floor()), []
    for step in (3e-5, 3e-6, 3e-7):
        moves = step * np.concatenate([directions, -directions])
        engine.reset()
        given, played = repeated(start(shape), 24), program(24)
        if part == "values":
            events = played.events.copy()
            for robot, move in enumerate(moves):
                events["value"][events["robot"] == robot] += move
            played = replace(played, events=events)
        else:
            given = replace(given, **{part: first + moves})
        engine.set_state(given)
        values = cost.of(engine, engine.run(played))
        expected = (values[:12] - values[12:]) / (2 * step)
        along = (directions * np.asarray(found).reshape(first.shape)).reshape(12, -1).sum(axis=1)
        errors.append(np.linalg.norm(along - expected) / np.linalg.norm(expected))
    assert min(errors) <= 1e-6, errors


def test_drivers_agree():
    """Forwards to the last bit; gradients up to the order of sums."""
    found, ends = [], []
    for driver in ("packed", "stepped"):
        engine = on_the_shore(driver=driver)
        engine.set_state(repeated(start(body(pouch=True)), 1))
        found.append(Cost(body(pouch=True), 3).pull_back(engine.record(program())))
        ends.append(engine.state().positions)
    assert np.array_equal(*ends)
    for part in ("positions", "velocities", "values"):
        a, b = (np.asarray(getattr(each, part)) for each in found)
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(a).max())


@pytest.mark.parametrize(
    "grounds",
    [
        [ground(water=Water(0.02)), ground(water=Water(0.0, 1200.0))],
        [ground(yield_per_depth=YIELD), ground(yield_per_depth=3e5), ground()],
    ],
)
def test_robots_of_a_batch_have_water_and_ground_of_their_own(grounds):
    """Each moves as it does alone, to the bit, on firm ground beside others, too."""
    engine = LatticeEngine(block(800.0), len(grounds), floor=grounds, gravity=GRAVITY)
    engine.run(ProgramBuilder(len(grounds)).build(800))
    for number, floor in enumerate(grounds):
        alone = LatticeEngine(block(800.0), floor=floor, gravity=GRAVITY)
        alone.run(ProgramBuilder(1).build(800))
        assert np.array_equal(alone.state().positions[0], engine.state().positions[number])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Water(float("nan")), "level: nan is not allowed"),
        (lambda: Water(0.0, density=0.0), "density: 0.0 is not allowed"),
        (lambda: Water(0.0, added_mass=-1.0), "added_mass: -1.0 is not allowed"),
        (lambda: ground(yield_per_depth=0.0), "yield_per_depth: 0.0 is not allowed"),
        (
            lambda: LatticeEngine(block(800.0), 2, floor=[ground(), ground(water=Water(0.0))]),
            "floor: water for some robots of a batch and none for others is not allowed",
        ),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()
