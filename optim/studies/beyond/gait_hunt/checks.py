"""Checks of what both studies of the hunt are given."""

from collections.abc import Sequence

from robots.inflatable.robot import NAMED_GEOMETRIES
from robots.world import STEEPEST
from taichi_sim.base import checks


def check_settings(seeds: Sequence[int], slope: float, geometry: str, finalists: int, runs: int) -> None:
    """Raise a one-line ValueError for what no study of gaits can do.

    Args:
        seeds: of runs, each once.
        slope: of the hill [degrees].
        geometry: of the robot, by name.
        finalists: designs that are played in full.
        runs: of each of them.
    """
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: {tuple(seeds)} are not allowed; give at least one, and none twice")
    for seed in seeds:
        checks.integer("seeds", seed, 0)
    checks.number("slope", slope, 0.1, STEEPEST, "degrees")
    checks.choice("geometry", geometry, NAMED_GEOMETRIES)
    checks.integer("finalists", finalists, 1)
    checks.integer("runs", runs, 1)
