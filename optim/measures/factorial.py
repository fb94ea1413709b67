"""Two-way analysis of variance: the variance that each of two factors explains, and their interaction.

Sources: Montgomery, Design and analysis of experiments, 8th ed. 2013, sections 5.3 (two factors) and 14.4 (split
plots); Olejnik & Algina, Psychological Methods 8, 2003 (eta squared and omega squared); Efron & Tibshirani, An
introduction to the bootstrap, 1993, ch. 10 (bias) and 13 (percentile intervals).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats

SOURCES = ("rows", "columns", "interaction")
RESAMPLES = 2000
AT_ONCE = 5_000_000  # numbers of resamples in memory


@dataclass(frozen=True)
class Source:
    """One source of variation: a factor, or the interaction of both.

    Attributes:
        squares: sum of squares.
        freedom: degrees of freedom; 0 for a factor with one level.
        against: degrees of freedom of the error term.
        f: mean square divided by that of the error term; None if either has no degrees of freedom, or the error has
            no variance.
        p: probability of at least this F under the null hypothesis; None where ``f`` is None.
        eta: eta squared, the share of the total sum of squares; biased upwards, the more the fewer values there are.
        eta_low, eta_high: its 95 % bootstrap interval, corrected for bias.
        omega: omega squared, the same share corrected for chance; may be negative.
        omega_low, omega_high: its 95 % bootstrap interval, corrected for bias.
    """

    squares: float
    freedom: int
    against: int
    f: float | None
    p: float | None
    eta: float
    eta_low: float
    eta_high: float
    omega: float
    omega_low: float
    omega_high: float


@dataclass(frozen=True)
class TwoWay:
    """Result of a two-way analysis of variance.

    Attributes:
        rows, columns, interaction: the sources of variation.
        total: sum of squares of all values about their mean.
        advantage: omega squared of rows minus that of columns, with the ends of its 95 % bootstrap interval.
    """

    rows: Source
    columns: Source
    interaction: Source
    total: float
    advantage: tuple[float, float, float]


def two_way(values: ArrayLike, blocks: bool = False, seed: int = 0) -> TwoWay:
    """Analyse a balanced experiment of two fixed factors.

    Args:
        values: by level of the row factor, level of the column factor and repetition, shape (A, B, n), n >= 2.
        blocks: whether repetition k of a row is the same individual in all columns (a split plot). Then rows are
            tested against the variance between individuals, columns and interaction against the variance within
            them, and the bootstrap resamples individuals. Otherwise all sources are tested against the variance
            between the repetitions of a cell, which the bootstrap resamples.
        seed: seed of the bootstrap.

    Raises:
        ValueError: if the shape is wrong, or the values are not finite or all equal.
    """
    found = np.asarray(values, float)
    if found.ndim != 3 or 0 in found.shape or found.shape[2] < 2:
        raise ValueError(f"values: shape {found.shape} is not allowed; give (rows, columns, at least 2 repetitions)")
    if not np.isfinite(found).all() or not np.ptp(found):
        raise ValueError("values: they must be finite and not all the same")
    parts, freedoms = _partition(found), _freedoms(found.shape, blocks)
    eta, omega = _shares(parts, freedoms, blocks)
    drawn = _bootstrap(found, freedoms, blocks, seed)
    sources = {}
    for name in SOURCES:
        pairs = zip(drawn, (eta, omega), strict=True)
        (eta_low, eta_high), (omega_low, omega_high) = (_ends(each[name], at[name]) for each, at in pairs)
        of_error, freedom = _error(parts, freedoms, name, blocks)
        own, squares = freedoms[name], float(parts[name])
        f = p = None
        if own and freedom and of_error > 1e-12 * parts["total"]:
            from scipy.stats import f as distribution  # slow to import

            f = float(squares / own / of_error)
            p = float(distribution.sf(f, own, freedom))
        more = float(eta[name]), eta_low, eta_high, float(omega[name]), omega_low, omega_high
        sources[name] = Source(squares, own, freedom, f, p, *more)
    better = float(omega["rows"] - omega["columns"])
    ends = _ends(drawn[1]["rows"] - drawn[1]["columns"], better)
    return TwoWay(**sources, total=float(parts["total"]), advantage=(better, *ends))


def _partition(values: Floats) -> dict[str, Floats]:
    """Sums of squares by source, shape (...) each, of values of shape (..., A, B, n).

    ``blocks`` is the sum of squares between the individuals of a row.
    """
    a, b, n = values.shape[-3:]
    mean = values.mean(axis=(-3, -2, -1), keepdims=True)
    cell = values.mean(axis=-1, keepdims=True)
    row, column = cell.mean(axis=-2, keepdims=True), cell.mean(axis=-3, keepdims=True)
    individual = values.mean(axis=-2, keepdims=True)

    def squares(deviations: Floats, times: int) -> Floats:
        return np.asarray(times * (deviations**2).sum(axis=(-3, -2, -1)))

    return {
        "rows": squares(row - mean, b * n),
        "columns": squares(column - mean, a * n),
        "interaction": squares(cell - row - column + mean, n),
        "blocks": squares(individual - row, b),
        "residual": squares(values - cell, 1),
        "total": squares(values - mean, 1),
    }


def _freedoms(shape: tuple[int, ...], blocks: bool) -> dict[str, int]:
    a, b, n = shape
    every = {"rows": a - 1, "columns": b - 1, "interaction": (a - 1) * (b - 1)}
    every["blocks"] = a * (n - 1)
    return every | {"residual": every["blocks"] * (b - 1) if blocks else a * b * (n - 1)}


def _error(parts: Mapping[str, Floats], freedoms: Mapping[str, int], name: str, blocks: bool) -> tuple[Floats, int]:
    """Mean square of the error term of a source, and its degrees of freedom."""
    if blocks and name == "rows":
        squares, freedom = parts["blocks"], freedoms["blocks"]
    else:
        squares, freedom = parts["residual"] - (parts["blocks"] if blocks else 0.0), freedoms["residual"]
    return np.asarray(squares / max(freedom, 1)), freedom


def _shares(
    parts: Mapping[str, Floats], freedoms: Mapping[str, int], blocks: bool
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Eta squared and omega squared of every source; 0 where nothing varies."""
    total = np.maximum(parts["total"], np.finfo(float).tiny)
    between, _ = _error(parts, freedoms, "rows", blocks)
    eta, omega = {}, {}
    for name in SOURCES:
        error, _ = _error(parts, freedoms, name, blocks)
        eta[name] = parts[name] / total
        omega[name] = (parts[name] - freedoms[name] * error) / (total + between)
    return eta, omega


def _bootstrap(
    values: Floats, freedoms: Mapping[str, int], blocks: bool, seed: int
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Eta squared and omega squared of resamples, each of shape (R,)."""
    rng, (a, b, n) = np.random.default_rng(seed), values.shape
    rows, columns = np.arange(a)[:, None, None], np.arange(b)[:, None]
    found = []
    left = RESAMPLES
    while left:
        count = min(left, max(1, AT_ONCE // values.size))
        chosen = rng.integers(n, size=(count, a, 1 if blocks else b, n))
        found.append(_shares(_partition(values[rows, columns, chosen]), freedoms, blocks))
        left -= count
    eta, omega = ({name: np.concatenate([part[which][name] for part in found]) for name in SOURCES} for which in (0, 1))
    return eta, omega


def _ends(sample: Floats, found: float | Floats) -> tuple[float, float]:
    """95 % percentile interval of an estimate from its resamples, shifted by the bias of the bootstrap.

    The means of resampled cells vary more than those of the cells, so the resampled estimates are too large on average.
    """
    low, high = np.percentile(sample, [2.5, 97.5]) - (sample.mean() - found)
    return float(low), float(high)
