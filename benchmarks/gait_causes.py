"""What the speeds of gaits live on: weight of bladders and friction of the floor, apart and together.

python benchmarks/gait_causes.py --out runs/causes

Plays the gaits by hand and those of docs/gaits with bladders of published and of physical weight, each on the published
floor and on those that were measured, in copies whose starts differ by 10 nm. Writes causes.csv, a row for each copy,
and causes.md, the table. What is there is not played again.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.tables import Record, column, markdown, page, read_records, select, write_records
from optim.measures.statistics import mean_interval
from robots.inflatable import load_design, simulate
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.design import INCHING, ROLLING, InflatableDesign
from robots.inflatable.robustness import NOISE
from robots.world import FLOORS, Terrain
from taichi_sim.base.files import write_text

GAITS = Path(__file__).parents[1] / "docs" / "gaits"
CASES = (
    *(("inching", 0), ("rolling", 0), ("flat-genetic", 0), ("both-genetic", 0)),
    *(("inching", 15), ("both-genetic", 15), ("hill-cma", 15), ("hill-program", 15)),
)
WEIGHTS = ("published", "physical")
FRICTION: dict[str, tuple[float, float] | tuple[None, None]] = {"published": (None, None), **FLOORS}


def gait_of(name: str) -> InflatableDesign:
    """A gait by its name."""
    by_hand = {"inching": INCHING, "rolling": ROLLING}
    return by_hand[name] if name in by_hand else load_design(GAITS / f"{name}.json")


def played(name: str, slope: float, copies: int, progress: Any = None) -> list[Record]:
    """Speeds of the copies of a gait under all conditions, as rows."""
    conditions = list(product(WEIGHTS, FRICTION))
    drives, terrains = [], []
    for weight, floor in conditions:
        low, high = FRICTION[floor]
        drives += [replace(ACTUATION, weight=weight)] * copies
        terrains += [Terrain(slope, low_friction=low, high_friction=high)] * copies
    design = gait_of(name)
    options = {"precision": "f32", "threads": 1, "perturbation": NOISE, "progress": progress}
    speeds = simulate([design] * len(drives), terrains, actuation=drives, **options).speed
    about = ((*condition, copy) for condition in conditions for copy in range(copies))
    return [
        {"gait": name, "slope": slope, "weight": weight, "floor": floor, "copy": copy, "speed": float(f"{speed:.5g}")}
        for (weight, floor, copy), speed in zip(about, speeds.tolist(), strict=True)
    ]


def table_of(rows: Sequence[Record]) -> str:
    """Mean speeds with their intervals, a row for each gait and slope."""
    lines = []
    for name, slope in CASES:
        own = select(rows, gait=name, slope=slope)
        if own:
            each = [column(select(own, weight=w, floor=f), "speed") for w, f in product(WEIGHTS, FRICTION)]
            lines.append((f"{name}, {slope}°", *(f"{speeds.mean():.4f} ± {half_width(speeds):.4f}" for speeds in each)))
    weights = {"published": "no weight", "physical": "weight"}
    floors = [f"{floor}, {told}" for told in weights.values() for floor in FRICTION]
    copies = len(np.unique(column(rows, "copy")))
    told = f"Speeds [body lengths/s], means of {copies} copies ± half their 95 % interval, in single precision:"
    return page(told, markdown(("gait", *floors), "l" + "r" * len(floors), lines))


def half_width(speeds: Any) -> float:
    """Half the width of the 95 % interval of a mean."""
    low, high = mean_interval(speeds)
    return (high - low) / 2


def main() -> None:
    """Play what is missing, and tell the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of causes.csv and causes.md")
    parser.add_argument("--copies", type=int, default=5, help="of each gait under each condition (default: 5)")
    given = parser.parse_args()
    path = given.out / "causes.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Record] = list(read_records(path)) if path.exists() else []
    for name, slope in CASES:
        if not select(rows, gait=name, slope=slope):
            print(f"{name} on {slope} degrees", flush=True)
            rows += played(name, slope, given.copies)
            write_records(path, rows)
    write_text(given.out / "causes.md", table_of(rows))
    print(table_of(rows), end="")


if __name__ == "__main__":
    main()
