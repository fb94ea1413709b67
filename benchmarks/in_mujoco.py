"""How far gaits of a robot of an MJCF file come in MuJoCo, beside here: random ones, and ones that a search found here.

The robot is Gymnasium's Ant with other drives, which follow angles or rates; its body, in the sizes of each design, and
what its drives are told leave the lab by ``save_model`` and ``save_commands``. MuJoCo simulates each gait twice, with
the time step of the file and with half of it: how far these two agree is the most that can be asked for.

    python benchmarks/in_mujoco.py --out in-mujoco.csv [--random 60] [--seeds 8] [--generations 60]
    python benchmarks/in_mujoco.py --from docs/data/in-mujoco.csv
"""

import argparse
import csv
import re
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium
import mujoco
import numpy as np
from scipy import stats

from optim import maximise
from optim.problems.robot import RobotProblem
from robots.articulated import ArticulatedRobot, simulate
from robots.free import Free
from taichi_sim.base.arrays import Floats

SECONDS = 3.0
ANT = Path(gymnasium.__path__[0]) / "envs/mujoco/assets/ant.xml"
MOTOR = re.compile(r'<motor [^>]*joint="(\w+)"[^>]*/>')
LIMIT = 'forcelimited="true" forcerange="-150 150"'
DRIVES = {"angles": f'kp="150" kv="8" {LIMIT}', "rates": f'kv="30" {LIMIT}'}
RANGES = {"hip": (-0.5, 0.5), "ankle_1": (0.5, 1.2), "ankle_2": (-1.2, -0.5), "ankle_3": (-1.2, -0.5)}  # rad
FIELDS = ("drives", "gait", "number", "here", "mujoco", "mujoco_half_step")
SIZES = {"aux_*": Free(0.5, 2.0), "body *": Free(0.5, 2.0)}
DRAWS = 4000  # of bootstraps


def ant(drives: str) -> ArticulatedRobot:
    """The robot, with drives that follow angles or rates, and legs of free sizes."""

    def driven(found: re.Match[str]) -> str:
        if drives == "rates":
            return f'<velocity joint="{found[1]}" ctrlrange="-4 4" {DRIVES[drives]}/>'
        low, high = RANGES.get(found[1], RANGES["hip"] if "hip" in found[1] else RANGES["ankle_1"])
        return f'<position joint="{found[1]}" ctrlrange="{low} {high}" {DRIVES[drives]}/>'

    return ArticulatedRobot(MOTOR.sub(driven, ANT.read_text()), name="ant", duration=SECONDS, body_sizes=SIZES)


def in_mujoco(model: Path, commands: Path, shorter: int = 1) -> float:
    """Distance along x that a robot comes in MuJoCo [m], with time steps that are so many times shorter."""
    theirs = mujoco.MjModel.from_xml_path(str(model))
    theirs.opt.timestep /= shorter
    data = mujoco.MjData(theirs)
    table = np.loadtxt(commands, delimiter=",", skiprows=1)
    mujoco.mj_forward(theirs, data)
    start = data.subtree_com[1].copy()
    while data.time < SECONDS - 1e-9:
        data.ctrl[:] = table[np.searchsorted(table[:, 0], data.time + 1e-9, side="right") - 1, 1:]
        mujoco.mj_step(theirs, data)
    mujoco.mj_forward(theirs, data)
    return float(data.subtree_com[1, 0] - start[0])


def designed(robot: ArticulatedRobot, seed: int, generations: int) -> Floats:
    """The point that a search finds."""
    problem = RobotProblem(robot, objective="distance", threads=1)
    return np.asarray(maximise(problem, "cma", population=16, generations=generations, seed=seed, progress=False).point)


def measured(count: int, seeds: int, generations: int) -> list[dict[str, Any]]:
    """Try all gaits here and there."""
    rows = []
    for drives in DRIVES:
        robot = ant(drives)
        low, high = np.array([(each.low, each.high) for each in robot.parameters]).T
        drawn = np.random.default_rng(0).uniform(low, high, (count, len(low)))
        found = np.array([designed(robot, seed, generations) for seed in range(seeds)])
        for gait, points in (("random", drawn), ("designed", found)):
            distances = simulate(robot, points, threads=1).distance
            for number, (point, distance) in enumerate(zip(points, distances, strict=True)):
                with TemporaryDirectory() as folder:
                    model, commands = Path(folder) / "ant.xml", Path(folder) / "told.csv"
                    robot.save_model(point, model)
                    robot.save_commands(point, commands)
                    theirs = [in_mujoco(model, commands, shorter) for shorter in (1, 2)]
                rows.append(dict(zip(FIELDS, (drives, gait, number, float(distance), *theirs), strict=True)))
            print(f"{drives}, {gait}: {len(points)} gaits")
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """A table of what the rows tell, with intervals of 95 %."""
    lines = ["| drives follow | gaits | n | here [m] | MuJoCo / here | rank correlation | MuJoCo with half steps |"]
    lines.append("|---" * 7 + "|")
    for drives in DRIVES:
        for gait in ("random", "designed"):
            some = [row for row in rows if row["drives"] == drives and row["gait"] == gait]
            here, there, half = (np.array([float(row[name]) for row in some]) for name in FIELDS[3:])
            told = [gait, str(len(some)), f"{np.mean(here):.2f}", share(here, there)]
            told += [correlation(here, there), correlation(there, half)]
            lines.append(f"| {' | '.join([drives, *told])} |")
    return "\n".join(lines)


def share(here: Floats, there: Floats) -> str:
    """What part of their way here gaits come there, by least squares through zero."""
    return interval(here, there, lambda a, b: float(a @ b / (a @ a)))


def correlation(here: Floats, there: Floats) -> str:
    """Rank correlation of two ways."""
    return interval(here, there, lambda a, b: float(stats.spearmanr(a, b).statistic))


def interval(here: Floats, there: Floats, told: Any) -> str:
    """A number of pairs, with the interval of its bootstrap."""
    draws = np.random.default_rng(0).integers(0, len(here), (DRAWS, len(here)))
    low, high = np.nanquantile([told(here[each], there[each]) for each in draws], (0.025, 0.975))
    return f"{told(here, there):.2f} ({low:.2f} to {high:.2f})"


def main() -> None:
    """Measure, or tell again what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--from", type=Path, dest="source")
    parser.add_argument("--random", type=int, default=60)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--generations", type=int, default=60)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.source:
        with args.source.open() as file:
            rows: list[dict[str, Any]] = list(csv.DictReader(file))
    else:
        rows = measured(args.random, args.seeds, args.generations)
    if args.out:
        with args.out.open("x", newline="") as file:
            writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    print(report(rows))


if __name__ == "__main__":
    main()
