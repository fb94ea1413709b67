"""The operators of the Borg MOEA: children of several parents, all in the unit cube.

Sources: Hadka & Reed, Borg: an auto-adaptive many-objective evolutionary computing framework, Evolutionary Computation
21(2), 2013, section 3, which took them from: Deb & Agrawal 1994 (SBX, polynomial mutation), Storn & Price 1997
(DE), Deb, Joshi & Anand 2002 (PCX), Tsutsui, Yamamura & Higuchi 1999 (SPX), Kita, Ono & Kobayashi 1999 (UNDX).
"""

from dataclasses import dataclass, fields

import numpy as np

from optim.search.unit_cube import into_cube, mutate_in_cube, out_of_cube
from optim.space import Space
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

OPERATORS = ("sbx", "de", "pcx", "spx", "undx", "um")
SMALL = 1e-12  # of the cube: shorter vectors have no direction


@dataclass(frozen=True)
class OperatorParameters:
    """Parameters of the operators; the defaults are those published with the Borg MOEA.

    Attributes:
        parents: P, the number of parents of a child of PCX, SPX and UNDX.
        sbx_index: distribution index of SBX.
        de_rate: crossover rate of DE.
        de_step: step size of DE.
        pcx_zeta: standard deviation of PCX along the line from the centroid to the chosen parent.
        pcx_eta: standard deviation of PCX across that line, in mean distances of the other parents from it.
        spx_expansion: factor by which SPX expands the simplex.
        undx_zeta: standard deviation of UNDX along the vectors from the centroid to its parents.
        undx_eta: standard deviation of UNDX across these, in distances of the last parent, times sqrt(D).
        mutation_index: distribution index of polynomial mutation.
    """

    parents: int = 10
    sbx_index: float = 15.0
    de_rate: float = 0.1
    de_step: float = 0.5
    pcx_zeta: float = 0.1
    pcx_eta: float = 0.1
    spx_expansion: float = 3.0
    undx_zeta: float = 0.5
    undx_eta: float = 0.35
    mutation_index: float = 20.0

    def __post_init__(self) -> None:
        checks.integer("parents", self.parents, 3, 1000)
        for field in fields(self)[1:]:
            checks.number(field.name, getattr(self, field.name), 0, 1 if field.name == "de_rate" else 1000)

    def count(self, operator: str) -> int:
        """Return the number of parents that a child of an operator has."""
        return {"sbx": 2, "de": 4, "um": 1}.get(operator, self.parents)


def breed(
    space: Space, operator: str, parents: Floats, parameters: OperatorParameters, rng: np.random.Generator
) -> Floats:
    """Breed one child, shape (M, D), from each of M matings of parents, shape (P, M, D); all but those of UM mutate.

    Coordinates beyond a bound are set to it; angles wrap; whole numbers are rounded.
    """
    if operator == "um":
        return uniform_mutation(space, parents[0], rng)
    p, unit = parameters, into_cube(space, parents, parents[0])
    match operator:
        case "sbx":
            children = simulated_binary(unit, p.sbx_index, rng)
        case "de":
            children = differential_evolution(unit, p.de_rate, p.de_step, rng)
        case "pcx":
            children = parent_centric(unit, p.pcx_zeta, p.pcx_eta, rng)
        case "spx":
            children = simplex(unit, p.spx_expansion, rng)
        case _:
            children = unimodal_normal(unit, p.undx_zeta, p.undx_eta, rng)
    children = out_of_cube(space, children, parents[0])
    return mutate_in_cube(space, children, lambda inside: polynomial_mutation(inside, p.mutation_index, rng))


def simulated_binary(parents: Floats, index: float, rng: np.random.Generator) -> Floats:
    """SBX of two parents, shape (2, M, D): each variable with probability 1/2; one of the two children."""
    first, second = parents
    u = rng.random(first.shape)
    spread = np.where(u <= 0.5, 2 * u, 1 / (2 * (1 - u))) ** (1 / (index + 1))  # beta
    side = np.where(rng.random(first.shape) < 0.5, 1.0, -1.0)  # children exchange variables
    crossed = 0.5 * (first + second + side * spread * (first - second))
    return np.where(rng.random(first.shape) < 0.5, crossed, first)


def differential_evolution(parents: Floats, rate: float, step: float, rng: np.random.Generator) -> Floats:
    """DE/rand/1/bin of four parents, shape (4, M, D): the first, crossed with a donor of the others."""
    target, base, plus, minus = parents
    donor = base + step * (plus - minus)
    return np.where(_chosen(target.shape, rate, rng), donor, target)


