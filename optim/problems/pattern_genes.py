"""The genome of a pattern-producing network as variables of a space."""

from optim.space import Variable
from robots.control.pattern import ACTIVATIONS, WEIGHT_LIMIT, PatternNetwork, PatternWiring
from taichi_sim.base.arrays import Floats

WEIGHT_STEP = 0.1 * WEIGHT_LIMIT
GENE_STEP = 0.25  # a mutation changes a gene where a deviate exceeds 0.5: 4.6 % of them


def pattern_variables(wiring: PatternWiring) -> list[Variable]:
    """Its weights, then the genes of its hidden nodes."""
    weights = [Variable(name, -WEIGHT_LIMIT, WEIGHT_LIMIT, step=WEIGHT_STEP) for name in wiring.weight_names]
    last = len(ACTIVATIONS) - 1
    genes = [Variable(name, 0, last, "integer", step=GENE_STEP) for name in wiring.activation_names]
    return weights + genes


def pattern_network(wiring: PatternWiring, values: Floats) -> PatternNetwork:
    """The network of values of :func:`pattern_variables`."""
    border = len(wiring.weight_names)
    return PatternNetwork.from_vector(wiring, values[:border], values[border:])
