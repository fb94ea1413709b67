"""Settings of searches for freeform robots, tried on a block that their comparison does not use, for equal CPU time.

python benchmarks/freeform_tuning.py --out runs/freeform-tuning

Writes tuning.csv: the best score of each, after 90 s with one seed. Runs go on where they ended. The best settings of
each method are those of ``morpholab reproduce freeform``.
"""

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from optim.experiments.equal_cost import Contest, Entry
from optim.experiments.judged_runs import warm_up
from optim.experiments.tables import Record, write_records
from optim.studies.beyond.freeform import designed
from optim.studies.beyond.freeform_problems import ARMS, PROBLEMS

SEED = 100
# Tried beside the settings of the study, from which they differ so.
OTHERS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "race": (
        {"climbers": 8, "halving": 6},
        {"climbers": 8, "halving": 6, "learning_rate": 0.1},
        {"climbers": 4, "halving": 6},
        {"climbers": 8, "halving": 4, "learning_rate": 0.07, "moves": 80},
    ),
    "genetic": (
        {"mutation": 1 / 320},
        {"mutation": 0.02},
        {"population": 16, "mutation": 0.02},
        {"crossover": 0.5, "mutation": 0.02, "elites": 32},
        {"patches": 0.5},
        {"mutation": 1 / 320, "patches": 1.0},
    ),
    "hill-climb": ({"climbers": 16}, {"climbers": 8}, {"climbers": 4}, {"climbers": 2}),
    "nes": (
        {"population": 32, "random_mean": False, "sigma": 0.3},
        {"random_mean": False, "sigma": 0.3},
        {"population": 32},
        {"random_mean": False},
    ),
    "cma": (
        {"random_mean": False, "sigma": 0.3},
        {"population": 32, "random_mean": False, "sigma": 0.3},
        {"population": 8, "random_mean": False, "sigma": 0.3},
        {"sigma": 0.3},
        {"population": 8, "sigma": 0.3},
        {"random_mean": False},
        {"population": 8},
        {"population": 32},
    ),
}


def main() -> None:
    """Try all settings, or those of some methods."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs and of tuning.csv")
    parser.add_argument("--methods", nargs="+", choices=OTHERS, default=list(OTHERS), help="(default: all)")
    given = parser.parse_args()
    rows: list[Record] = []
    for name in given.methods:
        for number, others in enumerate(({}, *OTHERS[name])):
            arm, label = ARMS[name], f"{name}-{number}"
            settings = {**arm.settings, **others}
            entry = Entry(partial(designed, "tuning"), arm.method, settings)
            contest = Contest({label: entry}, "cpu", PROBLEMS["tuning"].seconds, given.out / "runs")
            warm_up(entry.problem(), arm.gradients)
            contest.run_one(label, SEED)
            best = contest.at(contest.curve(label, SEED), contest.budget, "best")
            told = ", ".join(f"{key} {value}" for key, value in settings.items())
            rows.append({"search": name, "settings": told, "best": round(best, 4)})
            write_records(given.out / "tuning.csv", rows)


if __name__ == "__main__":
    main()
