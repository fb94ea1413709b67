"""What control in the loop costs: a network of 16-16-8 nodes that reads the robot every 50 steps and drives it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from robots.inflatable import PUBLISHED
from taichi_sim.autodiff.arrays import mapped, trace
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import Decision, Felt, LatticeProgram, Quantity
from taichi_sim.lattice.program import EVENT

EVERY = 50  # steps between readings
SIZES = 16, 16, 8  # numbers felt, hidden nodes, regions driven
GAIN = 1e-3  # of the answers: small, so that the robot stays on its gait


class Network:
    """A network that feels heights of parts of the published robot and changes temperatures of its regions.

    Attributes:
        decisions: of the program that :meth:`plan` made.
    """

    def __init__(self) -> None:
        felt, hidden, driven = SIZES
        draws, count = np.random.default_rng(0), PUBLISHED.body.voxel_count
        self._starts = -(-np.arange(felt + 1) * count // felt)  # of the parts, and the end of the last one
        self._sizes = np.diff(self._starts)
        self._shares = 1 / (self._sizes * PUBLISHED.voxel_size)  # of a voxel's height in what is felt
        self._layers = draws.normal(0, 0.3, (hidden, felt)), draws.normal(0, 0.3, (driven, hidden))
        self.decisions: Sequence[Decision] = []
        self._felt: dict[int, Floats] = {}

    def plan(self, program: LatticeProgram) -> LatticeProgram:
        """A program with readings and events that the network decides."""
        length, batch = int(program.lengths[0]), len(program.lengths)
        steps, driven = range(EVERY, length - 1, EVERY), SIZES[-1]
        events = np.zeros((len(steps), batch, driven), EVENT)
        events["step"], events["robot"] = np.array(steps)[:, None, None], np.arange(batch)[:, None]
        events["region"], events["quantity"] = np.arange(driven), Quantity.TEMPERATURE
        slots, decided = program.snapshots.shape[1], len(program.events) + np.arange(events.size)
        self.decisions = [
            Decision(step - 1, slots + n, each)
            for n, (step, each) in enumerate(zip(steps, decided.reshape(len(steps), batch * driven), strict=True))
        ]
        self._rates = np.zeros(batch * driven)
        read = np.array([[step - 1 for step in steps]] * batch, program.snapshots.dtype)
        every = np.concatenate([program.events, events.ravel()])
        return LatticeProgram(program.lengths, every, np.concatenate([program.snapshots, read], axis=1))

    def _answer(self, felt: Any) -> Any:
        for layer in self._layers:
            felt = np.tanh(mapped(layer, felt))
        return GAIN * felt

    def decide(self, number: int, felt: Felt) -> tuple[Floats, Floats]:
        """Temperatures of the next 50 steps, from the mean height of every part in voxels."""
        heights = np.add.reduceat(felt.positions[:, :, 2], self._starts[:-1], axis=1)
        self._felt[number] = self._shares * heights
        return self._answer(self._felt[number]).ravel(), self._rates

    def pull_back(self, number: int, values: Floats, rates: Floats) -> Felt:
        """Derivatives by the heights."""
        felt = self._felt[number]
        _, way = trace(self._answer, felt)
        (by_felt,) = way(values.reshape(len(felt), -1))
        batch, count, links = len(felt), PUBLISHED.body.voxel_count, len(PUBLISHED.body.topology.links)
        found = Felt(np.zeros((batch, count, 3)), np.zeros((batch, count, 4)), np.zeros((batch, links)))
        found.positions[:, :, 2] = np.repeat(self._shares * by_felt, self._sizes, axis=1)
        return found
