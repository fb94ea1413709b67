"""How much faster one search's gaits are than another's, and whether so few runs show it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import combinations
from typing import Any

import numpy as np

from optim.measures.statistics import difference_of_means, holm
from taichi_sim.base.arrays import Floats


def differences(speeds: Mapping[str, Floats], starts: Mapping[str, Sequence[float | None]]) -> list[dict[str, Any]]:
    """Every two searches: the difference of what their runs found, and p adjusted for the number of pairs (Holm).

    Searches whose runs begin with the same gaits, seed by seed, are compared by the differences of these pairs (the
    paired t-test), others by Welch's t-test.

    Args:
        speeds: by search, of what the run with each seed found, NaN where it found nothing, shape (S,).
        starts: by search, something that tells the first generations of its runs from others.
    """
    rows: list[dict[str, Any]] = []
    for first, second in combinations(speeds, 2):
        a, b = speeds[first], speeds[second]
        same = len(a) == len(b) and list(starts[first]) == list(starts[second])
        both = np.isfinite(a + b) if same else None
        a, b = (x[both if same else np.isfinite(x)] for x in (a, b))
        if min(len(a), len(b)) > 1:
            found = difference_of_means(a, b, paired=same)
            rows.append({"first": first, "second": second, "same_start": same, **asdict(found)})
    for row, adjusted in zip(rows, holm([row["p"] for row in rows]), strict=True):
        row["p_adjusted"] = adjusted
    return rows


def table_of_differences(rows: Sequence[Mapping[str, Any]], labels: Mapping[str, str]) -> str:
    """The same in Markdown."""
    lines = [
        "| slower | faster | by [BL/s] | its 95 % interval | p | for all pairs |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    for row in sorted(rows, key=lambda row: row["p"]):
        names, sign = (row["first"], row["second"]), 1.0
        if row["difference"] < 0:
            names, sign = names[::-1], -1.0
        low, high = sorted((sign * row["low"], sign * row["high"]))
        slower, faster = (labels[name] for name in names)
        test = " (pairs)" if row["same_start"] else ""
        lines.append(
            f"| {slower} | {faster} | {sign * row['difference']:.4f}{test} | {low:.4f} to {high:.4f} "
            f"| {row['p']:.3f} | {row['p_adjusted']:.3f} |"
        )
    return "\n".join(lines) + "\n"
