"""How far gaits of a robot of an MJCF file come in MuJoCo, beside here: random ones, and ones that searches found here.

The robot is Gymnasium's Ant with other drives, servos by angle or by rate, and with its own rotors (1 kg m^2) and
dampers or with light rotors alone; its body, in the sizes of each design, and what its drives are told leave the lab by
``save_model`` and ``save_commands``. MuJoCo simulates each gait as the file says, and with hard contacts, and legs that
pass through each other, as here. Both simulators do it twice, with the time step of the file and with a quarter of it.
Half of the searches are told that friction and slope are uncertain.

    python benchmarks/in_mujoco.py --out in-mujoco.csv [--random 60] [--seeds 8] [--generations 60]
    python benchmarks/in_mujoco.py --from docs/data/in-mujoco.csv
"""

import argparse
import csv
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import product
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
from taichi_sim.rigid.model.resizing import starts_of

SECONDS = 3.0
ANT = Path(gymnasium.__path__[0]) / "envs/mujoco/assets/ant.xml"
MOTOR = re.compile(r'<motor [^>]*joint="(\w+)"[^>]*/>')
LIMIT = 'forcelimited="true" forcerange="-150 150"'
DRIVES = {"angles": f'kp="150" kv="8" {LIMIT}', "rates": f'kv="30" {LIMIT}'}
RANGES = {"hip": (-0.5, 0.5), "ankle_1": (0.5, 1.2), "ankle_2": (-1.2, -0.5), "ankle_3": (-1.2, -0.5)}  # rad
FIELDS = ("drives", "rotors", "gait", "number", "contacts", "here", "here_short", "mujoco", "mujoco_short")
ROTORS = {"heavy": "", "light": 'armature="0.02" damping="0"'}  # those of the file are heavy
CONTACTS = ("of the file", "hard")
SHORTER = 4  # times
OWN_ROTORS = 'armature="1" damping="1"'  # of the file
HARD = (0.02, 1.0)  # s, and damping ratio: twice the time step of the file, the hardest that is stable
GROUPED = ("drives", "rotors", "gait", "contacts")
SIZES = {"aux_*": Free(0.5, 2.0), "body *": Free(0.5, 2.0)}
RANDOM = "random"
GAITS = {RANDOM: "", "designed": "", "designed for uncertain floors": "friction=30%,slope=2"}
TRIED = 6  # floors that a search tries each gait on
DRAWS = 4000  # of bootstraps


def ant(drives: str, rotors: str) -> ArticulatedRobot:
    """The robot, with servos by angle or rate, heavy or light rotors, and legs of free sizes."""

    def driven(found: re.Match[str]) -> str:
        if drives == "rates":
            return f'<velocity joint="{found[1]}" ctrlrange="-4 4" {DRIVES[drives]}/>'
        low, high = RANGES.get(found[1], RANGES["hip"] if "hip" in found[1] else RANGES["ankle_1"])
        return f'<position joint="{found[1]}" ctrlrange="{low} {high}" {DRIVES[drives]}/>'

    text = MOTOR.sub(driven, ANT.read_text())
    assert text.count(OWN_ROTORS) == 1
    text = text.replace(OWN_ROTORS, ROTORS[rotors] or OWN_ROTORS)
    return ArticulatedRobot(text, name="ant", duration=SECONDS, body_sizes=SIZES)


def in_mujoco(model: Path, commands: Path, contacts: str, shorter: int = 1) -> float:
    """Distance along x that a robot comes in MuJoCo [m], with time steps that are so many times shorter."""
    theirs = mujoco.MjModel.from_xml_path(str(model))
    theirs.opt.timestep /= shorter
    theirs.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # drives are stiff for light rotors
    if contacts == "hard":
        theirs.opt.cone, theirs.opt.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
        theirs.geom_solref[:], theirs.geom_solimp[:, :3], theirs.geom_margin[:] = HARD, (0.95, 0.99, 0.001), 0.0
        theirs.geom_contype[0], theirs.geom_conaffinity[0] = 1, 1  # of the floor, which is the first
        theirs.geom_contype[1:], theirs.geom_conaffinity[1:] = 0, 1
    data = mujoco.MjData(theirs)
    for joint, angle in starts_of(model.read_text()).items():
        data.joint(joint).qpos[0] = angle
    table = np.loadtxt(commands, delimiter=",", skiprows=1)
    mujoco.mj_forward(theirs, data)
    start = data.subtree_com[1].copy()
    while data.time < SECONDS - 1e-9:
        data.ctrl[:] = table[np.searchsorted(table[:, 0], data.time + 1e-9, side="right") - 1, 1:]
        mujoco.mj_step(theirs, data)
    mujoco.mj_forward(theirs, data)
    return float(data.subtree_com[1, 0] - start[0])


