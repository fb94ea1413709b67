"""Functions with known optima for tests of search methods; as everything here, to be maximised."""

import numpy as np

from optim.space import Space, Variable

OPTIMUM = 1.0  # of every variable


def mixed_space(size):
    """Half continuous from -5 to 5, half whole numbers from -5 to 5, with steps of a tenth of the ranges."""
    kinds = ["continuous"] * (size - size // 2) + ["integer"] * (size // 2)
    return Space(tuple(Variable(f"x{i}", -5, 5, kind, step=1.0) for i, kind in enumerate(kinds)))


def sphere(points):
    return -np.sum((points - OPTIMUM) ** 2, axis=1)


def rosenbrock(points):
    here, after = points[:, :-1], points[:, 1:]
    return -np.sum(100 * (after - here**2) ** 2 + (1 - here) ** 2, axis=1)
