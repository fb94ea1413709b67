"""Designing robots: problems, search methods and runs. Knows robots only through problems."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from optim.maximising import Maximum as Maximum
    from optim.maximising import maximise as maximise
    from optim.problem import Evaluation as Evaluation
    from optim.problem import Problem as Problem
    from optim.problems.function import problem_of as problem_of
    from optim.space import Space as Space
    from optim.space import Variable as Variable

__getattr__, __dir__, __all__ = exported_names(__name__)
