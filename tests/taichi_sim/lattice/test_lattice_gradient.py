"""Exact gradients of the lattice against central differences of the forward engine."""

from dataclasses import replace

import numpy as np
import pytest
from gradient_scene import EVENTS, STEPS, TIME_STEP, Cost, body, program, repeated, start
from hypothesis import given
from hypothesis import strategies as st

from robots.inflatable import PUBLISHED, ROLLING, InflatableActuation, InflatableDesign
from robots.inflatable.program import build_program
from robots.world import Terrain
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeProgram, LatticeState, ProgramBuilder, Quantity
from taichi_sim.lattice.checkpoints import make_plan
from taichi_sim.lattice.stages import memory

pytestmark = pytest.mark.kernels

DIRECTIONS = 20
TOLERANCE = 1e-6


def engine(bodies, batch=None, **options) -> LatticeEngine:
    """In a fluid if the scene's pouch, which has a fourth layer, is there."""
    shape = bodies if isinstance(bodies, LatticeBody) else bodies[0]
    wet = shape.voxels[:, 2].max() == 3
    return LatticeEngine(bodies, batch, time_step=TIME_STEP, floor=True, fluid=wet, **options)


PLAIN, POUCH = (False, False), (True, True)


@pytest.fixture(scope="module", params=[PLAIN, POUCH], ids=["plain", "poisson in a fluid"])
def scene(request):
    """A body, the cost, and its gradient."""
    shape = body(*request.param)
    single = engine(shape)
    single.set_state(repeated(start(shape), 1))
    tape = single.record(program())
    assert single._driver.rebuilds > 1  # the neighbour list was built again
    cost = Cost(shape, 3, sizes=True)
    assert cost.of(single, tape.result).shape == (1,)
    return shape, cost, tape, cost.pull_back(tape)


def test_the_scene_is_eventful():
    """Links switch to large angles and back, voxels slide on the floor, the sheets touch, some voxels are held."""
    shape, base = body(), program()
    large, sliding, gaps = [], [], []
    for steps in (30, 100, 170):
        lab = engine(shape)
        lab.set_state(repeated(start(shape), 1))
        early = base.events[base.events["step"] < steps]
        lab.run(LatticeProgram([steps], early, np.zeros((1, 0), int)))
        voxel = lab._driver.read(memory.VOXEL)[0]
        large.append(lab._driver.read(memory.LINK)[0, :, memory.REGIME] < 0.5)
        sliding.append(((voxel[:, 2] < 0) & (voxel[:, memory.STICKS] < 0.5)).sum())
        centres = lab.state().positions[0]
        apart = centres[shape.regions == 2][:, None] - centres[shape.regions == 0][None]
        gaps.append(np.linalg.norm(apart, axis=2).min())
    assert all(0 < x.sum() < len(x) for x in large) and (large[0] != large[2]).any()
    assert min(sliding) > 0 and min(gaps) < 2 * 0.625 * 0.01


def differences(scene, bodies, programs, states, steps):
    """Central differences over pairs of robots, first all that go forward, then all that go back."""
    cost = scene[1]
    lab = engine(bodies, len(states.positions))
    lab.set_state(states)
    values = cost.of(lab, lab.run(programs))
    half = len(values) // 2
    return (values[:half] - values[half:]) / (2 * steps)


def states_of(shape) -> LatticeState:
    return repeated(start(shape), 2 * DIRECTIONS)


