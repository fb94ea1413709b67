"""Networks in the loop as torch modules, and back: to train weights elsewhere, or to go on from what was found here.

It imports torch, as only the ``autograd`` modules do besides.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import nn

from robots.control.networks import LayeredNetwork
from taichi_sim.base import checks

ALLOWED = "give a Sequential of Linear layers, each with a bias and followed by a Tanh"


def to_torch(network: LayeredNetwork, weights: ArrayLike) -> nn.Sequential:
    """A network as ``Linear`` layers, each followed by ``Tanh``, in f64, with weights of one robot, shape (K,).

    Its outputs times the network's gain are the network's answers.

    Raises:
        ValueError: for other weights.
    """
    given = checks.numbers("weights", weights, network.weight_count)
    parts, first = list[nn.Module](), 0
    for rows, columns in network.shapes:
        layer = torch.from_numpy(given[first : first + rows * columns].reshape(rows, columns))
        linear = nn.Linear(columns - 1, rows, dtype=torch.float64)
        with torch.no_grad():
            linear.weight.copy_(layer[:, :-1])
            linear.bias.copy_(layer[:, -1])
        parts += [linear, nn.Tanh()]
        first += rows * columns
    return nn.Sequential(*parts)


def from_torch(module: Any, gain: float = 1.0) -> tuple[LayeredNetwork, tuple[float, ...]]:
    """The network of a module, and its weights, K of them: the other way round.

    Args:
        module: ``Linear`` layers, each with a bias and followed by ``Tanh``, in a ``Sequential``.
        gain: of the network; a module has none.

    Raises:
        ValueError: for any other module, and weights that are not finite.
    """
    if not isinstance(module, nn.Sequential) or not len(module) or len(module) % 2:
        raise ValueError(f"module: {_class_name(module)} is not allowed; {ALLOWED}")
    sizes, rows = list[int](), list[np.ndarray]()
    for place, part in enumerate(module):
        if type(part) is not (nn.Tanh if place % 2 else nn.Linear):
            raise ValueError(f"module: {_class_name(part)} at place {place} is not allowed; {ALLOWED}")
        if isinstance(part, nn.Linear):
            if part.bias is None or (sizes and part.in_features != sizes[-1]):
                raise ValueError(f"module: {_class_name(part)} at place {place} is not allowed; {ALLOWED}")
            sizes += [part.out_features] if sizes else [part.in_features, part.out_features]
            pair = part.weight, part.bias[:, None]
            rows.append(torch.cat(pair, dim=1).detach().to("cpu", torch.float64).numpy().ravel())
    weights = checks.numbers("weights", np.concatenate(rows), "K")
    inputs, *hidden, outputs = sizes
    return LayeredNetwork(inputs, outputs, tuple(hidden), gain), tuple(weights.tolist())


def _class_name(module: object) -> str:
    return type(module).__name__
