"""Functions with known optima for tests of search methods; as everything here, to be maximised."""

import numpy as np

from optim.space import Space, Variable

OPTIMUM = 1.0  # of every variable


def mixed_space(size):
    """Half continuous from -5 to 5, half whole numbers from -5 to 5, with steps of a tenth of the ranges."""
    kinds = ["continuous"] * (size - size // 2) + ["integer"] * (size // 2)
    return Space(tuple(Variable(f"x{i}", -5, 5, kind, step=1.0) for i, kind in enumerate(kinds)))


def continuous_space(size):
    return Space(tuple(Variable(f"x{i}", -5.0, 5.0, step=0.5) for i in range(size)))


def sphere(points):
    return -np.sum((points - OPTIMUM) ** 2, axis=1)


def rosenbrock(points, curvature=100.0):
    valley = points[:, 1:] - points[:, :-1] ** 2
    return -np.sum(curvature * valley**2 + (1 - points[:, :-1]) ** 2, axis=1)


def rosenbrock_slope(points, curvature=100.0):
    valley = points[:, 1:] - points[:, :-1] ** 2
    slope = np.zeros_like(points)
    slope[:, 1:] -= 2 * curvature * valley
    slope[:, :-1] += 4 * curvature * valley * points[:, :-1] + 2 * (1 - points[:, :-1])
    return slope
