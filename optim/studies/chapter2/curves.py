"""Progress of the climbers of a run: numbers for each generation, and every beneficial mutation."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from optim.experiments.data import Data, Kind
from optim.experiments.tables import column, distinct, select, write_table
from optim.measures.catastrophic_interference import RunMeasures
from optim.measures.statistics import mean_band
from optim.studies.chapter2.evolution import Runs
from optim.studies.chapter2.settings import FITNESS, ROBOTS, ROWS, Place, Treatment
from taichi_sim.base.arrays import Arrays, Floats

FILE = "curves.csv"
QUANTITIES = ("worst_distance", "fitness")
BAND = ("mean", "low", "high")
COLUMNS: dict[str, Kind] = {  # of ``FILE``
    "fitness": ROWS,
    "robot": tuple(ROBOTS),
    "quantity": QUANTITIES,
    "generation": int,
    **dict.fromkeys(BAND, float),
}
Mutations = tuple[Floats, NDArray[np.int32]]  # changes of distances, (A, E) [m], and generations, (A,)


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


def curves_of(found: Runs) -> dict[Place, Floats]:
    """Means over runs of ``QUANTITIES`` by generation, and their 95 % bootstrap intervals, to six digits, (2, 3, G)."""
    curves = {}
    for treatment, states in found.items():
        values = np.stack([curve(state, treatment.fitness) for state in states])
        bands = np.stack([values.mean(axis=0), *mean_band(values)]).transpose(2, 0, 1)
        curves[treatment.place] = np.array([float(f"{number:.6g}") for number in bands.flat]).reshape(bands.shape)
    return curves


def write_curves(curves: Mapping[Place, Floats], path: Path) -> None:
    """Write curves as CSV, a row for each quantity and generation of each treatment."""
    rows = [
        (*place, quantity, generation, *numbers)
        for place, bands in curves.items()
        for quantity, band in zip(QUANTITIES, bands, strict=True)
        for generation, numbers in enumerate(band.T.tolist())
    ]
    write_table(path, tuple(COLUMNS), rows)


def read_curves(data: Data) -> dict[Place, Floats]:
    """Read what :func:`write_curves` wrote; raises ValueError if a generation is missing, or one has two rows."""
    every, curves = data.records(FILE, COLUMNS), dict[Place, Floats]()
    for row in distinct(every, "fitness"):
        for robot in distinct(own := select(every, fitness=row), "robot"):
            each = [select(own, robot=robot, quantity=quantity) for quantity in QUANTITIES]
            for quantity, rows in zip(QUANTITIES, each, strict=True):
                if [one["generation"] for one in rows] != list(range(max(map(len, each)))):
                    told = f"{row} {robot} has {len(rows)} rows of {quantity}"
                    raise ValueError(
                        f"{data.path(FILE)}: {told}; give one for each generation from 0 on, in this order"
                    )
            curves[row, robot] = np.array([[column(rows, name) for name in BAND] for rows in each])
    return curves


def mutations(state: Arrays, only: Sequence[int] | None = None) -> Mutations:
    """Beneficial mutations of a run, positive where better; those of some climbers ``only``, if given."""
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
) -> dict[Place, Mutations]:
    """Beneficial mutations of all runs by treatment; of the lines of champions only, if runs are given as measured."""
    every = {}
    for treatment, states in found.items():
        only = [None] * len(states) if measured is None else [[run.champion] for run in measured[treatment]]
        parts = [mutations(*each) for each in zip(states, only, strict=True)]
        every[treatment.place] = np.concatenate([c for c, _ in parts]), np.concatenate([born for _, born in parts])
    return every