def designed(robot: ArticulatedRobot, seed: int, generations: int, uncertain: str) -> Floats:
    """The point that a search finds, for the floor of the file or for uncertain ones."""
    drawn: dict[str, Any] = {"uncertain": uncertain, "draws": TRIED} if uncertain else {}
    problem = RobotProblem(robot, objective="distance", threads=1, **drawn)
    return np.asarray(maximise(problem, "cma", population=16, generations=generations, seed=seed, progress=False).point)


def measured(count: int, seeds: int, generations: int) -> list[dict[str, Any]]:
    """Try all gaits here and there."""
    rows = []
    for drives, rotors in product(DRIVES, ROTORS):
        robot = ant(drives, rotors)
        low, high = np.array([(each.low, each.high) for each in robot.parameters]).T
        drawn = np.random.default_rng(0).uniform(low, high, (count, len(low)))
        for gait, uncertain in GAITS.items():
            found = (
                [designed(robot, seed, generations, uncertain) for seed in range(seeds)] if gait != RANDOM else drawn
            )
            points = np.array(found)
            step = robot.physics.time_step
            steps = (replace(robot, time_step=each) for each in (step, step / SHORTER))
            ways = np.transpose([simulate(each, points, threads=1).distance for each in steps])
            for number, (point, here) in enumerate(zip(points, ways.tolist(), strict=True)):
                with TemporaryDirectory() as folder:
                    model, commands = Path(folder) / "ant.xml", Path(folder) / "told.csv"
                    robot.save_model(point, model)
                    robot.save_commands(point, commands)
                    for contacts in CONTACTS:
                        theirs = [in_mujoco(model, commands, contacts, shorter) for shorter in (1, SHORTER)]
                        row = drives, rotors, gait, number, contacts, *(round(way, 4) for way in (*here, *theirs))
                        rows.append(dict(zip(FIELDS, row, strict=True)))
            print(f"{drives}, {rotors} rotors, {gait}: {len(points)} gaits", flush=True)
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """A table of what the rows tell, with intervals of 95 %."""
    names = (
        "servos by",
        "rotors",
        "gaits",
        "contacts in MuJoCo",
        "n",
        "here [m]",
        "here with short steps / here",
        "there / here",
    )
    more = ("both with short steps", "rank correlation", "of MuJoCo with short steps")
    lines = [f"| {' | '.join((*names, *more))} |", "|---" * 11 + "|"]
    for kind in product(DRIVES, ROTORS, GAITS, CONTACTS):
        some = [row for row in rows if tuple(str(row[name]) for name in FIELDS if name in GROUPED) == kind]
        here, brief, there, short = (np.array([float(row[name]) for row in some]) for name in FIELDS[5:])
        told = [str(len(some)), mean(here), share(here, brief), share(here, there), share(brief, short)]
        ranked = [correlation(here, there), correlation(there, short)] if kind[2] == RANDOM else ["-", "-"]
        lines.append(f"| {' | '.join([*kind, *told, *ranked])} |")
    return "\n".join(lines)


def mean(ways: Floats) -> str:
    """Mean of distances."""
    return interval(ways, ways, lambda a, _: a.mean(-1))


def share(here: Floats, there: Floats) -> str:
    """What part of some ways others are, by least squares through zero."""
    return interval(here, there, lambda a, b: (a * b).sum(-1) / (a * a).sum(-1))


def correlation(here: Floats, there: Floats) -> str:
    """Rank correlation of two ways."""

    def rank_correlation(a: Floats, b: Floats) -> Floats:
        ranks = [stats.rankdata(each, axis=-1) - (each.shape[-1] + 1) / 2 for each in (a, b)]
        sizes = [(each * each).sum(-1) for each in ranks]
        return np.asarray((ranks[0] * ranks[1]).sum(-1) / np.sqrt(sizes[0] * sizes[1]))

    return interval(here, there, rank_correlation)


def interval(here: Floats, there: Floats, statistic: Callable[[Floats, Floats], Any]) -> str:
    """A number of pairs, along the last axis, with the interval of its bootstrap."""
    draws = np.random.default_rng(0).integers(0, len(here), (DRAWS, len(here)))
    low, high = np.nanquantile(statistic(here[draws], there[draws]), (0.025, 0.975))
    return f"{statistic(here, there):.2f} ({low:.2f} to {high:.2f})"


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
