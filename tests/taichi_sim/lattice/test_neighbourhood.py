"""Lists of neighbours reach as far as voxels of a run may come to touch, however large they grow."""

import copy
import pickle

import numpy as np
import pytest

from taichi_sim.lattice import (
    Decision,
    Felt,
    LatticeBody,
    LatticeEngine,
    LatticeProgram,
    LatticeState,
    Material,
    ProgramBuilder,
    Quantity,
)
from taichi_sim.lattice.drivers.neighbourhood import SIZES, Extremes, list_radius
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.materials import CONSTANT_COLUMNS, EXPANSION
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages.memory import AGE, BASE, CHANNEL_WIDTH, RATE
from taichi_sim.lattice.stages.tables import pack_program

EDGE = 0.01


def test_the_usual_radius_does_up_to_sizes_of_a_fifth_more():
    assert list_radius(0.0) == list_radius(1.2) == contact.NEIGHBOUR_RADIUS
    for size in (1.3, 2.0, 5.0):
        assert list_radius(size) - 2 * contact.REBUILD_DISTANCE == pytest.approx(contact.reach(size, size))


def drawn(rng, robots, regions, steps):
    """A program of random events of scales, temperatures and frictions, some of them at the same steps."""
    made = ProgramBuilder(robots)
    for _ in range(12):
        given = {"step": int(rng.integers(0, steps)), "rate": rng.normal(0, 0.02) * (rng.random() < 0.7)}
        quantity = int(rng.choice([Quantity.SCALE, Quantity.SCALE + 2, Quantity.TEMPERATURE, Quantity.STATIC_FRICTION]))
        made.set(quantity, rng.normal(1, 0.3), regions=[int(rng.integers(regions))], **given)
    return made.build(steps)


def test_extremes_hold_all_that_channels_hold_step_by_step():
    rng = np.random.default_rng(0)
    for _ in range(20):
        regions, steps = 2, 40
        packed = pack_program(drawn(rng, 1, regions, steps), np.arange(regions))
        channels = np.zeros((1, regions * QUANTITY_COUNT, CHANNEL_WIDTH))
        channels[..., BASE], channels[..., RATE] = rng.normal(1, 0.2, (2, 1, regions * QUANTITY_COUNT)) * [
            [[1]],
            [[0.01]],
        ]
        channels[..., AGE] = rng.integers(0, 5, channels.shape[:2])
        found = Extremes(channels, packed)
        now, held = channels.copy(), list[np.ndarray]()
        for step in range(steps):
            for (at, target), (base, rate) in zip(packed.marks, packed.values, strict=True):
                if at == step and target >= 0:
                    now[0, target, [BASE, RATE, AGE]] = base, rate, 0
            held.append(now[..., BASE] + now[..., RATE] * now[..., AGE])
            now[..., AGE] += 1
        held = np.array(held)[:, 0].reshape(steps, regions, QUANTITY_COUNT)[:, :, SIZES]
        assert (found.least[0] <= held.min(axis=0) + 1e-12).all() and (found.most[0] >= held.max(axis=0) - 1e-12).all()
        # No more than a step of a ramp beside what channels hold, or what an event of the same step has replaced.
        assert (found.most[0] <= max(held.max(), packed.values[:, 0].max()) + 0.1).all()
        constants = np.zeros((1, regions, CONSTANT_COLUMNS))
        constants[..., EXPANSION] = 0.01
        sizes = (1 + 0.01 * held[..., 3]) * held[..., :3].mean(axis=2)
        assert found.largest(constants) >= sizes.max() - 1e-12


def colliding(scale, driver):
    """Two free blocks of swollen voxels on their way towards each other, whose contact has no damping."""
    block = np.argwhere(np.ones((2, 2, 2), bool))
    voxels = np.concatenate([block, block + np.array([40, 0, 0])])
    material = Material(1e5, 1000.0, collision_damping=0.0, scale=(scale,) * 3)
    body = LatticeBody(voxels=voxels, materials=(material,), material_index=[0] * 16, voxel_size=EDGE)
    engine = LatticeEngine(body, time_step=body.recommended_time_step / 4, driver=driver)
    places = block * EDGE * scale
    apart = [EDGE * scale + 1.1 * contact.reach(scale, scale) * EDGE, 0, 0]
    at, speed = engine.state(), np.zeros((1, 16, 3))
    speed[0, :8, 0], speed[0, 8:, 0] = 0.1, -0.1
    engine.set_state(
        LatticeState(np.concatenate([places, places + apart])[None], at.orientations, speed, at.angular_velocities)
    )
    return engine


