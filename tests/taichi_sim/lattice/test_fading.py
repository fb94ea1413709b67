"""Derivatives with a horizon: exact if it is long, those of a rigid motion if short, bounded where robots feel."""

import numpy as np
import pytest
from feedback_scene import Linear, engine, scene, some_weights

from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, Material, ProgramBuilder, Quantity

STEPS, TIME_STEP = 400, 1e-4
AT = (50, 130, 190, 260, 330, 400)
RUBBER = Material(3e5, 1000, static_friction=0.6, kinetic_friction=0.4, internal_damping=1.0, collision_damping=0.8)


def walk(batch: int = 2, at=None, **options):
    """A slab, somewhat shaken, that falls and swells on level ground, and derivatives by where its voxels are."""
    voxels = np.array([(x, y, z) for x in range(4) for y in range(3) for z in range(2)])
    body = LatticeBody(voxels, (RUBBER,), np.zeros(len(voxels), int), 0.01)
    lab = LatticeEngine(body, batch, time_step=TIME_STEP, floor=True, **options)
    shaken = body.start_positions + np.random.default_rng(4).normal(0, 3e-4, body.start_positions.shape)
    places, upright = np.tile(shaken, (batch, 1, 1)), np.tile([1.0, 0.0, 0.0, 0.0], (batch, len(voxels), 1))
    lab.set_state(LatticeState(places, upright, np.zeros(places.shape), np.zeros(places.shape)))
    builder = ProgramBuilder(batch)
    builder.set(Quantity.ACCELERATION + 2, -9.81, regions=[0])
    builder.set(Quantity.SCALE, 1.0, regions=[0], rate=1e-4, step=60)
    tape = lab.record(builder.build(STEPS, np.array(at or [AT] * batch)))
    rng = np.random.default_rng(5)
    seeds = [rng.normal(size=each.shape) for each in (tape.result.positions, tape.result.orientations)]
    return shaken, tape, seeds


def moved_and_turned(poses, seeds):
    """Derivatives by a level shift of everything, shape (B, 2), and by a turn about the vertical through 0, (B,)."""
    (x, q), (by_x, by_q) = poses, seeds
    w, i, j, k = np.moveaxis(q, -1, 0)
    axes = tuple(range(1, x.ndim - 1))
    turn = x[..., 0] * by_x[..., 1] - x[..., 1] * by_x[..., 0]
    turn = turn + 0.5 * (np.stack([-k, -j, i, w], axis=-1) * by_q).sum(axis=-1)
    return by_x.sum(axis=axes)[:, :2], turn.sum(axis=axes)


@pytest.mark.kernels
@pytest.mark.parametrize("horizon", [None, 0.01, 1e-6])
def test_on_level_ground_shifts_and_turns_of_the_start_are_those_of_all_that_is_recorded(horizon):
    """Whatever the horizon, as what is open-loop there does the same elsewhere and in another direction.

    But for a time step: fading takes a snapshot's poses for those of the step after.
    """
    shaken, tape, seeds = walk()
    recorded = (tape.result.positions, tape.result.orientations)
    found, tolerance = tape.pull_back(*seeds, horizon=horizon), 1e-3 if horizon else 1e-9
    start = np.broadcast_to(shaken, found.positions.shape), np.zeros((*found.positions.shape[:2], 4))
    start[1][..., 0] = 1.0
    for one, other in zip(
        moved_and_turned(start, (found.positions, found.orientations)), moved_and_turned(recorded, seeds), strict=True
    ):
        assert one == pytest.approx(other, rel=tolerance, abs=tolerance * np.abs(other).max())


@pytest.mark.kernels
def test_a_long_horizon_changes_nothing_and_a_short_one_much():
    _, tape, seeds = walk()
    exact, long, short = (tape.pull_back(*seeds, horizon=each) for each in (None, 1e9, 1e-9))
    assert long.positions == pytest.approx(exact.positions, rel=1e-6, abs=1e-9)
    assert np.abs(short.values).sum() > 0 and not np.allclose(short.positions, exact.positions, rtol=0.1)


@pytest.mark.kernels
def test_lanes_and_scalars_fade_alike():
    """The packed driver and the stepped one; and a robot alone as in a batch, to the bit."""
    packed, stepped, alone = (
        walk(batch, driver=driver) for batch, driver in ((2, "packed"), (2, "stepped"), (1, "packed"))
    )
    found = [tape.pull_back(*seeds, horizon=0.01) for _, tape, seeds in (packed, stepped)]
    assert found[0].positions == pytest.approx(found[1].positions, rel=1e-9, abs=1e-12)
    one = alone[1].pull_back(*(each[:1] for each in packed[2]), horizon=0.01)
    assert np.array_equal(one.positions[0], found[0].positions[0])


@pytest.mark.kernels
def test_where_robots_feel_what_they_decide_is_still_taken_back():
    """Derivatives by weights are others than the exact ones, the same twice, and the exact ones if it is long."""
    program, decisions = scene(2)

    def slopes(horizon):
        lab, feedback = engine(2), Linear(some_weights(2), decisions)
        tape = lab.record(program, feedback=feedback)
        tape.pull_back(np.ones_like(tape.result.positions), horizon=horizon)
        return feedback.slopes

    exact, faded = slopes(None), slopes(0.002)
    assert np.isfinite(faded).all() and not np.allclose(exact, faded, rtol=0.05)
    assert np.array_equal(faded, slopes(0.002)) and slopes(1e9) == pytest.approx(exact, rel=1e-5)


@pytest.mark.kernels
def test_bad_horizons_are_told():
    _, tape, seeds = walk(1)
    with pytest.raises(ValueError, match=r"^horizon: 0 is not allowed; give a positive finite number$"):
        tape.pull_back(*seeds, horizon=0)
    with pytest.raises(ValueError, match=r"^horizon: 1.0 is not allowed with a final state; give None$"):
        tape.pull_back(*seeds, horizon=1.0, state=tape.state)
    _, tape, seeds = walk(2, at=(AT, (60, *AT[1:])))
    with pytest.raises(
        ValueError, match=r"^horizon: robots are recorded at different steps, or run for different times"
    ):
        tape.pull_back(*seeds, horizon=1.0)
