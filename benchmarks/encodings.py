"""Direct and indirect encodings beside each other, at equal numbers of evaluations, by hill climbing.

Gaits: the small inflatable robot on flat ground; orientation, pressure and a gait of four columns are free, written as
codes, as bits or as a pattern. Walkers: bodies of 4 x 4 x 3 voxels, written voxel by voxel or as a pattern. Five seeds
each, one thread. The runs are ordinary run folders and resume where they were cut off; more generations continue them.

    python benchmarks/encodings.py --out runs/encodings [--part gaits|walkers] [--seeds 0,1] [--plot FOLDER]
"""

import argparse
from functools import partial
from pathlib import Path

from optim.experiments.equal_cost import SEEDS, Contest, Entry
from optim.problems.inflatable.problem import GaitProblem
from optim.problems.walker import WalkerProblem
from robots.world import Terrain

CLIMBERS = 16
GENERATIONS = {"gaits": 12, "walkers": 100}
SPEEDS = {"gaits": "speed [body lengths/s]", "walkers": "speed [lengths of the lattice/s]"}


def gaits(encoding: str) -> GaitProblem:
    """The robot's shape, orientation and gait."""
    return GaitProblem((Terrain(),), columns=4, repeats=1, encoding=encoding, geometry="small", threads=1)


def walkers(encoding: str) -> WalkerProblem:
    """The walker's body."""
    return WalkerProblem(encoding=encoding, threads=1)


ENTRIES = {
    "gaits": {
        name: Entry(partial(gaits, name), "hill-climb", {"climbers": CLIMBERS}) for name in ("codes", "bits", "pattern")
    },
    "walkers": {
        name: Entry(partial(walkers, name), "hill-climb", {"climbers": CLIMBERS}) for name in ("direct", "pattern")
    },
}


def main() -> None:
    """Run what is missing; then print the tables of the parts that are complete."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--part", choices=tuple(ENTRIES), help="gaits or walkers (default: both)")
    parser.add_argument("--seeds", default=",".join(map(str, SEEDS)), help="which to run (default: all)")
    parser.add_argument(
        "--generations", type=int, help="after the random starts (default: 12 of gaits, 100 of walkers)"
    )
    parser.add_argument("--plot", type=Path, help="folder for the curves")
    args = parser.parse_args()
    for part in [args.part] if args.part else ENTRIES:
        generations = GENERATIONS[part] if args.generations is None else args.generations
        contest = Contest(ENTRIES[part], "evaluations", CLIMBERS * (generations + 1), args.out / part)
        contest.run([int(seed) for seed in args.seeds.split(",") if seed])
        if contest.complete:
            print(f"\n{part}\n\n{contest.table()}")
            if args.plot:
                contest.save_plot(args.plot / f"{part}.png", SPEEDS[part])


if __name__ == "__main__":
    main()
