"""How tests drive a search method, and a space with a variable of every kind."""

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
