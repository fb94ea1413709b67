"""Designing the body of a soft voxel walker for one terrain, by its speed: the problem of version 1.0."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import WALKER, Evaluation, check_kind
from optim.problems.robot import JudgedRobot
from robots.lattice_robot.walker import WalkerActuation, WalkerDesign, check_terrain
from robots.lattice_robot.walker_offered import WalkerRobot
from robots.robot import KINDS, World
from robots.world import Terrain

OPTIONS = ("encoding", "precision", "device")


@dataclass(frozen=True, eq=False)
class WalkerProblem(JudgedRobot):
    """Objective: the speed along +x [lengths of the lattice per second], see ``robots.lattice_robot.walker``.

    The variables are the genes of the body, see ``robots.lattice_robot.walker_encoding``; the actuation is fixed.

    Attributes:
        shape: (X, Y, Z) of the lattice in which bodies lie.
        encoding: of the body, ``"direct"`` or ``"pattern"``.
        terrain: where it walks.
        actuation: of active voxels, and how long.
        precision, device, threads, progress: see :class:`JudgedRobot`.
    """

    shape: tuple[int, ...] = (4, 4, 3)
    encoding: str = "direct"
    terrain: Terrain = field(default_factory=Terrain)
    actuation: WalkerActuation = field(default_factory=WalkerActuation)
    precision: str = "f64"
    device: str = "cpu"
    threads: int | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", self.offered.shape)
        check_terrain(self.terrain)

    @cached_property
    def offered(self) -> WalkerRobot:
        """The lattice, as any kind of robot is seen."""
        return WalkerRobot(self.shape, self.encoding, self.actuation)

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The terrain."""
        return (self.terrain,)

    def design(self, point: ArrayLike) -> WalkerDesign:
        """The design of a point, shape (D,)."""
        return self.offered.bodies(self.space.validate(point))[0]

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate all points, shape (N, D).

        Details: ``distance`` [m], and ``voxels``, the size of the body, each of shape (N,).
        """
        found = super().evaluate(points)
        voxels = np.array([len(self.design(point).connected[1]) for point in np.atleast_2d(points)])
        return dataclasses.replace(found, details={**found.details, "voxels": voxels})

    def describe(self) -> dict[str, Any]:
        """All that results depend on; :meth:`from_description` builds the problem again."""
        return {
            "kind": WALKER,
            "shape": list(self.shape),
            "terrain": KINDS[WALKER].world_record(self.terrain),
            "actuation": dataclasses.asdict(self.actuation),
            **{name: getattr(self, name) for name in OPTIONS},
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> "WalkerProblem":
        """The problem that :meth:`describe` described.

        Raises:
            ValueError: that names what is missing, unknown or not allowed.
        """
        check_kind(description, WALKER)
        settings = {name: value for name, value in description.items() if name != "kind"}
        try:
            settings["terrain"] = Terrain(**description["terrain"])
            settings["actuation"] = WalkerActuation(**description["actuation"])
            settings["shape"] = tuple(description["shape"])
            return cls(**settings)
        except (KeyError, TypeError) as error:
            raise ValueError(f"problem: its description is damaged ({error})") from None
