"""The table of a sweep: for every body, how many controllers solve all environments, and how many any.

Source: dissertation, chapters 3 and 4; the metrics are those of ``optim.measures.overlap``, from counts.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optim.experiments.results import Progress
from optim.experiments.tables import read_table, write_columns
from optim.measures.overlap import learnability_of, resistance_of
from robots.braitenberg import DESIGNS, Sweep, VehicleBody, read_sweep, sweep
from robots.braitenberg.sweeps import holds_sweep, read_sweep_settings
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats, Ints

COLUMNS = ("design", "all", "any")
PUBLISHED_COUNTS = {162: (1517, 2339), 6553: (26, 1830)}  # all, any, of the published sweep, which tell it from others
ROUNDING = 10  # controllers that another machine may count otherwise


@dataclass(frozen=True, eq=False)
class SweepTable:
    """Counts of a sweep for bodies of the published grid, ascending by number, each array of shape (D,)."""

    designs: Ints  # numbers of the bodies
    solving_all: Ints  # controllers that succeed in all environments
    solving_any: Ints  # controllers that succeed in at least one
    settings: Sweep  # of the sweep
    assumed: bool = False  # whether nothing tells these settings

    @classmethod
    def of(cls, designs: ArrayLike, overlaps: NDArray[Any], settings: Sweep, environments: int = 4) -> "SweepTable":
        """The table of overlap matrices, shape (D, n, n)."""
        every, some = (np.count_nonzero(overlaps >= n, axis=(1, 2)) for n in (environments, 1))
        return cls(np.asarray(designs, np.int64), np.asarray(every), np.asarray(some), settings)

    @property
    def learnability(self) -> Floats:
        """M_L, the share of all controllers that solve every environment."""
        return learnability_of(self.solving_all, self.settings.weights**2)

    @property
    def resistance(self) -> Floats:
        """M_CI, their share of those that solve any environment; 0 if none does."""
        return resistance_of(self.solving_all, self.solving_any)

    @property
    def metrics(self) -> dict[str, Floats]:
        """Both metrics, by their names in the papers."""
        return {"M_L": self.learnability, "M_CI": self.resistance}

    def rows(self, designs: ArrayLike) -> "SweepTable":
        """The part of some bodies; raises ValueError if some are missing."""
        wanted = np.asarray(designs, np.int64)
        missing = np.setdiff1d(wanted, self.designs)
        if missing.size:
            raise ValueError(f"sweep: {missing.size} of {wanted.size} bodies are missing, design {missing[0]} first")
        at = np.searchsorted(self.designs, wanted)
        return SweepTable(wanted, self.solving_all[at], self.solving_any[at], self.settings, self.assumed)

    def check_published(self, path: Path) -> None:
        """Refuse a table, read from a path, whose settings nothing tells and whose counts are not the published ones.

        Raises:
            ValueError: if a body that tells differs, or none of these is there.
        """
        if not self.assumed:
            return
        known = [n for n in PUBLISHED_COUNTS if n in self.designs]
        told = f"{path} does not tell its radius"
        if not known:
            names = " and ".join(map(str, PUBLISHED_COUNTS))
            raise ValueError(f"sweep: {told}, nor has it designs {names}, whose counts do; give the sweep's folder")
        for design in known:
            at = int(np.searchsorted(self.designs, design))
            counts, published = (int(self.solving_all[at]), int(self.solving_any[at])), PUBLISHED_COUNTS[design]
            if max(abs(a - b) for a, b in zip(counts, published, strict=True)) > ROUNDING:
                here, there = ("{} of {}".format(*each) for each in (counts, published))
                raise ValueError(
                    f"sweep: {told}, and design {design} has {here} there, not {there} as in the published sweep; "
                    "give the sweep's folder"
                )

    def write(self, path: Path) -> None:
        """Write design, all, any, M_L and M_CI as CSV."""
        counts = dict(zip(COLUMNS, (self.designs, self.solving_all, self.solving_any), strict=True))
        write_columns(path, {**counts, **self.metrics})


def read_sweep_table(path: Path) -> SweepTable:
    """The table of a sweep's folder, of all bodies that are there, or of a CSV file with design, all, any first.

    Such a file, which may be compressed (``.csv.gz``), is of the sweep in whose folder it lies, or beside whose folder
    ``overlaps`` it lies, or else of the published one with 121 x 121 controllers. Raises ValueError for anything else;
    also for a table with M_L of another number of controllers.
    """
    if path.is_dir():
        settings, bodies = read_sweep(path)
        numbered = {body.design: body for body in bodies if body.design is not None}
        if not numbered:
            raise ValueError(f"{path}: holds no body of the published grid yet")
        return SweepTable.of(list(numbered), overlaps_of(list(numbered.values()), settings, path), settings)
    beside = [each for each in (path.parent, path.parent / "overlaps") if holds_sweep(each)]
    settings = read_sweep_settings(beside[0]) if beside else Sweep()
    header, rows = read_table(path)
    try:
        numbers = np.array([list(map(int, row[: len(COLUMNS)])) for row in rows], np.int64).reshape(-1, len(COLUMNS))
    except ValueError:
        numbers = np.zeros((0, len(COLUMNS)), np.int64)
    designs, every, some = numbers.T
    whole = (every >= 0) & (some >= every) & (some <= settings.weights**2) & (designs >= 1) & (designs <= DESIGNS)
    if tuple(header[: len(COLUMNS)]) != COLUMNS or not len(numbers) or not whole.all() or (np.diff(designs) <= 0).any():
        raise ValueError(f"{path}: is not the table of a sweep, with columns {','.join(COLUMNS)}, ascending by design")
    table = SweepTable(designs, every, some, settings, assumed=not beside)
    if not _has_metrics(table, header, rows):
        raise ValueError(
            f"{path}: its M_L is not of {settings.weights} x {settings.weights} controllers; give the sweep's folder"
        )
    return table


def _has_metrics(table: SweepTable, header: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Whether M_L, where a file has it, is that of the table."""
    if "M_L" not in header:
        return True
    try:
        given = [float(row[header.index("M_L")]) for row in rows]
    except (ValueError, IndexError):
        return False
    return np.allclose(given, table.learnability, rtol=1e-9, atol=0.0)


def overlaps_of(bodies: Sequence[VehicleBody], settings: Sweep, folder: Path | None, **options: Any) -> NDArray[Any]:
    """Overlap matrices of a sweep of these settings, see :func:`robots.braitenberg.sweep`."""
    given = asdict(settings)
    renamed = {"r": given.pop("radius"), "dt": given.pop("time_step")}
    return sweep(bodies, **given, **renamed, out=folder, **options)


def sweep_published(designs: Sequence[int], settings: Sweep, folder: Path, progress: Progress = None) -> SweepTable:
    """The table of a sweep of some bodies of the published grid, whose folder takes the overlaps."""
    bodies = [VehicleBody.published(design) for design in designs]
    return SweepTable.of(designs, overlaps_of(bodies, settings, folder, progress=progress), settings)


def sample_designs(count: int, seed: int = 1) -> list[int]:
    """Numbers of bodies drawn from the published grid without replacement, ascending; larger samples contain smaller.

    Raises ValueError for less than 1 or more than there are.
    """
    checks.integer("sample", count, 1)
    if count > DESIGNS:
        raise ValueError(f"sample: {count} is not allowed; give at most {DESIGNS}")
    return sorted((np.random.default_rng(seed).permutation(DESIGNS)[:count] + 1).tolist())
