"""What it costs to make a robot of the mixture that gradients have found, with continuation and without.

python benchmarks/binarising.py --out runs/binarising

Climbers follow gradients through mixtures of silicone, slippery rubber and nothing in a grid of cells, from random
starts; then the best is rounded and goes on as a robot that can be built. With continuation the mixtures become ever
sharper. Writes binarising.csv, a row for each start and way: the speed [lengths of the grid per second] of the last
mixture, of the robot next to it, and of the robot in the end, in single precision. What is there is not computed again.
"""

import argparse
from pathlib import Path

import numpy as np

from optim.experiments.tables import Record, column, read_records, select, write_records
from optim.measures.statistics import mean_interval
from optim.problem import Request, evaluate_request
from optim.problems.robot import RobotProblem
from optim.search.race import GradientRace
from optim.studies.beyond.freeform_problems import BONE, QUICK
from robots.freeform.grid import Grid
from robots.freeform.palette import SILICONE, Palette, Tissue
from robots.freeform.robot import FreeformRobot
from robots.world import Terrain

WAYS = {"continuation": 8.0, "no continuation": 1.0}  # sharpness of the last mixtures
SHAPE = (10, 6, 4)


def climb(problem: RobotProblem, sharpest: float, seed: int) -> Record:
    """One round of a race, and the speeds on its way from a mixture to a robot."""
    search = GradientRace(space=problem.space, seed=seed, **{**QUICK, "sharpest": sharpest})
    mixture = rounded = np.nan
    while search.round == 0:
        points, sharpness, wants = search.ask(), search.sharpness, search.wants
        found = evaluate_request(problem, Request(points, wants, np.inf if wants == "points" else sharpness))
        best = float(np.max(found.objectives))
        if wants == "gradients" and sharpness < np.inf:
            mixture = best
        elif wants == "gradients" and np.isnan(rounded):
            rounded = best
        search.tell(points, found)
    return {"mixture": mixture, "rounded": rounded, "built": float(search.result().score)}


def main() -> None:
    """Climb from all starts in both ways, and tell the means."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of binarising.csv")
    parser.add_argument("--starts", type=int, default=10, help="random starts (default: 10)")
    given = parser.parse_args()
    path = given.out / "binarising.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Record] = list(read_records(path)) if path.exists() else []
    robot = FreeformRobot(Grid(SHAPE), palette=Palette((Tissue(SILICONE), BONE)))
    problem = RobotProblem(robot, (Terrain(),), precision="f32", threads=1)
    for seed in range(given.starts):
        for way, sharpest in WAYS.items():
            if not select(rows, seed=seed, way=way):
                rows.append({"seed": seed, "way": way, **climb(problem, sharpest, seed)})
                write_records(path, rows)
    for way in WAYS:
        mixtures, *others = (column(select(rows, way=way), name) for name in ("mixture", "rounded", "built"))
        told = []
        for name, speeds in zip(("next to it", "in the end"), others, strict=True):
            low, high = mean_interval(speeds)
            told.append(f"{name} {speeds.mean():.3f} ({low:.3f} to {high:.3f})")
        print(f"{way}: mixture {mixtures.mean():.3f}, {', '.join(told)}; n = {len(mixtures)}")
    ends = [column(select(rows, way=way), "built") for way in WAYS]
    low, high = mean_interval(ends[0] - ends[1])
    print(f"in the end with continuation, less without: {np.mean(ends[0] - ends[1]):.3f} ({low:.3f} to {high:.3f})")


if __name__ == "__main__":
    main()
