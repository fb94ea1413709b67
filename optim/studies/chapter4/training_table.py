"""How many evaluations trainers needed in each body, and how that goes with what a sweep says of the body.

Source: dissertation, chapter 4, "Training" and figure "neurips_evolution_correlation".
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from optim.experiments.tables import read_table, write_table
from optim.measures.statistics import Correlation, pearson
from optim.studies.chapter3.sweep_table import SweepTable
from taichi_sim.base.arrays import Bools, Ints

COLUMNS = ("design", "method", "repetition", "evaluations", "solved")


@dataclass(frozen=True, eq=False)
class TrainingTable:
    """Outcomes of runs: M methods, each R times in each of D bodies."""

    methods: tuple[str, ...]  # names, shape (M,)
    designs: Ints  # numbers of the bodies, ascending, shape (D,)
    # until one controller solved all environments; of a run that found none, all it had; shape (M, D, R)
    evaluations: Ints
    solved: Bools  # whether one was found, shape (M, D, R)

    def write(self, path: Path) -> None:
        """Write a row for each run as CSV, compressed if its name ends in ``.gz``."""
        rows = [
            (design, method, number, *map(int, run))
            for method, *outcomes in zip(self.methods, self.evaluations, self.solved, strict=True)
            for design, *runs in zip(self.designs.tolist(), *outcomes, strict=True)
            for number, run in enumerate(zip(*runs, strict=True), 1)
        ]
        write_table(path, COLUMNS, rows)


def read_training_table(path: Path) -> TrainingTable:
    """Read what :meth:`TrainingTable.write` wrote.

    Raises:
        ValueError: for any other file.
    """
    header, rows = read_table(path)
    try:
        if tuple(header) != COLUMNS:
            raise ValueError
        methods = tuple(dict.fromkeys(row[1] for row in rows))
        designs, numbers = np.unique([int(row[0]) for row in rows]), np.array([row[2:] for row in rows], np.int64)
        repetitions = int(numbers[:, 0].max())
        shape = len(methods), len(designs), repetitions
        table = TrainingTable(methods, designs, numbers[:, 1].reshape(shape), numbers[:, 2].reshape(shape) == 1)
    except (ValueError, IndexError):
        raise ValueError(f"{path}: is not a table of training, with columns {','.join(COLUMNS)}") from None
    return table


@dataclass(frozen=True)
class MetricCorrelation:
    """Correlation of the evaluations that a method needs with a metric of the body."""

    method: str  # its name
    metric: str  # ``"M_L"`` or ``"M_CI"``
    # ``"runs"``, each of them, those in one body not independent; or ``"bodies"``, the means of their runs, as
    # published
    over: str
    found: Correlation  # Pearson's correlation, its p two-sided


def metric_correlations(table: TrainingTable, sweep: SweepTable) -> list[MetricCorrelation]:
    """Correlations of all methods with both metrics, over runs and bodies.

    Raises:
        ValueError: if the sweep lacks bodies.
    """
    found = []
    for method, evaluations in zip(table.methods, table.evaluations, strict=True):
        for metric, values in sweep.rows(table.designs).metrics.items():
            runs = np.repeat(values, evaluations.shape[1]), evaluations.ravel()
            for over, pairs in (("runs", runs), ("bodies", (values, evaluations.mean(axis=1)))):
                found.append(MetricCorrelation(method, metric, over, pearson(*pairs, "two-sided")))
    return found
