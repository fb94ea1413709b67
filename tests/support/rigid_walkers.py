"""A walker of two legs for tests of rigid bodies in water and on sand, and commands that swing its legs."""

import math

import numpy as np

from taichi_sim.rigid import Body, Box, Capsule, Hinge, Motor, Sphere, Tree


def walker(radius: float = 0.06, lean: float = 0.0) -> Tree:
    """A trunk with a leg before and behind: one a ball, the other a capsule across it, which may lean by a slope."""
    trunk = Body("trunk", (0.0, 0.0, 0.31), 2.0, [Box((0.4, 0.2, 0.1))])
    front = Body("front", (0.25, 0.0, 0.1), 0.3, [Sphere(radius)])
    back = Body("back", (-0.25, 0.0, 0.09), 0.3, [Capsule(0.05, 0.2, (0.0, 1.0, lean))])
    motor = Motor(4.0, 3.0, -5.0)
    hinges = [
        Hinge("trunk", "front", (0.25, 0.0, 0.31), (0.0, 1.0, 0.0), motor, command=0),
        Hinge("trunk", "back", (-0.25, 0.0, 0.31), (0.0, 1.0, 0.0), motor, command=1),
    ]
    return Tree([trunk, front, back], hinges)


def swinging(steps: int) -> np.ndarray:
    """Commands of one walker, a row every ten steps, shape (1, steps / 10, 2)."""
    times = np.arange(steps // 10)[:, None]
    return np.sin(2 * math.pi * (0.08 * times + [0.0, 0.3]))[None]
