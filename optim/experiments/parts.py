"""Parts of a study: computed one after the other, and kept, so that a kill loses at most the part at hand."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from numpy.typing import NDArray

from optim.experiments.results import Progress, cached, part_of
from optim.experiments.trials import Trials
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

Part = Callable[[Progress], Arrays]


def computed(folder: ResultsFolder | None, parts: Mapping[str, Part], progress: Progress = None) -> dict[str, Arrays]:
    """Load the parts of a study from its folder, or compute and keep them there.

    Args:
        folder: None keeps nothing.
        parts: by name, functions that compute the arrays and take a progress of their own.
        progress: called with the fraction done of all.
    """
    found = {}
    for number, (name, compute) in enumerate(parts.items()):
        found[name] = cached(folder, name, partial(compute, part_of(progress, number, len(parts))))
        if progress:
            progress((number + 1) / len(parts))
    return found


def computed_arrays(
    folder: ResultsFolder, key: str, parts: Mapping[str, Callable[[Progress], NDArray[Any]]], progress: Progress
) -> list[NDArray[Any]]:
    """Load or compute parts of a single array each, which files call ``key``; see :func:`computed`."""

    def named(compute: Callable[[Progress], NDArray[Any]], progress: Progress) -> Arrays:
        return {key: compute(progress)}

    found = computed(folder, {name: partial(named, compute) for name, compute in parts.items()}, progress)
    return [arrays[key] for arrays in found.values()]


def computed_trials(
    folder: ResultsFolder | None, arms: Mapping[str, Callable[..., Trials]], progress: Progress
) -> dict[str, Trials]:
    """Load or run the trials of every arm of a study; see :func:`computed`.

    Args:
        folder: None keeps nothing.
        arms: by name, ``record_trials`` with all its arguments but ``progress``.
        progress: called with the fraction done of all.
    """

    def arrays(run: Callable[..., Trials], progress: Progress) -> Arrays:
        return run(progress=progress).arrays

    found = computed(folder, {f"trials_{name}": partial(arrays, run) for name, run in arms.items()}, progress)
    return dict(zip(arms, map(Trials.from_arrays, found.values()), strict=True))
