"""Reflexes: what a lattice robot feels changes how far its muscles swing, while it moves.

Sixteen times in every cycle the robot is read. A network makes of what it feels by how much every muscle shall differ
from its wave a sixteenth of a cycle later, or how oscillators shift its wave; muscles go there in a straight line.
Without weights the robot plays its waves, to the bit. All of it has exact derivatives: by weights, by waves, and
through what was felt.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from robots.control.cyclic import SEGMENTS, Cycle
from robots.control.networks import LayeredNetwork
from robots.control.oscillators import reach, waves_shifted
from robots.control.reflex_loop import AnsweringLoop
from robots.control.reflexes import Answering, senses_among
from robots.control.senses import width_of
from robots.lattice_robot.senses import SENSES, Anatomy, LatticeReader, Parts, check_felt
from robots.world import checked_place
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import Decision, Felt, LatticeBody, LatticeProgram


@dataclass(frozen=True)
class Reflexes(Answering):
    """Reflexes of a lattice robot: its senses, and a network, with free weights, by which they change its muscles.

    Attributes are those of ``Answering``, and:
        senses: names in ``SENSES`` of ``robots.lattice_robot.senses``.
        gain: largest change of a muscle's scale by a network.
        delay: delay from a reading to its answer [readings], 0 to 15.
        light: place (x, y) of the light, from where the body's centre starts [m]; None is that of the terrain.

    Raises:
        ValueError: for unknown senses, layers without nodes, a light that no sense sees, and a network's coupling.
    """

    senses: Annotated[tuple[str, ...], senses_among(SENSES)] = ("strain", "touch", "tilt", "velocity", "clock")
    delay: Annotated[int, partial(checks.whole_number, low=0, high=SEGMENTS - 1)] = 0
    light: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.light is not None:
            object.__setattr__(self, "light", checked_place("light", self.light))
            if "light" not in self.senses:
                raise ValueError(f"light: {self.light} is not allowed without the sense light; give both, or neither")

    def width(self, body: LatticeBody, regions: Sequence[int]) -> int:
        """Count the numbers that are felt of a body whose given regions are driven."""
        return width_of(SENSES, self.senses, Parts.of(body, regions))

    def network(self, body: LatticeBody, regions: Sequence[int]) -> LayeredNetwork:
        """Build the network that answers, or modulates oscillators, in a body whose given regions are driven."""
        return self.network_of(self.width(body, regions), len(regions))

    def weight_count(self, body: LatticeBody, regions: Sequence[int]) -> int:
        """Count the weights, K, for a body whose given regions are driven."""
        return self.network(body, regions).weight_count

    def least(self, nodes: Floats, shares: Floats) -> float:
        """Return a lower bound of the values to which answers can bring muscles.

        Args:
            nodes: values of their waves, shape (C, 16).
            shares: how far an answer moves each, shape (C,).
        """
        if self.kind == "network":
            return float((nodes.min(axis=1) - self.gain * np.abs(shares)).min())
        return min(float(each.mean()) - (1.0 + self.gain) * reach(each) for each in nodes)

    def check(self, body: LatticeBody, regions: Sequence[int]) -> None:
        """Refuse a body that lacks what the senses read, or driven regions, and weights of the wrong number.

        Raises:
            ValueError: that tells what the body lacks, or how many weights there are, and should be.
        """
        check_felt(self.senses, body, regions)
        self.check_weights(self.weight_count(body, regions))


@dataclass(frozen=True, eq=False)
class Feeling:
    """The reflexes of B robots of a batch.

    Attributes:
        reflexes: of all.
        weights: shape (B, K).
        regions: that are driven, R of them, in the order of answers.
        answers: which answer moves each channel, -1 for none, shape (C,).
        shares: how far a network's answer moves each channel, shape (C,).
        lights: where each robot's light is, from where its centre starts [m], shape (B, 2), or (1, 2) for all; None is
            the reflexes'.
        seed: of the noise.
    """

    reflexes: Reflexes
    weights: Floats
    regions: tuple[int, ...]
    answers: Ints
    shares: Floats
    lights: Floats | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.lights is None and self.reflexes.light is not None:
            object.__setattr__(self, "lights", np.array([self.reflexes.light], float))


class ReflexLoop(AnsweringLoop):
    """The reflexes of B robots in a run: decides how their muscles go on, and takes derivatives back.

    Attributes are those of ``AnsweringLoop``, and:
        by_swing: derivatives by what waves add to the channels at the nodes of a cycle, shape (B, C, 16), once all
            decisions were taken back.
    """

    reader: LatticeReader

    def __init__(
        self, feeling: Feeling, anatomy: Anatomy, cycle: Cycle, rest: Floats, swing: Floats, first: Floats
    ) -> None:
        """Set up.

        Args:
            feeling: of the robots.
            anatomy: of the body.
            cycle: when what happens.
            rest, swing: what channels hold without waves, shape (B, C), and what waves add, shape (B, C, 16).
            first: voxel centres at the start, shape (B, V, 3).
        """
        self.cycle, self.seed, self.rest, self.swing = cycle, feeling.seed, rest, swing
        self.moves = (feeling.answers[None, :] == np.arange(len(feeling.regions))[:, None]).astype(float)  # (R, C)
        self.shares = self.moves * feeling.shares
        self.decisions: Sequence[Decision] = []
        reader = LatticeReader(feeling.reflexes.senses, anatomy, first, keeps=False)
        network = feeling.reflexes.network(anatomy.body, feeling.regions)
        super().__init__(feeling.reflexes, feeling.weights, network, reader)

    def plan(self, program: LatticeProgram) -> LatticeProgram:
        """The program with a reading just before each piece of a cycle but the first."""
        cycle, slots = self.cycle, program.snapshots.shape[1]
        batch, channels = self.swing.shape[:2]
        pieces, size = (cycle.cycles + 1) * SEGMENTS, batch * channels
        base = len(program.events) - pieces * size
        steps = [cycle.begin + piece * cycle.segment - 1 for piece in range(1, pieces)]
        self.decisions = [
            Decision(step, slots + number, base + (number + 1) * size + np.arange(size))
            for number, step in enumerate(steps)
        ]
        more = np.tile(np.array(steps, program.snapshots.dtype), (batch, 1))
        return LatticeProgram(program.lengths, program.events, np.concatenate([program.snapshots, more], axis=1))

    def start(self) -> Sequence[Floats]:
        """What waves add to the channels at the start, shape (B, C), and the state of the oscillators."""
        return self.swing[:, :, 1], *super().start()

    def _forget(self) -> None:
        super()._forget()
        self.by_swing = np.zeros(self.swing.shape)

    def seeds_of_noise(self, number: int) -> tuple[int, ...]:
        """What the noise of a reading is drawn from."""
        return self.seed, number, 1  # start positions are drawn from pairs

    def answer(self, number: int, weights: Any, felt: Any, given: Sequence[Any], state: Sequence[Any]) -> Sequence[Any]:
        """Value and rate of the channels, given what waves add to them, and where they go at a node of the cycle."""
        (swing,), (at, *rhythms), node = given, state, _node(number)
        if self.oscillators is None:
            added = (self.network.answer(weights, felt)[:, :, None] * self.shares).sum(axis=1)
        else:
            rhythms = list(self.oscillators.step(weights, felt, 1 / SEGMENTS, *rhythms))
            lead, growth = ((each[:, :, None] * self.moves).sum(axis=1) for each in rhythms[:2])
            added = waves_shifted(swing, node, lead, growth)
        onwards = swing[:, :, node] + added
        return self.rest + at, (onwards - at) / self.cycle.segment, onwards, *rhythms

    def decide(self, number: int, felt: Felt) -> tuple[Floats, Floats]:
        """Value and rate of every channel in the next piece of the cycle."""
        values, rates = self.decided(number, self.reader.read(number, felt), self.swing)
        return values.ravel(), rates.ravel()

    def pull_back(self, number: int, values: Floats, rates: Floats) -> Felt:
        """Derivatives by what was felt, from those by the values and rates."""
        shape = self.swing.shape[:2]
        by_felt, (by_swing,) = self.taken_back(number, values.reshape(shape), rates.reshape(shape))
        self.by_swing += by_swing
        if number == 0:
            self.by_swing[:, :, 1] += self._by_state[0]
        return self.reader.pull_back(number, by_felt)


def _node(number: int) -> int:
    """The node of the cycle where channels go after a decision."""
    return (number + 2) % SEGMENTS