def assert_agrees(found, difference, steps=(3e-5, 3e-6, 3e-7)) -> None:
    """As vectors over the directions, at the best of a few step sizes."""
    errors = []
    for step in steps:
        expected = difference(step)
        assert np.abs(expected).max() > 0
        errors.append(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    assert min(errors) <= TOLERANCE, errors


def shifted_events(base: LatticeProgram, quantities, field: str, directions: np.ndarray, step: float):
    """A batch whose robots i and i + n have the events of some quantities moved by +-step along direction i."""
    count = len(directions)
    (chosen,) = np.nonzero(np.isin(base.events["quantity"], quantities))
    parts = []
    for robot, sign in enumerate([*[1] * count, *[-1] * count]):
        events = base.events.copy()
        events["robot"] = robot
        events[field][chosen] += sign * step * directions[robot % count]
        parts.append(events)
    rows = 2 * count
    return LatticeProgram(np.full(rows, STEPS), np.concatenate(parts), np.repeat(base.snapshots, rows, axis=0)), chosen


KINDS = {
    "pressure": ([Quantity.PRESSURE], 100.0),
    "scale": ([Quantity.SCALE, Quantity.SCALE + 1, Quantity.SCALE + 2], 0.01),
    "temperature": ([Quantity.TEMPERATURE], 10.0),
    "friction": ([Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION], 0.1),
    "damping": ([Quantity.GLOBAL_DAMPING], 0.01),
    "gravity": ([Quantity.ACCELERATION + a for a in range(3)], 1.0),
    "force": ([Quantity.FORCE + a for a in range(3)], 1e-2),
    "moment": ([Quantity.MOMENT + a for a in range(3)], 3e-5),
    "translation": ([Quantity.TRANSLATION + a for a in range(3)], 1e-4),
    "rotation": ([Quantity.ROTATION + a for a in range(3)], 1e-2),
}


@pytest.mark.parametrize("field", ["value", "rate"])
@pytest.mark.parametrize("kind", KINDS)
def test_events(scene, kind, field):
    """Values and rates of every kind of event, 20 random directions."""
    check_events(scene, *KINDS[kind], field)


@pytest.mark.parametrize("scene", [POUCH], indirect=True)
@pytest.mark.parametrize("field", ["value", "rate"])
def test_resistance(scene, field):
    """Of the fluid."""
    check_events(scene, [Quantity.RESISTANCE, Quantity.RESISTANCE + 1], 50.0, field)


def check_events(scene, quantities, scale: float, field: str) -> None:
    """Values or rates of the events of some quantities, 20 random directions."""
    shape, _, _, gradient = scene
    scale = scale / (1 if field == "value" else 100)
    base = program()
    count = np.isin(base.events["quantity"], quantities).sum()
    directions = scale * np.random.default_rng(1).normal(size=(DIRECTIONS, count))
    _, chosen = shifted_events(base, quantities, field, directions, 0.0)

    def difference(step: float) -> np.ndarray:
        moved, _ = shifted_events(base, quantities, field, directions, step)
        return differences(scene, shape, moved, states_of(shape), step)

    assert_agrees(directions @ (gradient.values if field == "value" else gradient.rates)[chosen], difference)


MATERIAL_KINDS = {
    "modulus": {"youngs_modulus": 1e5},
    "density": {"density": 1e3},
    "damping": {"internal_damping": 0.1, "global_damping": 1e-3, "collision_damping": 0.1},
    "friction": {"static_friction": 0.1, "kinetic_friction": 0.1},
    "heat": {"thermal_expansion": 1e-3, "temperature": 1.0},
}


@pytest.mark.parametrize("kind", MATERIAL_KINDS)
def test_materials(scene, kind):
    """Numbers of the materials, at given velocities at the start."""
    check_materials(scene, MATERIAL_KINDS[kind])


@pytest.mark.parametrize("scene", [POUCH], indirect=True)
def test_poissons_ratio(scene):
    """Where it is not zero, which switches the effect off."""
    check_materials(scene, {"poissons_ratio": 0.1})


def check_materials(scene, scales: dict[str, float]) -> None:
    """20 random directions over some numbers of both materials."""
    shape, _, _, gradient = scene
    directions = np.random.default_rng(2).normal(size=(DIRECTIONS, len(scales), 2))
    directions *= np.array(list(scales.values()))[:, None]
    found = sum((directions[:, i] * gradient.materials[name][0]).sum(axis=1) for i, name in enumerate(scales))

    def moved(direction: np.ndarray) -> LatticeBody:
        materials = tuple(
            replace(m, **{name: getattr(m, name) + direction[i, k] for i, name in enumerate(scales)})
            for k, m in enumerate(shape.materials)
        )
        return replace(shape, materials=materials)

    def difference(step: float) -> np.ndarray:
        bodies = [moved(sign * step * d) for sign in (1, -1) for d in directions]
        return differences(scene, bodies, program(2 * DIRECTIONS), states_of(shape), step)

    assert_agrees(found, difference)


def test_channels_that_an_earlier_run_has_set_owe_nothing_to_the_materials():
    """The scale of one run is where the next begins; what no event has set is still the material's."""
    lab = engine(body())
    builder = ProgramBuilder(1)
    builder.set(Quantity.SCALE, 1.02, regions=[0, 1, 2, 3])
    lab.run(builder.build(5))
    tape = lab.record(ProgramBuilder(1).build(50))
    found = tape.pull_back(state=repeated(Cost(lab.body, 0).state, 1)).materials
    assert (found["scale"][..., 0] == 0).all() and (found["scale"][..., 1:] != 0).all()
    lab.reset()
    again = lab.record(ProgramBuilder(1).build(50)).pull_back(state=repeated(Cost(lab.body, 0).state, 1))
    assert (again.materials["scale"] != 0).all()


@pytest.mark.parametrize("part", ["positions", "orientations", "velocities", "angular_velocities"])
def test_start(scene, part):
    """The state at the start."""
    shape, _, _, gradient = scene
    rng = np.random.default_rng(4)
    first = getattr(start(shape), part)
    directions = rng.normal(size=(DIRECTIONS, *first.shape)) * {"positions": 1e-3, "angular_velocities": 10.0}.get(
        part, 0.1
    )
    if part == "orientations":  # along the sphere of unit quaternions
        directions -= (directions * first).sum(axis=2, keepdims=True) * first

    def difference(step: float) -> np.ndarray:
        moves = step * np.concatenate([directions, -directions])
        states = replace(states_of(shape), **{part: first + moves})
        return differences(scene, shape, program(2 * DIRECTIONS), states, step)

    assert_agrees((directions * getattr(gradient, part)).sum(axis=(1, 2)), difference)


def test_rest_scales_of_single_voxels():
    """A region of every voxel makes its rest size an input of its own."""
    shape = body()
    shape = replace(shape, regions=np.arange(shape.voxel_count))
    cost = Cost(shape, 0)
    rng = np.random.default_rng(5)
    scales = 1 + 0.02 * rng.normal(size=(3, shape.voxel_count))
    directions = 0.05 * rng.normal(size=(DIRECTIONS, *scales.shape))

    def build(values: np.ndarray) -> LatticeProgram:
        builder = ProgramBuilder(len(values))
        for axis in range(3):
            builder.set(Quantity.SCALE + axis, values[:, axis], regions=np.arange(shape.voxel_count))
        builder.set(Quantity.ACCELERATION + 2, -9.8, regions=np.arange(shape.voxel_count))
        return builder.build(100)

    def lab(batch: int) -> LatticeEngine:
        made = engine(shape, batch)
        made.set_state(repeated(start(shape), batch))
        return made

    single = lab(1)
    base = build(scales[None])
    gradient = cost.pull_back(single.record(base))
    by_scale = gradient.values[base.events["quantity"] < 3].reshape(3, -1)

    def difference(step: float) -> np.ndarray:
        batch = lab(2 * DIRECTIONS)
        values = cost.of(batch, batch.run(build(scales + step * np.concatenate([directions, -directions]))))
        return (values[:DIRECTIONS] - values[DIRECTIONS:]) / (2 * step)

    assert_agrees((directions * by_scale).sum(axis=(1, 2)), difference)


def gradients(lab: LatticeEngine, **options):
    """Gradient of the scene's cost from a fresh engine."""
    lab.set_state(repeated(start(lab.body), lab.batch))
    return Cost(lab.body, 3, sizes=True).pull_back(lab.record(program(lab.batch), **options))


def arrays(gradient) -> list[np.ndarray]:
    parts = [getattr(gradient, f) for f in gradient.__dataclass_fields__ if f != "materials"]
    return parts + list(gradient.materials.values())


def test_memory_changes_nothing():
    """However little is kept, the gradient has the same bits."""
    whole = gradients(engine(body()))
    for memory_bound in (2e6, 1.3e6):
        lab = engine(body())
        lab.set_state(repeated(start(lab.body), 1))
        tape = lab.record(program(), memory=memory_bound)
        assert tape.memory <= memory_bound
        for a, b in zip(arrays(whole), arrays(Cost(lab.body, 3, sizes=True).pull_back(tape)), strict=True):
            assert np.array_equal(a, b)


def test_memory_is_bounded_by_the_setting_not_by_the_horizon():
    """A hundred times as many steps need a few more checkpoints at most."""
    short, long = (make_plan(steps, 1.0, 1.0, memory=150.0) for steps in (1_000, 100_000))
    assert max(short.memory, long.memory) <= 150
    with pytest.raises(ValueError, match=r"^memory: 10 B is not allowed; .* at least"):
        make_plan(1000, 1.0, 1.0, memory=10.0)


@given(st.integers(0, 3000), st.floats(30, 1e4), st.floats(0.2, 5))
def test_a_plan_undoes_every_step_once_and_within_its_memory(steps, bound, checkpoint):
    """Records run from the last step to the first; what is restored has been kept."""
    plan = make_plan(steps, 1.0, checkpoint, bound + 40 * checkpoint)
    kept, at, most = {0, *(plan.pieces(0, steps) if steps > plan.record else [])}, max(steps, 1), 0
    for action, low, high in plan.undo(0, max(steps, 1)):
        assert low in kept
        if action == "forward":
            kept.add(high)
        else:
            assert high == at and high - low <= plan.record
            at = low
            most = max(most, len(kept) * checkpoint + high - low + 1)
            kept.discard(low)
    assert at == 0 and most <= plan.memory


@pytest.mark.parametrize("pouch", [False, True])
def test_every_driver_gives_the_same_gradient(pouch):
    """One robot's voxels in lanes, and a thread per link or voxel."""
    shape = body(pouch=pouch)
    packed, stepped = (arrays(gradients(engine(shape, driver=driver))) for driver in ("packed", "stepped"))
    for a, b in zip(packed, stepped, strict=True):
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(a).max())


