"""Runs for tests, and what tests read from run folders."""

import json

import numpy as np

from optim.problem import Evaluation
from optim.problems.braitenberg import VehicleProblem
from optim.runs import open_run, run_search
from optim.search import build_method


def products(folder):
    """Contents of the files that must not depend on interruptions."""
    return {name: (folder / name).read_bytes() for name in ("log.jsonl", "best.json", "gait.csv", "config.toml")}


def log(folder):
    """Lines of the log."""
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


class Kite(VehicleProblem):
    """A problem of a kind that nothing knows."""

    def evaluate(self, points):
        return Evaluation(np.zeros(len(points)))

    def describe(self):
        return {"kind": "kite"}


def searched(problem, folder, generations=1):
    """A run of two climbers."""
    settings = {"climbers": 2, "seed": 0}
    method = {"name": "hill-climb", **settings}
    config = {"problem": problem.describe(), "method": method, "generations": generations}
    with open_run(folder, config) as run:
        run_search(problem, build_method("hill-climb", problem.space, settings), run, generations)
