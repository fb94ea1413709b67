"""Records, the rows of tables by column: choose, group and gather them, and write columns as CSV."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.tables import write_table
from taichi_sim.base.arrays import Floats

Record = Mapping[str, Any]


def where(records: Iterable[Record], **values: Any) -> list[Record]:
    """Choose the records that have these values."""
    return [record for record in records if all(record[name] == value for name, value in values.items())]


def distinct(records: Iterable[Record], name: str) -> list[Any]:
    """List the different values of a column, in the order in which they first come."""
    return list(dict.fromkeys(record[name] for record in records))


def column(records: Iterable[Record], name: str) -> Floats:
    """Gather a column of numbers, NaN where it is None, shape (N,)."""
    return np.array([record[name] for record in records], float)


def write_columns(path: Path, columns: Mapping[str, ArrayLike | Sequence[Any]]) -> None:
    """Write columns of equal length as a CSV file, which is compressed if its name ends in ``.gz``."""
    values = (np.asarray(each).tolist() if isinstance(each, np.ndarray) else each for each in columns.values())
    write_table(path, tuple(columns), zip(*values, strict=True))
