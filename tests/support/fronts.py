"""Test problems with several objectives, and what pymoo's own NSGA-II makes of them."""

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.optimize import minimize
from pymoo.problems import get_problem

from optim.measures.pareto import hypervolume
from optim.space import Space, Variable

SIZES = {"zdt1": {"n_var": 30}, "dtlz2": {"n_var": 12, "n_obj": 3}}
POPULATION, GENERATIONS, SEEDS = 100, 150, (1, 2, 3)
MIXED = Space(
    (
        Variable("x", -2.0, 2.0),
        Variable("heading", 0.0, 360.0, "angle"),
        Variable("n", 0, 8, "integer"),
        Variable("b", 0, 1, "binary"),
    )
)


def problem(name):
    """A unit cube, and a judge of its points whose objectives are maximised."""
    posed = get_problem(name, **SIZES[name])
    space = Space(tuple(Variable(f"x{i}", 0.0, 1.0) for i in range(posed.n_var)))
    return space, lambda points: -posed.evaluate(points)


def volume(name, objectives):
    """Hypervolume above a reference a little worse than the true front."""
    return hypervolume(objectives, np.full(SIZES[name].get("n_obj", 2), -1.1))


# What pymoo 0.6.2 reaches on average; a slow test finds it again.
VOLUME_OF_PYMOO = {"zdt1": 0.86418, "dtlz2": 0.70290}


def volume_of_pymoo(name, seed):
    found = minimize(get_problem(name, **SIZES[name]), NSGA2(pop_size=POPULATION), ("n_gen", GENERATIONS), seed=seed)
    return volume(name, -found.F)


def mixed(points):
    """Two objectives at odds on the mixed space; whatever heads west fails."""
    x, heading, n, b = points.T
    turn = 1 - np.cos(np.radians(heading - 350))
    objectives = np.stack([-((x - 1) ** 2) - turn - (n - 2) ** 2, -((x + 1) ** 2) - turn - (n - 6) ** 2 + b], axis=1)
    return np.where(((heading > 200) & (heading < 300))[:, None], np.nan, objectives)


def count_of_ones():
    """A space of binaries and an integer, a judge of a single objective, and the best that there is."""
    space = Space((*(Variable(f"b{i}", 0, 1, "binary") for i in range(20)), Variable("n", 0, 50, "integer")))
    return space, lambda points: points[:, :20].sum(axis=1) - abs(points[:, 20] - 33), 20


def same(a, b):
    a, b = a.state(), b.state()
    assert all(values.dtype.kind in "fiub" for values in a.values())
    return a.keys() == b.keys() and all(
        a[key].dtype == b[key].dtype and np.array_equal(a[key], b[key], equal_nan=True) for key in a
    )
