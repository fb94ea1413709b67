"""What the benchmarks share: rates measured several times, beside those of a reference program."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np


def prototype_rate(
    option: str,
    path: Path,
    arguments: Sequence[str],
    pattern: str,
    place: str,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> float:
    """Run a reference program and return the rate that it prints.

    Args:
        option: name of the option that gave the path, for messages.
        path: the program.
        arguments: of its command line.
        pattern: regular expression whose first group is the rate.
        place: where the rate is expected, for messages.
        environment: environment variables of the program; those of this process if None.
        folder: where it runs; its own folder if None.

    Raises:
        ValueError: if the pattern is not found in the output.
    """
    command = [sys.executable, str(path.resolve()) if folder else path.name, *arguments]
    folder = folder or path.parent
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    found = re.search(pattern, run.stdout)
    if not found:
        raise ValueError(f"{option}: {path} prints no number {place}")
    return float(found[1])


def rates_of_tree(tree: Path, precision: str, quick: bool) -> dict[str, Any]:
    """Figures of the lattice by another version's own benchmark: that of a source tree, version 1.0 for instance.

    Raises:
        ValueError: if the tree has no benchmark that answers.
    """
    command = [sys.executable, "-m", "optim.cli", "bench", "inflatable", "--json", "--precision", precision]
    command += ["--quick"] if quick else []
    environment = {**os.environ, "PYTHONPATH": str(tree.resolve())}
    run = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=True)
    figures: dict[str, Any] = json.loads(run.stdout)
    if "single_robot_steps_per_second" not in figures.get(precision, {}):
        raise ValueError(f"against: the benchmark of {tree} tells no rates")
    found: dict[str, Any] = figures[precision]
    return found


def best_and_median(rates: Sequence[float]) -> dict[str, float]:
    """Summarise measurements: the best is the machine undisturbed, the median is what one gets."""
    return {"best": max(rates), "median": float(np.median(rates))}
