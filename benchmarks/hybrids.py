"""Hybrids of evolution and gradients beside their gradient-free halves, at equal CPU time.

The small robot on flat ground: orientation, pressure and every bit of a gait of two columns are free; only true, binary
gaits count. One thread, five seeds. The runs are ordinary run folders and resume where they were cut off; a larger
``--budget`` continues them.

    python benchmarks/hybrids.py --out runs/hybrids [--budget 300] [--seeds 0,1] [--plot curves.png]
"""

from equal_cost import Entry, compare_at_equal_cpu_time

from optim.problems.inflatable.problem import GaitProblem
from robots.world import Terrain

POPULATION = 16  # robots that are simulated side by side


def gaits() -> GaitProblem:
    """What is designed."""
    return GaitProblem((Terrain(),), columns=2, repeats=1, encoding="bits", geometry="small", threads=1)


ENTRIES = {
    "CMA-ES": Entry(gaits, "cma", {"population": POPULATION}),
    "CMA-ES led by gradients": Entry(gaits, "cma-gradient", {"population": POPULATION, "every": 3}),
    "differential evolution": Entry(gaits, "de", {"population": POPULATION}),
    "memetic search": Entry(gaits, "memetic", {"population": POPULATION, "refine": 16, "every": 4}),
}


if __name__ == "__main__":
    compare_at_equal_cpu_time(__doc__, ENTRIES)
