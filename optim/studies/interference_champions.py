"""Champions, run once more: their paths, and whether two environments look alike to them.

Source: dissertation, chapter 2, "Discussion": whegged robots "may 'sidestep' catastrophic interference by rapidly
turning unfamiliar environments into familiar ones". Then the light signals of a robot's environments are alike, and its
paths too, once they are turned so that the lights coincide.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from optim.measures.homeostasis import homeostasis
from optim.studies.interference_evolution import Run
from optim.studies.interference_settings import Arrays, Floats, Interference, Treatment
from optim.studies.interference_tables import measure
from robots.quadruped import TIME_STEP
from taichi_sim.signals import warping_distances

FRAMES = 500  # of a signal, at most
EARLY = 10.0  # s
APART = 0.3  # m, a body length
NEAR = 0.5  # m, from the light


@dataclass(frozen=True, eq=False)
class Champions:
    """What the champions of a treatment did; R runs, E environments, F moments.

    Attributes:
        times: (F,) [s].
        paths: of the main body, seen from above, (R, E, F, 2) [m].
        light: readings, (R, E, F) [1/m^2].
        distance: from the light at the end, (R, E) [m].
    """

    times: Floats
    paths: Floats
    light: Floats
    distance: Floats


def champions_of(
    settings: Interference, found: Mapping[Run, Arrays], threads: int | None = None
) -> dict[Treatment, Champions]:
    """Run the champions of all runs again, treatment by treatment."""
    measured = measure(found)
    seen = {}
    for treatment in dict.fromkeys(treatment for treatment, _ in found):
        runs = [key for key in found if key[0] == treatment]
        weights = np.stack([found[key]["weights"][measured[key].champion] for key in runs])
        seen[treatment] = follow(settings, treatment.robot, weights, threads)
    return seen


def follow(settings: Interference, robot: str, weights: Floats, threads: int | None = None) -> Champions:
    """What controllers, (R, 5, 8), do over time."""
    every = max(1, -(-settings.steps // FRAMES))
    result = settings.simulate(robot, weights, threads, record_every=every)
    frames = result.rollouts.frames
    assert frames is not None  # they were asked for
    shape = (len(weights), len(settings.lights), len(frames.times))
    return Champions(frames.times, frames.position[:, :, :2].swapaxes(0, 1).reshape(*shape, 2),
                     frames.readings[:, :, -1].T.reshape(shape), result.distance)  # fmt: skip


def warping(light: Floats, threads: int | None = None) -> Floats:
    """How far light signals of a robot's environments are apart, (R,): dynamic time warping of signals, (R, E, F).

    Signals have mean 0 and deviation 1 before, and pairs of environments are averaged.
    """
    compare = partial(warping_distances, normalise=True, threads=threads)
    return homeostasis(light[:, :, None, :], compare)


def turned(paths: Floats, lights: Sequence[Sequence[float]]) -> Floats:
    """Paths, (R, E, F, 2), each turned about the start so that its light lies where the first one's does."""
    angle = np.arctan2(*np.array(lights, float).T[::-1])
    back = angle[0] - angle
    turn = np.array([[np.cos(back), -np.sin(back)], [np.sin(back), np.cos(back)]])
    return np.einsum("ije,refj->refi", turn, paths)


def asymmetry(paths: Floats, lights: Sequence[Sequence[float]]) -> Floats:
    """Mean distance over time between the turned paths of a robot's environments, (R,) [m]; 0: it treats all alike."""
    return np.asarray(_apart(turned(paths, lights)).mean(axis=(1, 2)))


def divergence(paths: Floats, times: Floats) -> Floats:
    """When the paths of a robot's environments first are a body length apart, (R,) [s], pairs averaged.

    Paths that never are count as if they were at the end.
    """
    far = _apart(paths) > APART
    first = np.where(far.any(axis=2), far.argmax(axis=2), len(times) - 1)
    return np.asarray(times[first].mean(axis=1))


def _apart(paths: Floats) -> Floats:
    """Distances between each two environments' paths at the same time, (R, pairs, F) [m]."""
    one, other = np.triu_indices(paths.shape[1], k=1)
    return np.asarray(np.linalg.norm(paths[:, one] - paths[:, other], axis=-1))


def likeness(
    champions: Mapping[Treatment, Champions], settings: Interference, threads: int | None = None
) -> dict[str, dict[Treatment, Floats]]:
    """By quantity and treatment, the numbers of its champions, those that failed left out."""
    found: dict[str, dict[Treatment, Floats]] = {}
    for treatment, seen in champions.items():
        early = seen.times < EARLY
        numbers = {
            "warping": warping(seen.light, threads),
            "warping_early": warping(seen.light[:, :, early], threads),
            "asymmetry": asymmetry(seen.paths, settings.lights),
            "divergence": divergence(seen.paths, seen.times),
        }
        for name, values in numbers.items():
            found.setdefault(name, {})[treatment] = values[np.isfinite(values)]
    return found


def time_near(seen: Champions) -> tuple[Floats, Floats]:
    """Time within half a metre of the light [s], (R, E): in all, and without leaving until the end."""
    near: NDArray[np.bool_] = seen.light >= 1 / NEAR**2
    step = seen.times[1] - seen.times[0] if len(seen.times) > 1 else TIME_STEP
    last = np.cumprod(near[..., ::-1], axis=-1)
    return near.sum(axis=-1) * step, last.sum(axis=-1) * step


def typical(seen: Champions) -> int:
    """The run whose champion's worst distance is the median of all, the better of two."""
    order = np.argsort(seen.distance.max(axis=1), kind="stable")
    return int(order[(len(order) - 1) // 2])
