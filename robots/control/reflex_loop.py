"""The loop of feeling and answering that every kind of robot with reflexes runs, and the way back through it."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from robots.control.networks import LayeredNetwork
from robots.control.reflexes import Answering
from robots.control.senses import SenseReader
from taichi_sim.autodiff.arrays import trace
from taichi_sim.base.arrays import Floats


class AnsweringLoop:
    """The reflexes of B robots in a run: keeps what was felt and decided, and takes derivatives back.

    A kind of robot says what an answer is made of, and reads its own senses.

    Attributes:
        weights: of the network that answers, shape (B, K).
        network: that answers, or modulates the oscillators.
        oscillators: None where the network answers itself.
        reader: of the senses; while it keeps what it reads, so does the loop what it decides.
        readings: what was felt at each reading so far, noise included, shape (B, width) each.
        by_weights: derivatives of a cost by the weights, shape (B, K), once all decisions were taken back.
    """

    def __init__(self, reflexes: Answering, weights: Floats, network: LayeredNetwork, reader: SenseReader) -> None:
        """Set up, with nothing felt yet."""
        self.reflexes, self.weights, self.network, self.reader = reflexes, weights, network, reader
        self.oscillators = reflexes.oscillators_of(network)
        self._state: Sequence[Floats]
        self._by_state: Sequence[Floats]
        self.begin()

    def begin(self) -> None:
        """Forget what was felt and decided."""
        self.readings = list[Floats]()
        self._state = self.start()
        self._asked: dict[int, tuple[Floats, ...]] = {}  # what each answer was made of
        self._forget()

    def start(self) -> Sequence[Floats]:
        """The state that answers carry from each to the next, at the start: that of the oscillators, if there are any.

        All its arrays have a row for each robot.
        """
        return self.oscillators.start(len(self.weights)) if self.oscillators else ()

    def seeds_of_noise(self, number: int) -> tuple[int, ...]:
        """What the noise of a reading is drawn from."""
        raise NotImplementedError

    def answer(self, number: int, weights: Any, felt: Any, given: Sequence[Any], state: Sequence[Any]) -> Sequence[Any]:
        """What an answer decides, and after it the state that it leaves.

        Args:
            number: of the reading after which it is made.
            weights: shape (B, K).
            felt: so many readings ago as the reflexes are late, shape (B, width).
            given: what else it is made of, as it was given to ``decided``.
            state: that the answer before left.
        """
        raise NotImplementedError

    def decided(self, number: int, felt: Floats, *given: Floats) -> Sequence[Floats]:
        """What the answer after reading 0, 1, ... decides; ``felt`` is without noise, and reading 0 begins anew."""
        if number == 0:
            self.begin()
        self.readings.append(self._noisy(number, felt))
        late = number - self.reflexes.delay
        heard = self.readings[late] if late >= 0 else np.zeros(felt.shape)
        asked = self.weights, heard, *given, *self._state
        if self.reader.keeps:
            self._asked[number] = asked
        found = self._answer(number, *asked)
        decisions = len(found) - len(self._state)
        self._state = found[decisions:]
        return found[:decisions]

    def taken_back(self, number: int, *by_decided: Floats) -> tuple[Floats | None, Sequence[Floats]]:
        """Derivatives by what is felt at a reading and by what its answer was given, from those by what it decided.

        All readings in turn, the last one first. None stands for the derivatives by what nothing heard of.
        """
        if number == len(self._asked) - 1:
            self._forget()
        _, way = trace(partial(self._answer, number), *self._asked[number])
        by_weights, by_heard, *found = way(*by_decided, *self._by_state)
        given = len(found) - len(self._by_state)
        self._by_state = found[given:]
        self._by_felt[number - self.reflexes.delay] = by_heard  # nobody hears of readings below 0
        self.by_weights += by_weights
        return self._by_felt.pop(number, None), found[:given]

    def _answer(self, number: int, weights: Any, felt: Any, *others: Any) -> tuple[Any, ...]:
        given = len(others) - len(self._state)
        return tuple(self.answer(number, weights, felt, others[:given], others[given:]))

    def _forget(self) -> None:
        """Begin to take derivatives back."""
        self.by_weights = np.zeros(self.weights.shape)
        self._by_state = [np.zeros(each.shape) for each in self.start()]
        self._by_felt: dict[int, Floats] = {}

    def _noisy(self, number: int, felt: Floats) -> Floats:
        if not self.reflexes.noise:
            return felt
        drawn = np.random.default_rng(self.seeds_of_noise(number))
        return felt + drawn.normal(0.0, self.reflexes.noise, felt.shape[1])
