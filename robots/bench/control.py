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
        parts = np.arange(count) * felt // count
        members = (parts[None] == np.arange(felt)[:, None]).astype(float)
        self._members = members / members.sum(axis=1, keepdims=True)  # (felt, V)
        self._layers = draws.normal(0, 0.3, (hidden, felt)), draws.normal(0, 0.3, (driven, hidden))
        self.decisions: Sequence[Decision] = []
        self._heights: dict[int, Floats] = {}

    def plan(self, program: LatticeProgram) -> LatticeProgram:
        """A program with readings and events that the network decides."""
        length, batch = int(program.lengths[0]), len(program.lengths)
        steps, driven = range(EVERY, length - 1, EVERY), SIZES[-1]
        events = np.zeros((len(steps), batch, driven), EVENT)
        events["step"], events["robot"] = np.array(steps)[:, None, None], np.arange(batch)[:, None]
        events["region"], events["quantity"] = np.arange(driven), Quantity.TEMPERATURE
        slots, size = program.snapshots.shape[1], batch * driven
        self.decisions = [
            Decision(step - 1, slots + n, len(program.events) + n * size + np.arange(size))
            for n, step in enumerate(steps)
        ]
        read = np.array([[step - 1 for step in steps]] * batch, program.snapshots.dtype)
        every = np.concatenate([program.events, events.ravel()])
        return LatticeProgram(program.lengths, every, np.concatenate([program.snapshots, read], axis=1))

    def _answer(self, heights: Any) -> Any:
        value = mapped(self._members, heights) / PUBLISHED.voxel_size
        for layer in self._layers:
            value = np.tanh(mapped(layer, value))
        return GAIN * value

    def decide(self, number: int, felt: Felt) -> tuple[Floats, Floats]:
        """Temperatures of the next 50 steps."""
        self._heights[number] = felt.positions[:, :, 2]
        values = self._answer(self._heights[number]).ravel()
        return values, np.zeros(values.shape)

    def pull_back(self, number: int, values: Floats, rates: Floats) -> Felt:
        """Derivatives by the heights."""
        heights = self._heights[number]
        _, way = trace(self._answer, heights)
        positions = np.zeros((*heights.shape, 3))
        (positions[:, :, 2],) = way(values.reshape(len(heights), -1))
        links = len(PUBLISHED.body.topology.links)
        return Felt(positions, np.zeros((*heights.shape, 4)), np.zeros((len(heights), links)))
