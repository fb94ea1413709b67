"""Settings of computations: device, precision and threads."""

import os
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal, Self, TypedDict

from taichi_sim.base.checks import check_fields, choice, integer

Device = Literal["cpu", "cuda", "vulkan", "metal"]
Precision = Literal["f32", "f64"]

DEVICES = ("cpu", "cuda", "vulkan", "metal")
PRECISIONS = ("f32", "f64")
MOST_THREADS = 1024
Threads = Annotated[int | None, partial(integer, low=1, high=MOST_THREADS)]  # all available ones if None


class ComputeOptions(TypedDict, total=False):
    """Keyword arguments of public functions that become the fields of :class:`Compute`."""

    device: str
    precision: str
    threads: int | None


@dataclass(frozen=True)
class Compute:
    """Device, precision and threads of a simulation.

    The rule for precision: ``"f64"`` is the default wherever a person asks for a result; searches over soft robots
    take ``"f32"``, which is twice as fast, because they compare many designs.

    Attributes:
        device: ``"cpu"``, ``"cuda"``, ``"vulkan"`` or ``"metal"``.
        precision: precision of all real numbers, ``"f32"`` or ``"f64"``.
        threads: CPU threads that share a batch, all available ones if None; results do not depend on it.

    Raises:
        ValueError: for a value that is not allowed.
    """

    device: Annotated[str, partial(choice, names=DEVICES)] = "cpu"
    precision: Annotated[str, partial(choice, names=PRECISIONS)] = "f64"
    threads: Threads = None

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def given(cls, options: ComputeOptions) -> Self:
        """Make the settings from keyword arguments; missing ones have their defaults."""
        return cls(**options)

    @property
    def options(self) -> ComputeOptions:
        """Convert the settings to keyword arguments of public functions."""
        return {"device": self.device, "precision": self.precision, "threads": self.threads}

    @property
    def thread_count(self) -> int:
        """Number of CPU threads to use on this machine."""
        return available_threads() if self.threads is None else self.threads


def available_threads() -> int:
    """Number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
