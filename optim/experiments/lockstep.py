"""Many searches side by side: what all of them ask for is judged at once."""

from collections.abc import Callable, Sequence

import numpy as np

from optim.problem import Evaluation
from optim.search.method import Method, Wants
from taichi_sim.base.arrays import Floats, Indices

Judge = Callable[[Indices, Floats, Wants], Evaluation]
Observe = Callable[[int, Floats, Evaluation], bool]


def run_in_lockstep(
    methods: Sequence[Method],
    judge: Judge,
    observe: Observe,
    budget: int,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Let every search ask, judge all points together, tell, and so on, until each is done.

    Args:
        methods: searches, not yet used, of spaces with equally many variables.
        judge: called with the number of the search that asked for each point, shape (N,), the points, shape (N, D), and
            what is wanted of them; a point's judgement must not depend on the others.
        observe: called with the number of a search, its new points and their judgement, at most ``budget`` of them in
            all, in the order asked for; returns whether the search shall end.
        budget: evaluations of each search; what a last generation has beyond it is not observed.
        progress: called with the fraction of the searches that have ended.
    """
    spent = [0] * len(methods)
    active = list(range(len(methods)))
    while active:
        asked = {index: methods[index].ask() for index in active}
        told = _judged(methods, asked, judge)
        for index, points in asked.items():
            evaluation, left = told[index], budget - spent[index]
            methods[index].tell(points, evaluation)
            spent[index] += len(points)
            ends = observe(index, points[:left], part_of(evaluation, slice(0, left)))
            if ends or spent[index] >= budget:
                active.remove(index)
        if progress:
            progress(1 - len(active) / len(methods))


def _judged(methods: Sequence[Method], asked: dict[int, Floats], judge: Judge) -> dict[int, Evaluation]:
    """The judgement of what each search has asked for; those that want the same are judged at once."""
    told: dict[int, Evaluation] = {}
    for wants in sorted({methods[index].wants for index in asked}):
        mine = [index for index in asked if methods[index].wants == wants]
        sizes = [len(asked[index]) for index in mine]
        owners = np.repeat(mine, sizes)
        evaluation = judge(owners, np.concatenate([asked[index] for index in mine]), wants)
        ends = np.cumsum(sizes)
        for index, end, size in zip(mine, ends, sizes, strict=True):
            told[index] = part_of(evaluation, slice(end - size, end))
    return told


def part_of(evaluation: Evaluation, rows: slice) -> Evaluation:
    """The judgement of some of the points."""
    return Evaluation(
        evaluation.objectives[rows],
        evaluation.status[rows],
        {name: values[rows] for name, values in evaluation.details.items()},
        None if evaluation.gradients is None else evaluation.gradients[rows],
    )
