"""Settings of a simulation of designs: its world and computation, and what to record and differentiate.

The result is an ``Outcome``, see ``robots.outcome``.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

from robots.outcome import World
from taichi_sim.base.compute import Compute

HERE = Compute()
Progress = Callable[[float], None]


def part_of(progress: Progress | None, done: int, count: int, size: int = 1) -> Progress | None:
    """Progress of the next ``size`` parts after ``done`` of ``count`` equal ones, told as that of all, or None."""
    return (lambda fraction: progress((done + size * fraction) / count)) if progress else None


@dataclasses.dataclass(frozen=True)
class Trial:
    """Settings of a simulation of designs: its world and computation, and what to record and differentiate.

    Attributes:
        world: world in which the designs are simulated.
        compute: device, precision and threads.
        record_every: time steps between recorded poses; None for none.
        progress: called now and then with the fraction done.
        gradients: names of the measures whose gradients are asked for.
        sharpness: how strongly designs between true ones are pushed towards these; infinite: only true ones count.
        gradient_horizon: time [s] over which gradients see what a change of shape or speed does, of robots that can
            tell; see :mod:`taichi_sim.lattice.fading`. None: all the time, they are exact.
    """

    world: World
    compute: Compute = HERE
    record_every: int | None = None
    progress: Progress | None = None
    gradients: tuple[str, ...] = ()
    sharpness: float = math.inf
    gradient_horizon: float | None = None

    def parts(self, worlds: Sequence[World]) -> "list[Trial]":
        """Return the settings for each of several worlds, simulated one after the other."""
        told = (part_of(self.progress, number, len(worlds)) for number in range(len(worlds)))
        pairs = zip(worlds, told, strict=True)
        return [dataclasses.replace(self, world=world, progress=part) for world, part in pairs]
