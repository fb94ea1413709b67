"""How fast this commit is beside version 1.0, as a row of a table that grows: ``make bench-history``.

Both versions run their own ``bench`` in turns on the same machine, so a row holds ratios, which a slow or busy machine
changes little. A ratio that is 5 % below that of the last row of the same processor is told. The table is drawn, too.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from same_bits.trees import reference_tree

ROOT = Path(__file__).resolve().parents[1]
TABLE, FIGURE = ROOT / "docs" / "data" / "bench-history.csv", ROOT / "docs" / "bench-history.webp"
VERSION_1 = "ed12070"
RUNS = (["inflatable", "--precision", "f32"], ["inflatable", "--precision", "f64"], ["vehicle"], ["rigid"])
SLOWER = 0.95  # of the last row


def rates(figures: Mapping[str, Any]) -> dict[str, float]:
    """Rates by name, of the figures that ``bench --json`` of either version prints."""
    found = {}
    for precision in ("f32", "f64"):
        if lattice := figures.get(precision):
            single, gradient = lattice["single_robot_steps_per_second"]["median"], lattice["gradient"]
            found[f"one robot {precision}"] = single
            if "one_robot" in gradient:  # version 1.0
                found[f"gradient {precision}"] = single / gradient["one_robot"]["in_its_own_forward_runs"]
            else:
                found[f"gradient {precision}"] = gradient["steps_per_second"]
    if vehicle := figures.get("vehicle"):
        found["vehicles f64"] = vehicle["rollouts_per_core_second"]["f64"]["median"]
    if rigid := figures.get("rigid"):
        found["whegged f64"] = rigid["steps_per_core_second"]["f64"]["whegged"]["median"]
    return found


def measured(tree: Path) -> dict[str, float]:
    """Rates of the version in a source tree, by its own benchmark."""
    found: dict[str, float] = {}
    for run in RUNS:
        command = [sys.executable, "-m", "optim.cli", "bench", *run, "--quick", "--json"]
        environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=True)
        found |= rates(json.loads(done.stdout))
    return found


def ratios(rounds: int) -> dict[str, float]:
    """Median ratios to version 1.0 of so many rounds, in each of which both versions run."""
    reference, each = reference_tree(VERSION_1), []
    for number in range(rounds):
        theirs, ours = measured(reference), measured(ROOT)
        each.append({name: ours[name] / theirs[name] for name in ours if name in theirs})
        told = ", ".join(f"{name} {ratio:.2f}" for name, ratio in each[-1].items())
        print(f"round {number + 1} of {rounds}: {told}", flush=True)
    return {name: float(np.median([one[name] for one in each])) for name in each[0]}


def processor() -> str:
    """Name of the processor, and whether it has AVX-512."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    wide = any(line.startswith("flags") and "avx512f" in line for line in lines)
    return f"{named[0] if named else 'unknown'}{' AVX-512' if wide else ''}"


def read() -> list[dict[str, str]]:
    """Rows of the table so far."""
    if not TABLE.exists():
        return []
    with TABLE.open(newline="") as file:
        return list(csv.DictReader(file))


def write(rows: list[dict[str, str]]) -> None:
    """Write the table, and draw its ratios by commit."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(name for row in rows for name in row))
    with TABLE.open("w", newline="") as file:
        writer = csv.DictWriter(file, names, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    for name in names[3:]:
        axes.plot([float(row[name]) if row.get(name) else np.nan for row in rows], "o-", label=name)
    axes.set_xticks(range(len(rows)), [row["commit"] for row in rows], rotation=45)
    axes.set(yscale="log", ylabel="times as fast as version 1.0", xlabel="commit")
    axes.set_yticks([1, 2, 3, 4, 6, 8, 12], ["1", "2", "3", "4", "6", "8", "12"], minor=False)
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(ncols=2, fontsize="small")
    figure.savefig(FIGURE, dpi=120, pil_kwargs={"lossless": True})


def main() -> None:
    """Measure, tell what has become slower, append and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="in each of which both versions run (default: 3)")
    found = ratios(parser.parse_args().rounds)
    rows = read()
    commit = subprocess.run(["git", "-C", str(ROOT), "describe", "--always", "--dirty"], capture_output=True, text=True)
    row = {"date": f"{datetime.now(UTC):%Y-%m-%d}", "commit": commit.stdout.strip(), "processor": processor()}
    before = next((old for old in reversed(rows) if old["processor"] == row["processor"]), {})
    for name, ratio in found.items():
        if before.get(name) and ratio < SLOWER * float(before[name]):
            print(f"slower: {name} is {ratio:.2f} times version 1.0; {before['commit']} was {float(before[name]):.2f}")
        row[name] = f"{ratio:.3f}"
    write([*rows, row])


if __name__ == "__main__":
    main()
