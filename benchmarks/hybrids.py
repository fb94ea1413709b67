"""Hybrids of evolution and gradients beside their gradient-free halves, at equal CPU time.

The small robot on flat ground: orientation, pressure and every bit of a gait of two columns are free; only true, binary
gaits count. One thread, five seeds. The runs are ordinary run folders and resume where they were cut off; a larger
``--budget`` continues them.

    python benchmarks/hybrids.py --out runs/hybrids [--budget 300] [--seeds 0,1] [--plot curves.png]
"""

import argparse
from pathlib import Path

from equal_cost import SEEDS, Contest, Entry

from optim.gait_problem import GaitProblem
from robots.terrain import Terrain

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


def main() -> None:
    """Run what is missing; then print the table, once all seeds are complete."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--budget", type=float, default=300.0, help="CPU time of each run [s] (default: 300)")
    parser.add_argument("--seeds", default=",".join(map(str, SEEDS)), help="which to run (default: all)")
    parser.add_argument("--plot", type=Path, help="file for the curves")
    args = parser.parse_args()
    contest = Contest(ENTRIES, "cpu", args.budget, args.out)
    contest.run([int(seed) for seed in args.seeds.split(",") if seed])
    if contest.complete:
        print(contest.table())
        if args.plot:
            contest.save_plot(args.plot, "speed [body lengths/s]")


if __name__ == "__main__":
    main()
