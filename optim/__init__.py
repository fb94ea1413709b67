"""Designing robots: problems, search methods and runs. Knows robots only through problems."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported

if TYPE_CHECKING:
    from optim.maximising import Maximum as Maximum
    from optim.maximising import maximise as maximise
    from optim.problem import Evaluation as Evaluation
    from optim.problem import Problem as Problem
    from optim.problems.function import problem_of as problem_of
    from optim.space import Space as Space
    from optim.space import Variable as Variable

_PLACES = {
    "Evaluation": "optim.problem",
    "Maximum": "optim.maximising",
    "Problem": "optim.problem",
    "Space": "optim.space",
    "Variable": "optim.space",
    "maximise": "optim.maximising",
    "problem_of": "optim.problems.function",
}
__all__ = ["Evaluation", "Maximum", "Problem", "Space", "Variable", "maximise", "problem_of"]
__getattr__ = exported(__name__, _PLACES)
