"""Co-design by gradients beside hill climbing, at equal CPU time: the small robot on flat ground, from random gaits.

Every method designs orientation, pressure and a gait of two columns, on one thread, until it has used the same CPU
time; five seeds each. Only true, binary gaits count, judged by the same simulation. The runs are ordinary run folders
and resume where they were cut off; a larger ``--budget`` continues them.

    python benchmarks/gradient_codesign.py --out runs/gradients [--budget 300] [--seeds 0,1] [--plot curves.png]
"""

from equal_cost import Entry, compare_at_equal_cpu_time

from optim.problems.inflatable.problem import GaitProblem
from robots.world import Terrain


def problem() -> GaitProblem:
    """What is designed."""
    return GaitProblem((Terrain(),), columns=2, repeats=1, encoding="bits", geometry="small", threads=1)


ENTRIES = {
    "hill climbing": Entry(problem, "hill-climb", {"climbers": 16}),
    "exact gradient": Entry(problem, "gradient", {"climbers": 16, "learning_rate": 0.15, "verify": True, "stage": 4}),
    "smoothed gradient": Entry(
        problem,
        "gradient",
        {
            "climbers": 2,
            "gradient": "smoothed",
            "samples": 4,
            "smoothing": 0.1,
            "learning_rate": 0.1,
            "verify": True,
            "stage": 10,
        },
    ),
}


if __name__ == "__main__":
    compare_at_equal_cpu_time(__doc__, ENTRIES)