# The gradient by what events set, to six digits: so tests in single precision need not compute in double first.
IN_DOUBLE_PRECISION = np.fromstring(
    """-0.0295326 -0.00149574 0 0.00994324 215.258 160.212 257.974 140.995 0.579574 0 81.6945 -0.25219 388.758 0 156.027
    -1.35069 0 -0.718921 -0.00792374 -0.647482 1.09261 -0.7348 0 -0.530841 -0.0108485 -287.568 -99.1042 35525.4
    -21741.3 13796.1 175.701 -92.9631 0 0 0 0 0""",
    sep=" ",
)


def test_double_precision_finds_what_single_is_compared_with():
    found = gradients(engine(body())).values
    assert np.linalg.norm(found - IN_DOUBLE_PRECISION) < 1e-5 * np.linalg.norm(found)


@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_single_precision(driver):
    """Within what single precision can say of a bumpy ride."""
    found = gradients(engine(body(), precision="f32", driver=driver)).values
    assert np.linalg.norm(found - IN_DOUBLE_PRECISION) < 0.02 * np.linalg.norm(IN_DOUBLE_PRECISION)


def test_a_batch_of_robots_of_different_lengths():
    """Each has the gradient that it has alone, to the same bits; so has one beside a robot that diverges."""
    shape, rng = body(), np.random.default_rng(6)
    lengths = [57, 200, 1, 143]
    seeds = rng.normal(size=(4, 1, shape.voxel_count, 3))

    def gradient_of(robots: list[int], ruin: bool = False):
        builder = ProgramBuilder(len(robots) + ruin)
        for quantity, regions, step, value, rate in EVENTS:
            builder.set(quantity, value, regions=regions, step=step, rate=rate)
        cotangents, steps = seeds[robots], [lengths[i] for i in robots]
        if ruin:
            builder.set(Quantity.FORCE, 1e6, regions=[2], step=20, robots=[len(robots)])
            cotangents, steps = np.concatenate([cotangents, 0 * cotangents[:1]]), [*steps, 200]
        lab = engine(shape, len(steps))
        lab.set_state(repeated(start(shape), len(steps)))
        tape = lab.record(builder.build(steps, np.array(steps)[:, None]))
        assert (tape.result.status[len(robots) :] == "diverged").all()
        return tape, tape.pull_back(positions=cotangents)

    alone = [gradient_of([i])[1] for i in range(4)]
    for robots, ruin in (([0, 1, 2, 3], False), ([3, 1, 0], True)):
        tape, together = gradient_of(robots, ruin)
        events = tape._program.events["robot"]
        for lost in range(len(robots), len(robots) + ruin):
            assert not together.positions[lost].any() and not together.materials["density"][lost].any()
        for place, robot in enumerate(robots):
            assert np.array_equal(together.positions[place], alone[robot].positions[0])
            assert np.array_equal(together.values[events == place], alone[robot].values)
            assert np.array_equal(together.rates[events == place], alone[robot].rates)
            for name, part in together.materials.items():
                assert np.array_equal(part[place], alone[robot].materials[name][0]), name


