"""Functions that searches are measured on, all to be maximised, with the summit 0 at ones."""

import numpy as np

from optim.space import Space, Variable


def mixed_space(size):
    """Continuous variables from -5 to 5, then as many integers."""
    half = size // 2
    continuous = tuple(Variable(f"x{i}", -5.0, 5.0, step=0.5) for i in range(half))
    return Space((*continuous, *(Variable(f"n{i}", -5, 5, "integer", step=0.9) for i in range(half, size))))


def continuous_space(size):
    return Space(tuple(Variable(f"x{i}", -5.0, 5.0, step=0.5) for i in range(size)))


def sphere(points):
    return -np.sum((points - 1) ** 2, axis=1)


def rosenbrock(points, curvature=100.0):
    valley = points[:, 1:] - points[:, :-1] ** 2
    return -np.sum(curvature * valley**2 + (1 - points[:, :-1]) ** 2, axis=1)


def rosenbrock_slope(points, curvature=100.0):
    valley = points[:, 1:] - points[:, :-1] ** 2
    slope = np.zeros_like(points)
    slope[:, 1:] -= 2 * curvature * valley
    slope[:, :-1] += 4 * curvature * valley * points[:, :-1] + 2 * (1 - points[:, :-1])
    return slope
