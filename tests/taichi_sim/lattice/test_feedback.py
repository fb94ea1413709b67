"""Events that are decided while a program runs, and derivatives through the decisions."""

import numpy as np
import pytest
from gradient_scene import EVENTS, STEPS, TIME_STEP, Cost, body, repeated, start

from taichi_sim.lattice import Decision, Felt, LatticeEngine, LatticeState, ProgramBuilder, Quantity, Relief

pytestmark = pytest.mark.kernels

AT = (12, 55, 100, 101, 160)  # steps at which robots are read
DECIDED = ((Quantity.SCALE, 2), (Quantity.PRESSURE, 0), (Quantity.FORCE, 2))  # quantity and region
PER_UNIT = np.array([0.02, 200.0, 3e-3])  # values for an output of 1
FEATURES = 5
DIRECTIONS = 8


def scene(batch: int):
    """The eventful program of the gradients' tests, in which some more events wait for their values."""
    builder = ProgramBuilder(batch)
    for quantity, regions, step, value, rate in EVENTS:
        builder.set(quantity, value, regions=regions, step=step, rate=rate)
    for step in AT:
        for quantity, region in DECIDED:
            builder.set(quantity, 1.0 if quantity == Quantity.SCALE else 0.0, regions=region, step=step + 1)
    snapshots = [STEPS // 2, STEPS - 7, STEPS, *AT]
    program = builder.build(STEPS, np.tile(snapshots, (batch, 1)))
    events, decisions = program.events, []
    for number, step in enumerate(AT):
        chosen = [
            np.flatnonzero(
                (events["step"] == step + 1) & (events["quantity"] == quantity) & (events["region"] == region)
            )
            for quantity, region in DECIDED
        ]
        assert all(len(each) == batch for each in chosen)
        order = [each[np.argsort(events["robot"][each])] for each in chosen]
        decisions.append(Decision(step, 3 + number, np.concatenate(order)))
    return program, decisions


class Linear:
    """Values and rates that are linear in where the body is, how it is turned and strained; weights per robot."""

    def __init__(self, weights: np.ndarray, decisions) -> None:
        self.weights, self.decisions = weights, decisions  # (B, 2, 3, FEATURES)
        self.read: dict[int, np.ndarray] = {}
        self.slopes = np.zeros(weights.shape)

    def decide(self, number: int, felt: Felt):
        self.read[number] = features = self.features(felt)
        outputs = np.einsum("bkof,bf->kob", self.weights, features) * PER_UNIT[None, :, None]
        base = np.array([1.0, 0.0, 0.0])[:, None]
        return (base + outputs[0]).ravel(), (outputs[1] / 50).ravel()

    @staticmethod
    def features(felt: Felt) -> np.ndarray:
        x, q = felt.positions, felt.orientations
        parts = [
            10 * x[:, :, 0].mean(1),
            50 * x[:, 3, 2],
            10 * q[:, 5, 2],
            10 * felt.strains[:, 4],
            felt.strains.sum(1),
        ]
        return np.stack(parts, axis=1)

    def pull_back(self, number: int, values, rates) -> Felt:
        batch = len(self.weights)
        found = [np.asarray(each).reshape(3, batch) * PER_UNIT[:, None] for each in (values, rates)]
        outputs = np.stack([found[0], found[1] / 50])
        self.slopes += np.einsum("kob,bf->bkof", outputs, self.read[number])
        by = np.einsum("kob,bkof->bf", outputs, self.weights)
        shape = body()
        felt = Felt(
            np.zeros((batch, shape.voxel_count, 3)),
            np.zeros((batch, shape.voxel_count, 4)),
            np.zeros((batch, len(shape.topology.links))),
        )
        felt.positions[:, :, 0] += 10 * by[:, :1] / shape.voxel_count
        felt.positions[:, 3, 2] += 50 * by[:, 1]
        felt.orientations[:, 5, 2] += 10 * by[:, 2]
        felt.strains[:, 4] += 10 * by[:, 3]
        felt.strains[:] += by[:, 4:]
        return felt


def engine(batch: int, **options) -> LatticeEngine:
    found = LatticeEngine(body(), batch, time_step=TIME_STEP, **({"floor": True} | options))
    found.set_state(repeated(start(body()), batch))
    return found


def some_weights(batch: int = 1) -> np.ndarray:
    return np.repeat(np.random.default_rng(5).normal(size=(1, 2, 3, FEATURES)), batch, axis=0)


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