@pytest.mark.kernels
@pytest.mark.parametrize("scale", [1.0, 1.6, 2.5])
def test_swollen_blocks_bounce_off_without_a_gain_of_energy(scale):
    ends = []
    for driver in ("packed", "stepped"):
        engine, most = colliding(scale, driver), 0.0
        for _ in range(40):
            engine.run(ProgramBuilder(1).build(int(0.15 / 40 / engine.time_step)))
            most = max(most, float((engine.state().velocities ** 2).sum()))
        ends.append(engine.state().velocities)
        assert most <= 16 * 0.1**2 * (1 + 1e-9)
        assert ends[-1][0, :8, 0].mean() < -0.02 < 0.02 < ends[-1][0, 8:, 0].mean()
    assert np.array_equal(*ends)


def pair(apart, driver="auto"):
    """Two voxels at rest, so many edges apart."""
    body = LatticeBody(
        voxels=[[0, 0, 0], [40, 0, 0]], materials=(Material(1e5, 1000.0),), material_index=[0, 0], voxel_size=EDGE
    )
    engine = LatticeEngine(body, driver=driver)
    engine.set_positions(np.array([[[0, 0, 0], [apart * EDGE, 0, 0]]]))
    return engine


def swelling():
    """A program, not yet built, in which both grow to 2.4 edges from its first step on."""
    made = ProgramBuilder(1)
    for axis in range(3):
        made.set(Quantity.SCALE + axis, 2.4, regions=[0])
    return made


@pytest.mark.kernels
def test_voxels_that_swell_where_they_are_come_to_touch():
    engine, steps = pair(2.6), 4000
    engine.run(ProgramBuilder(1).build(10))  # lists pairs as near as usual
    made = ProgramBuilder(1)
    for axis in range(3):
        made.set(Quantity.SCALE + axis, 1.0, rate=1.4 / steps, regions=[0])
        made.set(Quantity.SCALE + axis, 2.4, step=steps, regions=[0])
    engine.run(made.build(2 * steps))
    x = engine.state().positions[0, :, 0]
    assert (x[1] - x[0]) / EDGE == pytest.approx(contact.reach(2.4, 2.4), rel=2e-3)


class Swelling:
    """Decides that all voxels have another scale."""

    def __init__(self, *decisions, scale, rate=0.0):
        self.decisions, self.scale, self.rate = decisions, scale, rate

    def decide(self, number, felt: Felt):
        values = np.full(len(self.decisions[number].events), self.scale)
        return values, np.full(len(values), self.rate)

    def pull_back(self, number, values, rates):
        return Felt(np.zeros((1, 2, 3)), np.zeros((1, 2, 4)), np.zeros((1, 0)))


@pytest.mark.kernels
def test_what_is_decided_on_the_way_counts():
    made, found = ProgramBuilder(1), []
    for axis in range(3):
        made.set(Quantity.SCALE + axis, 1.0, step=100, regions=[0])
    program = made.build(5000)
    program = LatticeProgram(program.lengths, program.events, np.array([[50]], program.snapshots.dtype))
    for driver in ("packed", "stepped"):
        engine = pair(2.6, driver)
        engine.run(program, feedback=Swelling(Decision(50, 0, np.arange(3)), scale=2.4))
        x = engine.state().positions[0, :, 0]
        found.append((x[1] - x[0]) / EDGE)
    assert found[0] == found[1] > contact.reach(2.4, 2.4) * (1 - 2e-3)


