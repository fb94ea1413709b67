"""How tests drive a search method, a space with a variable of every kind, and one of cells in a plane."""

import numpy as np

from optim.problem import Evaluation
from optim.space import Space, Variable

EVERYTHING = Space(
    (
        Variable("x", -2.0, 6.0),
        Variable("a", -180.0, 180.0, "angle"),
        Variable("n", -3, 4, "integer"),
        Variable("b", 0, 1, "binary"),
    )
)
SIDES = (5, 4)
PLACES = [(x, y) for x in range(SIDES[0]) for y in range(SIDES[1])]
CELL_GRID = Space(
    (
        Variable("alone", 0.0, 1.0),
        *(Variable(f"there_{x}_{y}", 0, 1, "binary", place=(x, y)) for x, y in PLACES),
        *(Variable(f"size_{x}_{y}", 0.0, 10.0, step=0.5, place=(x, y)) for x, y in PLACES),
        *(Variable(f"turn_{x}_{y}", 0.0, 1.0, "angle", step=0.1, place=(x, y)) for x, y in PLACES),
    )
)


def run(method, judge, generations):
    """So many generations more; asking changes nothing."""
    for _ in range(generations):
        points = method.ask()
        assert np.array_equal(points, method.ask())
        method.space.validate(points)
        method.tell(points, Evaluation(judge(points)))
    return method


def run_up_to(method, judge, generations, target=np.inf):
    """Until so many generations have been made since the beginning, or the best is above the target."""
    while method.generation < generations and not method.best_score > target:
        run(method, judge, 1)
    return method