def parent_centric(parents: Floats, zeta: float, eta: float, rng: np.random.Generator) -> Floats:
    """PCX of P parents, shape (P, M, D): normal deviates about one of them, each as likely."""
    count, matings, size = parents.shape
    offsets = parents - parents.mean(axis=0)
    index = rng.integers(count, size=matings)
    chosen, along = (values[index, np.arange(matings)] for values in (parents, offsets))
    line = _basis(along[None])
    distance = np.linalg.norm(_across(offsets, line), axis=-1).sum(axis=0) / (count - 1)
    across = _across(rng.standard_normal((matings, size)), line)
    return chosen + zeta * rng.standard_normal((matings, 1)) * along + eta * distance[:, None] * across


def simplex(parents: Floats, expansion: float, rng: np.random.Generator) -> Floats:
    """SPX of P parents, shape (P, M, D): uniform in their simplex, expanded about the centroid."""
    centroid = parents.mean(axis=0)
    corners = centroid + expansion * (parents - centroid)
    inside = np.zeros_like(centroid)
    for k in range(1, len(parents)):
        r = rng.random((parents.shape[1], 1)) ** (1 / k)
        inside = r * (corners[k - 1] - corners[k] + inside)
    return corners[-1] + inside


def unimodal_normal(parents: Floats, zeta: float, eta: float, rng: np.random.Generator) -> Floats:
    """UNDX-m of P parents, shape (P, M, D): normal deviates about the centroid of all but the last.

    Along the vectors from there to these parents, and across them as far as the last parent is away.
    """
    _, matings, size = parents.shape
    centroid = parents[:-1].mean(axis=0)
    offsets = parents[:-1] - centroid
    plane = _basis(offsets)
    distance = np.linalg.norm(_across(parents[-1] - centroid, plane), axis=-1)[:, None]
    along = np.sum(zeta * rng.standard_normal((len(offsets), matings, 1)) * offsets, axis=0)
    across = _across(rng.standard_normal((matings, size)), plane)
    return centroid + along + eta / np.sqrt(size) * distance * across


def polynomial_mutation(points: Floats, index: float, rng: np.random.Generator) -> Floats:
    """Points of the unit cube, shape (M, D), each variable changed with probability 1/D; they stay in the cube."""
    u = rng.random(points.shape)
    power = 1 / (index + 1)
    down = (2 * u + (1 - 2 * u) * (1 - points) ** (index + 1)) ** power - 1
    up = 1 - (2 * (1 - u) + (2 * u - 1) * points ** (index + 1)) ** power
    moved = np.clip(points + np.where(u < 0.5, down, up), 0, 1)
    return np.where(rng.random(points.shape) < 1 / points.shape[1], moved, points)


def uniform_mutation(space: Space, points: Floats, rng: np.random.Generator) -> Floats:
    """Points, shape (M, D), at least one variable of each drawn anew, the others with probability 1/D."""
    return np.where(_chosen(points.shape, 1 / space.size, rng), space.sample(rng, len(points)), points)


def _chosen(shape: tuple[int, ...], rate: float, rng: np.random.Generator) -> np.ndarray:
    """Which variables are chosen with a probability, and one at random in any case, shape (M, D)."""
    return (rng.random(shape) < rate) | (np.arange(shape[1]) == rng.integers(shape[1], size=(shape[0], 1)))


def _basis(vectors: Floats) -> Floats:
    """Orthonormal vectors that span those given, shape (V, M, D); zero where one depends on those before it."""
    basis = np.zeros_like(vectors)
    for i, vector in enumerate(vectors):
        rest = _across(_across(vector, basis[:i]), basis[:i])  # twice, against rounding
        length = np.linalg.norm(rest, axis=-1, keepdims=True)
        new = length > np.maximum(1e-9 * np.linalg.norm(vector, axis=-1, keepdims=True), SMALL)
        basis[i] = np.where(new, rest / np.where(new, length, 1.0), 0.0)
    return basis


def _across(vectors: Floats, basis: Floats) -> Floats:
    """Parts of vectors, shape (..., M, D), that are orthogonal to a basis, shape (V, M, D)."""
    for direction in basis:
        vectors = vectors - (vectors * direction).sum(axis=-1, keepdims=True) * direction
    return vectors
