"""Reflexes of any robot: what answers what it feels, a network, or oscillators that a network modulates."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

from robots.control.networks import LayeredNetwork, layers, several_numbers
from robots.control.oscillators import PARTS, STRONGEST, Oscillators
from taichi_sim.base import checks


def senses_among(names: Collection[str]) -> Callable[[str, Any], tuple[str, ...]]:
    """Make the check of a field that holds one or more of these names, none twice."""

    def check(field_name: str, value: Any) -> tuple[str, ...]:
        if isinstance(value, str) or not isinstance(value, Collection) or not value or len(set(value)) < len(value):
            allowed = f"give one or more of {', '.join(names)}, none twice"
            raise ValueError(f"{field_name}: {value!r} is not allowed; {allowed}")
        return tuple(checks.choice(field_name, each, names) for each in value)

    return check


@dataclass(frozen=True)
class Answering:
    """What a robot feels, and what answers; its weights are free. Each kind of robot has senses of its own.

    Attributes:
        senses: names of what is felt.
        hidden: nodes of hidden layers, whose output is a hyperbolic tangent; none make a linear answer.
        gain: most by which an answer changes what drives the robot; of oscillators, most by which their rate and
            amplitude change relative to those of the wave, and most of a phase [cycles].
        limit: of weights, either way.
        weights: of all layers; None are free.
        noise: standard deviation of every number that is felt.
        delay: how many readings ago was what is felt; before there are any, nothing is.
        kind: ``"network"``, or ``"oscillators"``, one for each answer: see ``robots.control.oscillators``.
        coupling: of oscillators; None is theirs by default.
    """

    senses: tuple[str, ...] = ()
    hidden: Annotated[tuple[int, ...], layers] = ()
    gain: checks.NotNegative = 0.1
    limit: checks.NotNegative = 2.0
    weights: Annotated[tuple[float, ...], several_numbers] | None = None
    noise: checks.NotNegative = 0.0
    delay: Annotated[int, partial(checks.whole_number, low=0)] = 0
    kind: Literal["network", "oscillators"] = "network"
    coupling: Annotated[float, partial(checks.number, low=0.0, high=STRONGEST)] | None = None

    def __post_init__(self) -> None:
        checks.check_fields(self)
        if self.coupling is not None and self.kind == "network":
            raise ValueError(f"coupling: {self.coupling:g} is not allowed with a network; give it with oscillators")

    @property
    def spoken(self) -> str:
        """The reflexes in words, such as ``"feels strain and clock, 8 hidden nodes"``."""
        *others, last = self.senses
        senses = f"{', '.join(others)} and {last}" if others else last
        hidden = f", {', '.join(map(str, self.hidden))} hidden nodes" if self.hidden else ""
        late = f", {self.delay} reading{'s' * (self.delay > 1)} late" if self.delay else ""
        coupled = ", coupled oscillators" if self.kind == "oscillators" else ""
        return f"feels {senses}{late}{hidden}{coupled}"

    def network_of(self, felt: int, answers: int) -> LayeredNetwork:
        """What answers so many numbers, or modulates so many oscillators, by so many that are felt."""
        outputs = answers if self.kind == "network" else PARTS * answers
        return LayeredNetwork(felt, outputs, self.hidden, self.gain)

    def oscillators_of(self, network: LayeredNetwork) -> Oscillators | None:
        """The oscillators that a network modulates; None where it answers itself."""
        given = {} if self.coupling is None else {"coupling": self.coupling}
        return Oscillators(network, **given) if self.kind == "oscillators" else None

    def check_weights(self, count: int) -> None:
        """Refuse weights that are not so many.

        Raises:
            ValueError: that tells how many there are, and should be.
        """
        if self.weights is not None and len(self.weights) != count:
            raise ValueError(f"weights: {len(self.weights)} are not allowed; give {count}")
