"""Reflexes of articulated robots: what they feel changes the commands of their rhythms, while they move.

Whenever a command is due the robot is read. A network makes of what it feels by how much every drive's command differs
from its rhythm, or how oscillators shift the rhythm. Without weights the rhythm plays, to the bit. All of it has exact
derivatives, but for the sense of touch, which is a step.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Self

import numpy as np

from robots.articulated.senses import SENSES, DriveReader, Sensed
from robots.control.networks import LayeredNetwork
from robots.control.reflexes import Answering, senses_among
from robots.control.senses import width_of
from taichi_sim.autodiff.arrays import trace, value_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.options import value_of as number_in
from taichi_sim.rigid.feedback import Felt

PARTS = ("amplitude", "phase", "offset")  # of a drive's rhythm


@dataclass(frozen=True)
class DriveReflexes(Answering):
    """What an articulated robot feels, and what answers in its drives; its weights are free.

    Attributes are those of ``Answering``, and:
        senses: names in ``SENSES`` of ``robots.articulated.senses``.
        gain: of a network, most by which an answer changes a command; commands stay from -1 to 1.
        delay: in commands.
        noise: is the same for all robots of a batch, and of their seed.

    Example:
        >>> DriveReflexes.parse("tilt,clock+hidden:8,4+gain:0.3").hidden
        (8, 4)
    """

    senses: Annotated[tuple[str, ...], senses_among(SENSES)] = ("angles", "tilt", "velocity", "clock")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reflexes of a text: senses, then what differs from the defaults, as in ``touch,tilt+hidden:8+gain:0.3``.

        Raises:
            ValueError: for anything else.
        """
        senses, *rest = text.split("+")
        given: dict[str, Any] = {}
        for each in rest:
            name, _, value = each.partition(":")
            if name == "oscillators" and not value:
                given["kind"] = name
            elif name == "hidden":
                given[name] = tuple(number_in(part) for part in value.split(","))
            elif name in ("gain", "limit", "noise", "delay", "coupling"):
                given[name] = number_in(value)
            else:
                allowed = "give oscillators, hidden:8, gain:0.3, limit, noise, delay or coupling"
                raise ValueError(f"reflexes: {each!r} is not allowed; {allowed}")
        return cls(tuple(senses.split(",")), **given)


@dataclass(frozen=True, eq=False)
class Rhythms:
    """What B robots do without reflexes.

    Attributes:
        points: frequency, then amplitude, phase and offset of each drive, (B, 1 + 3 M).
        commands: over time, (B, K, M).
        span: time that each command is kept [s].
    """

    points: Floats
    commands: Floats
    span: float


def network_of(reflexes: DriveReflexes, sensed: Sensed) -> LayeredNetwork:
    """The network of some reflexes that answers for a robot's drives.

    Raises:
        ValueError: for senses without sensors, and weights that are not as many.
    """
    for name in reflexes.senses:
        if not SENSES[name].width(sensed):
            where = {"light": "a light"}.get(name, "some in the model")
            raise ValueError(f"senses: {name} is not allowed without sensors of it; give {where}")
    network = reflexes.network_of(width_of(SENSES, reflexes.senses, sensed), sensed.drives)
    reflexes.check_weights(network.weight_count)
    return network


class ReflexLoop:
    """The reflexes of B robots in a run: decides their commands, and takes derivatives back.

    Attributes:
        by_weights: derivatives of a cost by the weights, (B, K), once all decisions were taken back.
        by_points: by the points of rhythms, but through their commands, (B, 1 + 3 M).
        by_commands: by the commands of rhythms, shape as theirs.
        felt: what was felt so far at every reading, (B, width) each.
    """

    def __init__(
        self, reflexes: DriveReflexes, sensed: Sensed, weights: Floats, rhythms: Rhythms, start: Floats, seed: int = 0
    ) -> None:
        """Set up; ``start`` is the place of the bases at the start, (B, 3) or (1, 3) [m], ``seed`` that of noise."""
        self.seed = seed
        self.reflexes, self.sensed, self.weights, self.rhythms = reflexes, sensed, weights, rhythms
        first = np.broadcast_to(start, (len(weights), 3))
        self.reader = DriveReader(reflexes.senses, sensed, rhythms.span, rhythms.points, first)
        self.network = network_of(reflexes, sensed)
        self.oscillators = reflexes.oscillators_of(self.network)
        self.begin()

    def begin(self) -> None:
        """Forget what was felt and decided."""
        self._state = self._still()
        self.felt = list[Floats]()
        self._given = list[tuple[Floats, ...]]()  # to answer

    def _still(self) -> list[Floats]:
        return list(self.oscillators.start(len(self.weights))) if self.oscillators else []

    def _forget(self) -> None:
        """Begin to take derivatives back."""
        self.by_weights, self.by_points = np.zeros(self.weights.shape), np.zeros(self.rhythms.points.shape)
        self.by_commands, self._by_state = np.zeros(self.rhythms.commands.shape), self._still()
        self._by_felt = dict[int, Floats]()

    def _feel(self, number: int, felt: Felt) -> Floats:
        """What is felt at a reading, with noise, (B, width)."""
        found = self.reader.read(number, felt)
        if not self.reflexes.noise:
            return found
        # Of seed 0 these are the numbers of ``default_rng(number)``, which earlier versions drew.
        drawn = np.random.default_rng((number, self.seed)).normal(0.0, self.reflexes.noise, found.shape[1])
        return found + drawn

    def _answer(self, number: int, weights: Any, points: Any, wave: Any, felt: Any, *state: Any) -> tuple[Any, ...]:
        """A command, counted by ``number``, and the oscillators' state after it; ``wave`` is the rhythm's command."""
        if self.oscillators is None:
            added = self.network.answer(weights, felt)
        else:
            span = points[:, :1] * self.rhythms.span
            state = self.oscillators.step(weights, felt, span, *state)
            drives = points[:, 1:].reshape(len(points), self.sensed.drives, len(PARTS))
            angle = 2 * np.pi * (span * number + drives[:, :, 1])
            larger = (1.0 + state[1]) * np.sin(angle + 2 * np.pi * state[0])
            added = drives[:, :, 0] * (larger - np.sin(angle))
        low, high = np.minimum(value_of(wave), -1.0), np.maximum(value_of(wave), 1.0)
        return np.minimum(np.maximum(wave + added, low), high), *state

    def decide(self, number: int, felt: Felt) -> Floats:
        """The command of all drives, (B, M)."""
        if number == 0:
            self.begin()
        self.felt.append(self._feel(number, felt))
        late = number - self.reflexes.delay
        heard = self.felt[late] if late >= 0 else np.zeros(self.felt[0].shape)
        asked = self.weights, self.rhythms.points, self.rhythms.commands[:, number], heard, *self._state
        self._given.append(asked)
        commands, *self._state = self._answer(number, *asked)
        return np.asarray(commands)

    def pull_back(self, number: int, commands: Floats) -> Felt:
        """Derivatives by what was felt, from those by the command."""
        if number == len(self._given) - 1:
            self._forget()
        _, way = trace(partial(self._answer, number), *self._given[number])
        by_weights, by_points, by_wave, by_heard, *self._by_state = way(commands, *self._by_state)
        self._by_felt[number - self.reflexes.delay] = by_heard  # nobody hears of readings below 0
        self.by_weights += by_weights
        self.by_points += by_points
        self.by_commands[:, number] += by_wave
        felt, by_points = self.reader.pull_back(number, self._by_felt.pop(number, None))
        self.by_points += by_points
        return felt