@pytest.mark.kernels
def test_the_published_lists_miss_what_they_missed():
    """As in the simulator of the dissertation: its robot's speeds are those of its contacts."""
    engine = LatticeEngine(pair(2.6).body, self_contact="published")
    engine.set_positions(np.array([[[0, 0, 0], [2.6 * EDGE, 0, 0]]]))
    made = swelling()
    engine.run(made.build(2000))
    assert np.ptp(engine.state().positions[0, :, 0]) == pytest.approx(2.6 * EDGE, rel=1e-12)
    with pytest.raises(ValueError, match=r"^self_contact: 'all' is not allowed; give True, False or 'published'$"):
        LatticeEngine(engine.body, self_contact="all")


@pytest.mark.kernels
@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_a_ramp_that_outlasts_other_decisions_counts_whole(driver):
    """Sizes are decided at step 50, frictions at step 100; sizes grow all the way."""
    made, steps = ProgramBuilder(1), 4000
    for axis in range(3):
        made.set(Quantity.SCALE + axis, 1.0, step=51, regions=[0])
    made.set(Quantity.STATIC_FRICTION, 0.5, step=101, regions=[0])
    program = made.build(steps)
    program = LatticeProgram(program.lengths, program.events, np.array([[50, 100]], program.snapshots.dtype))
    sizes, others = (np.flatnonzero(program.events["step"] == step) for step in (51, 101))
    feedback = Swelling(Decision(50, 0, sizes), Decision(100, 1, others), scale=1.0, rate=1.4 / steps)
    engine = pair(2.6, driver)
    engine.run(program, feedback=feedback)
    assert np.ptp(engine.state().positions[0, :, 0]) / EDGE > 0.98 * contact.reach(2.4, 2.4)


@pytest.mark.kernels
@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_a_state_from_before_voxels_grew_goes_on_to_the_same_bits(driver):
    engine, made = pair(2.6, driver), swelling()
    engine.run(ProgramBuilder(1).build(10))
    saved, ends = engine.save(), []
    for _ in range(2):
        engine.restore(saved)
        engine.run(made.build(3000))
        ends.append(engine.state().positions)
    assert np.array_equal(*ends) and np.ptp(ends[0][0, :, 0]) > 0.99 * contact.reach(2.4, 2.4) * EDGE


@pytest.mark.kernels
@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_a_copied_engine_goes_on_to_the_same_bits(driver):
    engine, made = pair(2.6, driver), swelling()
    engine.run(made.build(1500))
    state, ends = engine.state(), []
    for copied in (copy.deepcopy(engine), pickle.loads(pickle.dumps(engine)), engine):
        assert np.array_equal(copied.state().velocities, state.velocities)
        copied.run(ProgramBuilder(1).build(1500))
        ends.append(copied.state().positions)
    assert np.array_equal(ends[0], ends[2]) and np.array_equal(ends[1], ends[2])
    assert not np.array_equal(state.positions, ends[2])


@pytest.mark.kernels
@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_what_a_copy_could_not_share_is_not_copied(driver):
    engine = pair(2.6, driver)
    for part in (engine._driver, engine.begin(ProgramBuilder(1).build(10))):
        for way in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(TypeError, match=r"cannot be copied or pickled; copy the engine that it belongs to$"):
                way(part)


@pytest.mark.kernels
@pytest.mark.parametrize("driver", ["packed", "stepped"])
def test_gradients_do_not_depend_on_memory_where_a_decision_lets_voxels_grow(driver):
    made, at, steps, found = ProgramBuilder(1), 2500, 3000, []
    for axis in range(3):
        made.set(Quantity.SCALE + axis, 1.0, step=at + 1, regions=[0])
    program = made.build(steps)
    snapshots = np.array([[at, steps]], program.snapshots.dtype)
    program = LatticeProgram(program.lengths, program.events, snapshots)
    for memory in (1e9, 1.5e6, 1e6):
        engine = pair(2.6, driver)
        tape = engine.record(program, memory, feedback=Swelling(Decision(at, 0, np.arange(3)), scale=2.4))
        cost = np.zeros(tape.result.positions.shape)
        cost[0, 1, 1, 0] = 1.0
        found.append(tape.pull_back(positions=cost).positions[0, :, 0])
        assert np.ptp(tape.result.positions[0, 1, :, 0]) > 2.7 * EDGE
    assert found[0].min() > 0.1  # they push each other
    np.testing.assert_allclose(found[1:], [found[0], found[0]], rtol=1e-9)
