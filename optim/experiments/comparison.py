"""Compare samples by tests of pairs, corrected for their number, with all numbers needed to check them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.tables import markdown
from optim.measures.statistics import Alternative, bonferroni, difference_of_means, effect, holm, mann_whitney
from taichi_sim.base.arrays import Floats


def compare(
    samples: Mapping[str, ArrayLike], pairs: Sequence[tuple[str, str]], alternative: Alternative
) -> list[dict[str, Any]]:
    """Mann-Whitney tests of pairs of samples, corrected for their number (Bonferroni).

    The normal approximation with corrections for ties and continuity is used, as ties are common. Samples have shape
    (n,); with ``"less"`` the first of a pair tends to be less than the second.

    Returns:
        For each pair: names and sizes, medians, U of the first (pairs of values in which it is the larger, ties
        counted half), p, p times the number of pairs, A12 (the probability that the second is larger), and the
        difference of the means, second less first, with its 95 % bootstrap interval.
    """
    found: list[dict[str, Any]] = []
    for first, second in pairs:
        a, b = (np.asarray(samples[name], float) for name in (first, second))
        known = effect(a, b)
        found.append(
            {
                "first": first,
                "second": second,
                "n": [len(a), len(b)],
                "medians": [float(np.median(a)), float(np.median(b))],
                "U": (1 - known.superiority) * len(a) * len(b),
                "alternative": alternative,
                "method": "asymptotic",
                "p": mann_whitney(a, b, alternative, "asymptotic"),
                "A12": known.superiority,
                "difference": known.difference,
                "interval": [known.low, known.high],
            }
        )
    for row, p in zip(found, bonferroni([row["p"] for row in found]), strict=True):
        row["p_bonferroni"] = p
    return found


def describe_times(times: ArrayLike, budget: int) -> dict[str, Any]:
    """Summarise evaluations until success, where -1 means no success within a budget.

    Medians are of all trials, those without success above every other; null if that is half of them or more.
    """
    values = np.asarray(times)
    done = values > 0
    median = float(np.median(np.where(done, values, np.inf)))
    return {
        "trials": len(values),
        "solved": int(done.sum()),
        "median": median if np.isfinite(median) else None,
        "mean_with_failures_at_budget": float(np.where(done, values, budget).mean()),
        "quartiles_of_solved": np.percentile(values[done], [25, 75]).tolist() if done.any() else None,
    }


def quartiles(values: Floats) -> dict[str, Any]:
    """How many values there are, shape (N,), and their quartiles; None without any."""
    return {"n": len(values), "quartiles": np.percentile(values, [25, 50, 75]).tolist() if len(values) else None}


def ranked(times: ArrayLike, budget: int) -> Any:
    """Evaluations until success for rank tests: trials without success rank after every other."""
    values = np.asarray(times)
    return np.where(values > 0, values, budget + 1)


def differences(speeds: Mapping[str, Floats], starts: Mapping[str, Sequence[float | None]]) -> list[dict[str, Any]]:
    """Compare every two searches by what their runs found, with p adjusted for the number of pairs (Holm).

    Searches whose runs begin with the same gaits, seed by seed, are compared by the differences of these pairs (the
    paired t-test), others by Welch's t-test. Speeds have shape (S,), NaN of runs that found none; ``starts`` has a
    number for each run that is equal if first generations are equal.
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
    """Format differences of pairs as a Markdown table, the most significant first."""
    lines = []
    for row in sorted(rows, key=lambda row: row["p"]):
        names, sign = (row["first"], row["second"]), 1.0
        if row["difference"] < 0:
            names, sign = names[::-1], -1.0
        low, high = sorted((sign * row["low"], sign * row["high"]))
        by = f"{sign * row['difference']:.4f}{' (pairs)' if row['same_start'] else ''}"
        tests = f"{low:.4f} to {high:.4f}", f"{row['p']:.3f}", f"{row['p_adjusted']:.3f}"
        lines.append((*(labels[name] for name in names), by, *tests))
    header = ("slower", "faster", "by [BL/s]", "its 95 % interval", "p", "for all pairs")
    return "\n".join(markdown(header, "llrrrr", lines)) + "\n"
