"""Events that are decided while a program runs, and derivatives through the decisions."""

import numpy as np
import pytest
from feedback_scene import DIRECTIONS, Linear, engine, scene, some_weights
from gradient_scene import Cost, body, repeated, start

from taichi_sim.lattice import Decision, Felt, LatticeState, Relief

pytestmark = pytest.mark.kernels


def rough() -> Relief:
    return Relief(4e-4 * np.random.default_rng(0).standard_normal((60, 60)), 0.005, (-0.1, -0.1))


def test_a_run_is_the_open_loop_run_of_what_was_decided():
    """To the last bit."""
    program, decisions = scene(1)
    feedback, closed = Linear(some_weights(), decisions), engine(1)
    result = closed.run(program, feedback=feedback)
    events = program.events.copy()
    for number, one in enumerate(decisions):
        slot = result.positions[:, one.snapshot], result.orientations[:, one.snapshot], result.strains[:, one.snapshot]
        events["value"][one.events], events["rate"][one.events] = feedback.decide(number, Felt(*slot))
    assert np.ptp(events["value"][decisions[2].events]) > 0
    opened = engine(1)
    opened.run(type(program)(program.lengths, events, program.snapshots))
    assert np.array_equal(closed.state().positions, opened.state().positions)
    plain = engine(1)
    plain.run(program)
    assert np.abs(plain.state().positions - closed.state().positions).max() > 1e-5


@pytest.mark.parametrize("floor", [True, rough()], ids=["floor", "rough"])
@pytest.mark.parametrize("memory", [1e9, 1.1e6])
def test_gradients_by_weights_and_start(floor, memory):
    """Against central differences, through all decisions, senses included, with contact; in little memory, too."""
    program, decisions = scene(1)
    cost, weights, first = Cost(body(), 3), some_weights(), start(body())
    feedback, single = Linear(weights, decisions), engine(1, floor=floor)
    tape = single.record(program, memory, feedback=feedback)
    whole = {name: np.zeros(getattr(tape.result, name).shape) for name in ("positions", "orientations", "strains")}
    for name, given in whole.items():
        given[:, :3] = getattr(cost, name)
    gradient = tape.pull_back(**whole, state=repeated(cost.state, 1))
    rng = np.random.default_rng(6)
    turns = rng.normal(size=(DIRECTIONS, *weights.shape[1:]))
    moves = 1e-3 * rng.normal(size=(DIRECTIONS, *first.positions.shape))
    found = (turns * feedback.slopes).sum(axis=(1, 2, 3)) + (moves * gradient.positions).sum(axis=(1, 2))
    many, signs, errors = engine(2 * DIRECTIONS, floor=floor), np.repeat([1, -1], DIRECTIONS), []
    program, decisions = scene(2 * DIRECTIONS)
    for step in (3e-5, 3e-6):
        shifted = signs[:, None, None, None] * step * np.concatenate([turns, turns])
        at = repeated(first, 2 * DIRECTIONS)
        many.reset()
        moved = first.positions + signs[:, None, None] * step * np.concatenate([moves, moves])
        many.set_state(LatticeState(moved, at.orientations, at.velocities, at.angular_velocities))
        result = many.run(program, feedback=Linear(weights + shifted, decisions))
        values = cost.of(many, first_three(result))
        expected = (values[:DIRECTIONS] - values[DIRECTIONS:]) / (2 * step)
        errors.append(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    assert np.abs(feedback.slopes).max() > 0 and min(errors) <= 1e-6, errors


def first_three(result):
    """A result with the snapshots of the cost alone."""
    from dataclasses import replace

    names = ("positions", "orientations", "strains", "sizes")
    return replace(result, **{name: getattr(result, name)[:, :3] for name in names})


def test_drivers_agree():
    """In what happens, to the last bit, and in gradients up to the order of sums."""
    found = []
    for driver in ("packed", "stepped"):
        program, decisions = scene(2)
        feedback, pair = Linear(some_weights(2), decisions), engine(2, driver=driver)
        tape = pair.record(program, feedback=feedback)
        seeds = LatticeState(*(np.ones_like(getattr(tape.state, f)) for f in tape.state.__dataclass_fields__))
        gradient = tape.pull_back(state=seeds)
        found.append((tape.state.positions, feedback.slopes, gradient.positions))
    (a, slopes, by_start), (b, other_slopes, other_start) = found
    assert np.array_equal(a, b) and np.array_equal(a[0], a[1])
    assert np.allclose(slopes, other_slopes, rtol=1e-9, atol=1e-9 * np.abs(slopes).max())
    assert np.allclose(by_start, other_start, rtol=1e-9, atol=1e-9 * np.abs(by_start).max())


def test_bad_input():
    """One line each."""
    program, decisions = scene(1)

    def refused(given, message):
        with pytest.raises(ValueError, match="^feedback: " + message):
            engine(1).run(program, feedback=Linear(some_weights(), given))

    refused(decisions[::-1], "decision 1 at step 101 is not allowed; give steps in order")
    refused([Decision(13, 3, decisions[0].events)], "decision 0 at step 13 has no snapshot 3 there")
    refused([Decision(12, 3, decisions[0].events[[0, 0]])], "decision 0 at step 12 decides an event twice")
    refused([Decision(55, 4, decisions[0].events)], "decision 0 at step 55 decides an event that is not later")
    again = Decision(decisions[1].step, decisions[1].snapshot, decisions[0].events)
    refused([decisions[0], again], f"decision 1 at step {again.step} decides an event twice")
    refused([decisions[0], Decision(10**6, 9, again.events)], "decision 1 at step 1000000 is not allowed; give steps")
    two, decisions = scene(2)
    uneven = type(two)(two.lengths - [0, 1], two.events, two.snapshots.clip(max=100))
    with pytest.raises(ValueError, match=r"^feedback: robots that run for different times"):
        engine(2).run(uneven, feedback=Linear(some_weights(2), decisions))