def test_the_engine_goes_on_as_if_nothing_had_been_recorded():
    """A recorded run and its pull-back leave the engine where a plain run does."""
    plain, recorded = engine(body()), engine(body())
    for lab in (plain, recorded):
        lab.set_state(repeated(start(lab.body), 1))
    cost = Cost(plain.body, 3)
    values = cost.of(plain, plain.run(program()))
    tape = recorded.record(program(), memory=2e6)
    assert np.array_equal(cost.of(recorded, tape.result), values)
    first = cost.pull_back(tape)
    assert np.array_equal(cost.of(recorded, recorded.run(program())), cost.of(plain, plain.run(program())))
    again = cost.pull_back(tape)
    for a, b in zip(arrays(first), arrays(again), strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(cost.of(recorded, recorded.run(program())), cost.of(plain, plain.run(program())))


def test_bad_input():
    """One line each."""
    lab = engine(body())
    with pytest.raises(ValueError, match=r"^memory: -1 is not allowed"):
        lab.record(program(), memory=-1)
    with pytest.raises(ValueError, match=r"^memory: .* need at least"):
        lab.record(program(), memory=1e5)
    tape = lab.record(program())
    with pytest.raises(ValueError, match=r"^positions: cotangents of shape \(3,\) are not allowed; give \(1, 3, "):
        tape.pull_back(positions=np.zeros(3))
    with pytest.raises(ValueError, match=r"^strains: cotangents must be finite"):
        tape.pull_back(strains=np.full_like(tape.result.strains, np.nan))
    builder = ProgramBuilder(1)
    builder.set(Quantity.FORCE, 1e6, regions=[2])
    lost = lab.record(builder.build(100, [[100]]))
    with pytest.raises(ValueError, match=r"^robot 0: diverged at step \d+; it has no gradient"):
        lost.pull_back(positions=np.ones((1, 1, lab.body.voxel_count, 3)))


@pytest.mark.slow
def test_the_published_robot_over_two_thousand_steps():
    """The first stroke on a slope, all kinds of its events at once, moved so little that no foot slips earlier."""
    actuation = InflatableActuation(pressure_ramp=10.0)
    design = InflatableDesign(6e3, 30.0, ROLLING.schedule)
    begin, events = actuation.initial_steps(design.pressure), build_program([design], Terrain(5.0), actuation).events
    before = events[events["step"] < begin]
    stroke = events[(events["step"] >= begin) & (events["step"] < begin + 2000)].copy()
    stroke["step"] -= begin
    scales = {int(Quantity.ACCELERATION) + a: 0.1 for a in range(3)}
    scales |= {int(Quantity.STATIC_FRICTION): 0.1, int(Quantity.KINETIC_FRICTION): 0.1}
    scale = np.array([scales.get(int(q), 1e-3) for q in stroke["quantity"]])
    directions = scale * np.random.default_rng(8).normal(size=(DIRECTIONS, len(stroke)))

    def settled(batch: int) -> LatticeEngine:
        lab = LatticeEngine(PUBLISHED.body, batch, time_step=PUBLISHED.time_step, floor=True)
        lab.run(batch_program(before, np.zeros((batch, len(before))), begin))
        return lab

    weights = np.random.default_rng(9).normal(size=(PUBLISHED.body.voxel_count, 3))
    tape = settled(1).record(batch_program(stroke, np.zeros((1, len(stroke))), 2000))
    found = directions @ tape.pull_back(positions=weights[None, None]).values
    step = 1e-6
    moves = step * np.concatenate([directions, -directions])
    result = settled(2 * DIRECTIONS).run(batch_program(stroke, moves, 2000))
    costs = (result.positions[:, 0] * weights).sum(axis=(1, 2))
    expected = (costs[:DIRECTIONS] - costs[DIRECTIONS:]) / (2 * step)
    assert np.abs(found - expected).max() <= 1e-4 * np.abs(expected).max()


def batch_program(events: np.ndarray, moves: np.ndarray, steps: int) -> LatticeProgram:
    """A program of robots whose events have their values moved, the pose recorded at the end."""
    parts = []
    for robot, move in enumerate(moves):
        part = events.copy()
        part["robot"] = robot
        part["value"] += move
        parts.append(part)
    return LatticeProgram(np.full(len(moves), steps), np.concatenate(parts), np.full((len(moves), 1), steps))
