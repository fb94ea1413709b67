"""Evaluate gaits of the published experiment and compare the distances with the published ones.

    python benchmarks/published_gaits.py PATH/published_gaits.json [--count 60] [--copies 3] [--out PAGE.md]

The file holds, per family of the experiment, such as ``control_flat``, rows of climber, generation, orientation
[degrees], pressure [Pa], f[10], phi[10], distance [m]. It is other people's data and not part of this project. Every
family that it holds is replayed; the published file has four of the six: no gaits of searches with all free.

Contact makes long runs chaotic: a few gaits end in one of two ways, whichever rounding decides. So every gait is
simulated several times from start positions that differ by 10 nm, and the median of these copies is compared; copy 0
alone is reported too. The check is that the median of |error| / max(3 % of the distance, 5 mm) is at most 1 and that
the ranks agree (Spearman at least 0.98). Exit code 1 if not.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from robots.inflatable import InflatableDesign, simulate
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain

SLOPES = {"flat": 0.0, "hill": 15.0}  # by the end of a family's name [degrees]
FAMILIES_IN_ALL = 6
LACKING = "Families that the file lacks are not replayed: the published one has no gaits of searches with all free."
START_NOISE = 1e-8  # m
LARGEST_MEDIAN, SMALLEST_RANK_CORRELATION = 1.0, 0.98


def slope_of(family: str) -> float | None:
    """The slope [degrees] of a family; None for what is none."""
    return SLOPES.get(family.rpartition("_")[2])


def draw(path: Path, count: int, seed: int) -> list[tuple[str, list[Any]]]:
    """Rows of the file, equally many of each family, in the order of the file."""
    published = json.loads(path.read_text())
    generator = np.random.default_rng(seed)
    rows = []
    families = [name for name in published if slope_of(name) is not None]
    for number, family in enumerate(families):
        share = count // len(families) + (number < count % len(families))
        for index in sorted(generator.choice(len(published[family]), share, replace=False)):
            rows.append((family, published[family][index]))
    return rows


def evaluate(rows: list[tuple[str, list[Any]]], precision: str, copies: int) -> np.ndarray:
    """Simulated distances [m], shape (rows, copies); copy 0 starts where the published robot does."""
    distance = np.empty((len(rows), copies))
    for slope in SLOPES.values():
        here = [i for i, (family, _) in enumerate(rows) if slope_of(family) == slope]
        designs = [
            InflatableDesign(pressure=pressure, orientation=orientation, schedule=GaitSchedule.from_codes(f, phi))
            for _, (_, _, orientation, pressure, f, phi, _) in (rows[i] for i in here)
        ]
        for copy in range(copies):
            noise: dict[str, Any] = {"perturbation": START_NOISE, "seed": copy} if copy else {}
            distance[here, copy] = simulate(designs, Terrain(slope=slope), precision=precision, **noise).distance
            print(f"slope {slope:g}, copy {copy + 1} of {copies} done", file=sys.stderr, flush=True)
    return distance


def agreement(simulated: np.ndarray, published: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Errors over tolerance, their median, and the rank correlation."""
    error = np.abs(simulated - published) / np.maximum(0.03 * np.abs(published), 0.005)
    return error, float(np.median(error)), float(spearmanr(simulated, published).statistic)


def table(rows: list[tuple[str, list[Any]]], distances: np.ndarray, precision: str, seed: int) -> tuple[str, bool]:
    """The comparison as a page, and whether it passes."""
    published = np.array([row[-1] for _, row in rows])
    simulated = np.median(distances, axis=1)
    error, median, rank = agreement(simulated, published)
    _, single_median, single_rank = agreement(distances[:, 0], published)
    passes = median <= LARGEST_MEDIAN and rank >= SMALLEST_RANK_CORRELATION
    copies, families = distances.shape[1], len({family for family, _ in rows})
    lines = [
        "# Published gaits, simulated again",
        "",
        f"{len(rows)} evaluations of the published experiment, drawn with seed {seed} from {families} of its "
        f"{FAMILIES_IN_ALL} families,",
        f"in {precision}; the median of {copies} copies whose start positions differ by {START_NOISE * 1e9:.0f} nm:",
        "`python benchmarks/published_gaits.py published_gaits.json`.",
        "",
        f"- median of |error| / max(3 % of the distance, 5 mm): **{median:.2f}** (at most {LARGEST_MEDIAN:g})",
        f"- Spearman rank correlation: **{rank:.4f}** (at least {SMALLEST_RANK_CORRELATION:g})",
        f"- within that tolerance: {np.mean(error <= 1):.0%}; diverged copies: {np.isnan(distances).sum()}",
        f"- copy 0 alone: median {single_median:.2f}, Spearman {single_rank:.4f}",
        "",
        "Median, lowest and highest are of the copies. Where these spread far, contact decides between two outcomes,",
        "and the published run is one draw of them.",
        *[LACKING] * (families < FAMILIES_IN_ALL),
        "",
        "| family | climber | generation | pressure [Pa] | published [m] | median [m] | lowest, highest [m] "
        "| error / tolerance |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for (family, row), ours, each, ratio in zip(rows, simulated, distances, error, strict=True):
        spread = f"{each.min():.4f}, {each.max():.4f}"
        place = f"| {family} | {row[0]} | {row[1]} | {row[3]:.0f} "
        lines.append(f"{place}| {row[-1]:.4f} | {ours:.4f} | {spread} | {ratio:.2f} |")
    return "\n".join(lines) + "\n", passes


def main() -> int:
    """Run the comparison from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path, help="published_gaits.json")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--copies", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--precision", choices=("f32", "f64"), default="f32")
    parser.add_argument("--out", type=Path, help="write the table here as Markdown")
    args = parser.parse_args()
    rows = draw(args.path, args.count, args.seed)
    page, passes = table(rows, evaluate(rows, args.precision, args.copies), args.precision, args.seed)
    if args.out:
        args.out.write_text(page)
    print("\n".join(line for line in page.splitlines() if line.startswith("- ")))
    return 0 if passes else 1


if __name__ == "__main__":
    sys.exit(main())
