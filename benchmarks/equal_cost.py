"""The command line of benchmarks that compare gait searches at equal CPU time."""

import argparse
from collections.abc import Mapping
from pathlib import Path

from optim.experiments.equal_cost import SEEDS, Contest, Entry

__all__ = ["Contest", "Entry", "compare_at_equal_cpu_time"]


def compare_at_equal_cpu_time(description: str | None, entries: Mapping[str, Entry]) -> None:
    """The command line of a comparison of gait searches: run what is missing; print the table once all is complete."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--budget", type=float, default=300.0, help="CPU time of each run [s] (default: 300)")
    parser.add_argument("--seeds", default=",".join(map(str, SEEDS)), help="which to run (default: all)")
    parser.add_argument("--plot", type=Path, help="file for the curves")
    args = parser.parse_args()
    contest = Contest(entries, "cpu", args.budget, args.out)
    contest.run([int(seed) for seed in args.seeds.split(",") if seed])
    if contest.complete:
        print(contest.table())
        if args.plot:
            contest.save_plot(args.plot, "speed [body lengths/s]")
