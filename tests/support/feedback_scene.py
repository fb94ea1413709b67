"""The eventful program of the gradients' tests, with linear decisions while it runs."""

import numpy as np
from gradient_scene import EVENTS, STEPS, TIME_STEP, body, repeated, start

from taichi_sim.lattice import Decision, Felt, LatticeEngine, ProgramBuilder, Quantity

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
