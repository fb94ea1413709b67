"""Compositional pattern-producing networks: patterns in space and time as a composition of simple functions.

Source: Stanley, "Compositional pattern producing networks: a novel abstraction of development", Genetic Programming
and Evolvable Machines 8, 131-162, 2007. (differs: the wiring is fixed and does not grow; a gene for each hidden node
chooses its function, so that networks are points of a space of fixed size.)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.variables import Variable

WEIGHT_LIMIT = 3.0  # weights lie between this and its negative
WEIGHT_STEP = 0.1 * WEIGHT_LIMIT  # of a mutation
GENE_STEP = 0.25  # a mutation changes a whole number where a deviate exceeds 0.5: 4.6 % of them

# What a hidden node may do with the sum of what it hears, by the number of its gene. The Gaussian and the absolute
# value make symmetry, the sine repetition, the others gradients and edges (Stanley 2007, sec. 3).
ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "linear": lambda u: u,
    "tanh": np.tanh,
    "step": lambda u: np.where(u > 0, 1.0, -1.0),
    "absolute": np.abs,
    "gaussian": lambda u: 2 * np.exp(-u * u) - 1,
    "sine": lambda u: np.sin(np.pi * u),
}


@dataclass(frozen=True)
class PatternWiring:
    """Who listens to whom: each hidden node to all inputs, each output to all hidden nodes; every node has a bias.

    Hidden nodes do not listen to each other: fitted to the published gaits, networks in which they did found them
    less often, with more weights.

    Attributes:
        inputs: names of the I coordinates, whose values are usually from -1 to 1.
        outputs: names of the O things that come out.
        hidden: number H of hidden nodes.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    hidden: int = 6

    def __post_init__(self) -> None:
        whole_number("hidden", self.hidden, 1)
        for field in ("inputs", "outputs"):
            names = getattr(self, field)
            if not names or len(set(names)) < len(names):
                raise ValueError(f"{field}: {names!r} is not allowed; give at least one name, and none twice")

    @property
    def weight_names(self) -> tuple[str, ...]:
        """``weight_NODE_SOURCE`` of every weight, node by node: hidden nodes first, of each the bias last."""
        nodes = self._hidden_names
        into_hidden = [f"weight_{node}_{source}" for node in nodes for source in (*self.inputs, "bias")]
        into_outputs = [f"weight_{node}_{source}" for node in self.outputs for source in (*nodes, "bias")]
        return (*into_hidden, *into_outputs)

    @property
    def activation_names(self) -> tuple[str, ...]:
        """Name of the gene of each hidden node: which of ``ACTIVATIONS``, counted from 0."""
        return tuple(f"activation_{node}" for node in self._hidden_names)

    def variables(self) -> list[Variable]:
        """The genome of a network as variables of a search: its weights, then the genes of its hidden nodes."""
        weights = [Variable(name, -WEIGHT_LIMIT, WEIGHT_LIMIT, step=WEIGHT_STEP) for name in self.weight_names]
        last = len(ACTIVATIONS) - 1
        return weights + [Variable(name, 0, last, "integer", step=GENE_STEP) for name in self.activation_names]

    def network(self, values: ArrayLike) -> "PatternNetwork":
        """The network of a genome, values of :meth:`variables`, shape (G,).

        Raises:
            ValueError: for another number of genes, or values that are not allowed.
        """
        genes, variables = np.array(values, float), self.variables()
        if genes.shape != (len(variables),):
            raise ValueError(f"genes: shape {genes.shape} is not allowed; give ({len(variables)},)")
        for variable, gene in zip(variables, genes.tolist(), strict=True):
            low, high, whole = variable.low, variable.high, variable.is_integer
            if not low <= gene <= high or (whole and gene % 1):
                kind = "a whole number" if whole else "a number"
                raise ValueError(f"{variable.name}: {gene:g} is not allowed; give {kind} from {low:g} to {high:g}")
        inside = self.hidden * (len(self.inputs) + 1)
        into_hidden, into_outputs, functions = np.split(genes, [inside, len(self.weight_names)])
        return PatternNetwork(
            into_hidden.reshape(self.hidden, -1),
            [list(ACTIVATIONS)[int(gene)] for gene in functions],
            into_outputs.reshape(len(self.outputs), -1),
        )

    @property
    def _hidden_names(self) -> list[str]:
        return [f"hidden{number + 1}" for number in range(self.hidden)]


@dataclass(frozen=True, eq=False)
class PatternNetwork:
    """A network, made by :meth:`PatternWiring.network`: coordinates in, patterns out.

    Attributes:
        hidden: weights of what the hidden nodes hear, the bias last, shape (H, I + 1).
        activations: names in ``ACTIVATIONS`` of the hidden nodes' functions, H of them.
        output: weights of what the outputs hear, the bias last, shape (O, H + 1).

    Example:
        >>> wiring = PatternWiring(inputs=("x",), outputs=("height",), hidden=1)
        >>> wiring.weight_names
        ('weight_hidden1_x', 'weight_hidden1_bias', 'weight_height_hidden1', 'weight_height_bias')
        >>> wiring.network([2.0, 0.0, 1.0, 0.5, 3])([[-1.0], [0.0], [0.5]]).ravel()
        array([2.5, 0.5, 1.5])
    """

    hidden: Floats
    activations: Sequence[str]
    output: Floats

    def __call__(self, coordinates: ArrayLike) -> Floats:
        """The outputs, shape (C, O), at C places, shape (C, I).

        Raises:
            ValueError: for coordinates of another shape, or that are not finite.
        """
        places, inputs = np.asarray(coordinates, float), self.hidden.shape[1] - 1
        if places.ndim != 2 or places.shape[1] != inputs or not np.isfinite(places).all():
            raise ValueError(f"coordinates: shape {places.shape}; give finite numbers of shape (places, {inputs})")
        heard = _affine(places, self.hidden)
        functions = [ACTIVATIONS[name] for name in self.activations]
        said = np.stack([function(u) for function, u in zip(functions, heard.T, strict=True)], axis=1)
        return _affine(said, self.output)


def _affine(values: Floats, weights: Floats) -> Floats:
    """Weighted sums and bias, shape (C, nodes); summed in this order, whatever the number of places."""
    return (values[:, None, :] * weights[:, :-1]).sum(axis=2) + weights[:, -1]
