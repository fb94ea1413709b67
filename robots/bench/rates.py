"""What the benchmarks share: rates measured several times, beside those of a reference program."""

import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

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


def best_and_median(rates: Sequence[float]) -> dict[str, float]:
    """Summarise measurements: the best is the machine undisturbed, the median is what one gets."""
    return {"best": max(rates), "median": float(np.median(rates))}
