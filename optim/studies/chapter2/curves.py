"""Progress of the climbers of a run: numbers for each generation, and every beneficial mutation."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from optim.experiments.tables import write_table
from optim.measures.catastrophic_interference import RunMeasures
from optim.measures.statistics import mean_band
from optim.studies.chapter2.evolution import Runs
from optim.studies.chapter2.settings import FITNESS, Treatment
from taichi_sim.base.arrays import Arrays, Floats

QUANTITIES = ("worst_distance", "fitness")


def curve(state: Arrays, fitness: str) -> Floats:
    """After each generation of a run, the smallest worst distance and the best fitness of all climbers, (G, 2)."""
    generations, climbers = int(state["generation"]), int(state["climber"].max()) + 1
    worst: Floats = np.nan_to_num(state["distance"].max(axis=1).astype(float), nan=np.inf)
    score: Floats = np.nan_to_num(FITNESS[fitness](state["light"], axis=-1), nan=-np.inf)
    ends = np.searchsorted(state["born"], np.arange(generations), side="right")
    now = np.tile([np.inf, -np.inf], (climbers, 1))
    found, first = np.empty((generations, 2)), 0
    for generation, end in enumerate(ends.tolist()):
        new = slice(first, end)
        now[state["climber"][new]] = np.column_stack([worst[new], score[new]])
        found[generation] = now[:, 0].min(), now[:, 1].max()
        first = end
    return found


def write_curves(found: Runs, path: Path) -> dict[Treatment, Floats]:
    """Write mean and 95 % bootstrap interval over runs for each generation as CSV; return ``QUANTITIES``, (R, G, 2)."""
    stacked = {each: np.stack([curve(state, each.fitness) for state in states]) for each, states in found.items()}
    rows = []
    for treatment, values in stacked.items():
        low, high = mean_band(values)
        for n, quantity in enumerate(QUANTITIES):
            numbers = np.column_stack([values[..., n].mean(axis=0), low[:, n], high[:, n]]).tolist()
            rows += [(treatment.row, treatment.robot, quantity, g, *row) for g, row in enumerate(numbers)]
    write_table(path, ("fitness", "robot", "quantity", "generation", "mean", "low", "high"), rows)
    return stacked


def mutations(state: Arrays, only: Sequence[int] | None = None) -> tuple[Floats, NDArray[np.int32]]:
    """Beneficial mutations of a run: changes of distances, (A, E) [m], positive where better, and generations, (A,).

    Of some climbers ``only``, if given.
    """
    order = np.argsort(state["climber"], kind="stable")  # generations stay in order
    climber, born, distance = (state[name][order] for name in ("climber", "born", "distance"))
    steps = climber[1:] == climber[:-1]
    if only is not None:
        steps &= np.isin(climber[1:], only)
    changes = (distance[:-1] - distance[1:])[steps].astype(float)
    finite = np.isfinite(changes).all(axis=1)
    return changes[finite], born[1:][steps][finite]


def all_mutations(
    found: Runs, measured: Mapping[Treatment, Sequence[RunMeasures]] | None = None
) -> dict[Treatment, tuple[Floats, NDArray[np.int32]]]:
    """Beneficial mutations of all runs by treatment; of the lines of champions only, if runs are given as measured."""
    every = {}
    for treatment, states in found.items():
        only = [None] * len(states) if measured is None else [[run.champion] for run in measured[treatment]]
        parts = [mutations(*each) for each in zip(states, only, strict=True)]
        every[treatment] = np.concatenate([c for c, _ in parts]), np.concatenate([born for _, born in parts])
    return every
