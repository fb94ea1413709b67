"""Settings of published experiments: what they are, beside what their source says of two weights from -1 to 1."""

import math

import numpy as np
import pytest

from optim.problem import Evaluation
from optim.search import build_method
from optim.search.published import BLACK_BOX_OPTIM
from optim.space import Space, Variable

SOLVED = 0.16
WEIGHTS = Space((Variable("w1", -1.0, 1.0), Variable("w2", -1.0, 1.0)))


def trainer(name, seed=0):
    return build_method(name, WEIGHTS, {**BLACK_BOX_OPTIM[name], "seed": seed})


def judge(points):
    """Flat, with a slope to a disk of a fiftieth of the square, where the task is solved."""
    return -np.clip(np.hypot(points[:, 0] - 0.6, points[:, 1] + 0.5), SOLVED, 0.8)


def evaluations_until_solved(name, seed):
    method, count = trainer(name, seed), 0
    while count <= 500:
        points = method.ask()
        count += len(points)
        if (judge(points) == -SOLVED).any():
            return count
        method.tell(points, Evaluation(judge(points)))
    return 500


@pytest.mark.parametrize(("name", "first"), [("random", 1), ("generating-set", 1), ("nes", 6), ("de", 2)])
def test_methods_ask_for_as_many_points_as_a_step_of_theirs_has(name, first):
    assert len(trainer(name).ask()) == first
    assert len(np.unique([trainer(name, seed).ask()[0] for seed in range(5)], axis=0)) == 5


def test_lengths_are_those_of_the_source_in_weights():
    search, nes = trainer("generating-set"), trainer("nes")
    assert search._lengths(search.step) == pytest.approx([1.0, 1.0])
    assert search.tolerance * 2 == pytest.approx(1e-10)
    assert nes.deviation * WEIGHTS.span == pytest.approx([1.0, 1.0])
    assert nes.population == 4 + math.ceil(math.log(3 * WEIGHTS.size))


def test_a_search_that_only_succeeds_takes_as_long_to_contract():
    """Its step is not limited: 60 doublings are undone by 60 polls of 4 before it contracts below its first."""
    method = trainer("generating-set")
    for score in range(61):
        method.tell(method.ask(), Evaluation([float(score)]))
    assert method.steps[0] == pytest.approx(0.5 * 2.0**60)
    for _ in range(4 * 61):
        method.tell(method.ask(), Evaluation([0.0]))
    assert method.steps[0] == pytest.approx(0.25)


@pytest.mark.long
def test_trainers_solve_an_easy_task_within_the_budget():
    """Random search needs 50 evaluations on average; means over these 40 seeds were 38, 37, 30 and 48."""
    means = {name: np.mean([evaluations_until_solved(name, seed) for seed in range(40)]) for name in BLACK_BOX_OPTIM}
    assert all(20 < mean < 60 for mean in means.values()), means
