"""Networks in the loop: what robots of a batch make of what they feel, each with weights of its own.

Differentiable by ``taichi_sim.autodiff.arrays.trace``: by the weights, and through what is felt.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

import numpy as np

from taichi_sim.base import checks


def layers(field_name: str, value: Any) -> tuple[int, ...]:
    """Nodes of hidden layers.

    Raises:
        ValueError: for anything else, and layers without nodes.
    """
    if not isinstance(value, list | tuple):
        raise ValueError(f"{field_name}: {value!r} is not allowed; give nodes of each layer, such as (8,)")
    return tuple(checks.whole_number(field_name, each, 1, 1000) for each in value)


def several_numbers(field_name: str, value: Any) -> tuple[float, ...] | None:
    """Numbers, as weights are given; or None.

    Raises:
        ValueError: for anything else.
    """
    if value is None:
        return None
    if not isinstance(value, list | tuple):
        raise ValueError(f"{field_name}: {value!r} is not allowed; give several numbers")
    return tuple(checks.number(field_name, each) for each in value)


@dataclass(frozen=True)
class LayeredNetwork:
    """A network of layers, each of whose nodes listens to all of the layer before and has a bias.

    Every layer ends in a hyperbolic tangent; without hidden layers the answer is linear in what is felt, within it.
    Weights are a row of numbers: layers one after the other, of each the rows of its matrix, with the bias last in
    every row.

    Attributes:
        inputs: how many numbers are felt.
        outputs: how many numbers are answered.
        hidden: nodes of hidden layers.
        gain: most that is answered, either way.

    Example:
        >>> network = LayeredNetwork(inputs=2, outputs=1, hidden=(3,))
        >>> network.shapes
        [(3, 3), (1, 4)]
        >>> network.answer(np.zeros((5, network.weight_count)), np.ones((5, 2))).shape
        (5, 1)
    """

    inputs: int
    outputs: int
    hidden: Annotated[tuple[int, ...], layers] = ()
    gain: checks.NotNegative = 1.0

    def __post_init__(self) -> None:
        checks.check_fields(self)
        for name in ("inputs", "outputs"):
            checks.whole_number(name, getattr(self, name), 1)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shapes of the layers' weights, with a column for the bias."""
        return [(after, before + 1) for before, after in pairwise((self.inputs, *self.hidden, self.outputs))]

    @property
    def weight_count(self) -> int:
        """How many weights there are, K."""
        return sum(rows * columns for rows, columns in self.shapes)

    def answer(self, weights: Any, felt: Any) -> Any:
        """What B robots with weights (B, K) make of what they feel, shape (B, inputs): shape (B, outputs)."""
        value, first = felt, 0
        for number, (rows, columns) in enumerate(self.shapes):
            layer = weights[:, first : first + rows * columns].reshape(len(felt), rows, columns)
            value = (layer[:, :, :-1] * value[:, None, :]).sum(axis=2) + layer[:, :, -1]
            value = np.tanh(value) if number < len(self.shapes) - 1 else value
            first += rows * columns
        return self.gain * np.tanh(value)
