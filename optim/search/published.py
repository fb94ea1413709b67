"""Settings of search methods that repeat published experiments.

Source of the defaults: https://github.com/robertfeldt/BlackBoxOptim.jl, the files and commits named below. The
experiment (Powers 2021 dissertation, ch. 4, "Training"; its program: https://github.com/jpp46/ARXIV2021) searched two
weights from -1 to 1 by at most 500 evaluations. There, lengths were in units of the weights; here they are in ranges,
each of which is 2 such units. The ``PopSize=10`` that the program asked for is no setting of that package: its logs
show the 6 points of natural evolution, and as many evaluations of members as 50 members need.

How the experiment counted: after every step of a method (a random point; a poll, to its first success; the 6 points of
natural evolution; a trial, with its member while that has no score) it looked whether the best point so far, by its
loss, solved the whole task, and noted the evaluations until then. The last step is the first to go beyond 500.

Differences that remain:

- ``nes``: equal scores share their utilities; there each got that of its rank.
- ``de``: starts are drawn independently; there they were a Latin hypercube sample.
- ``generating-set``: a start is asked for and counted alone; there it was part of the step of its first poll.
- All: a failure is never better than anything, and a ``generating-set`` start that failed gives way to another.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

BLACK_BOX_OPTIM: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        # random_search (random_search.jl, dbcf12f): one uniform point a step
        "random": {"climbers": 1},
        # generating_set_search (generating_set_search.jl, aa08de7, GSSDefaultParameters; random_bound.jl, 15e89e0)
        "generating-set": {
            "climbers": 1,
            "directions": "axes",  # compass_search_directions, RandomDirectionOrder
            "step": 0.5,  # InitialStepSizeFactor, of the smallest range
            "expansion": 2.0,  # StepSizeGamma
            "contraction": 0.5,  # StepSizePhi
            "tolerance": 0.5e-10,  # DeltaTolerance 1e-10
            "max_step": 1e300,  # StepSizeMax: the largest number
            "polled": 1,  # a poll ends with the first success
        },
        # separable_nes (natural_evolution_strategies.jl, 00c4624, NES_DefaultOptions; random_bound.jl)
        "nes": {
            "population": 6,  # lambda = 4 + ceil(log(3 D)) of 2 variables
            "sigma": 0.5,  # 1
            "max_sigma": 0.5e10,  # max_sigma 1e10
            "random_mean": True,  # ini_x
            "mirrored": False,
            "bounds": "random",  # RandomBound
        },
        # de_rand_2_bin (differential_evolution.jl, dbcf12f; differential_evolution_crossover.jl, 12b04d6)
        "de": {
            "strategy": "rand/2/bin",
            "population": 50,  # PopulationSize (default_parameters.jl, 88a8837)
            "weight": 0.6,  # DEX_f of DEX_DefaultOptions
            "dither": 0.0,
            "crossover": 0.7,  # DEX_cr
            "trials": 1,  # ask
            "bounds": "random",  # random_bound.jl
        },
    }
)
