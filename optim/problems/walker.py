"""The design problem of version 1.0 for a soft voxel walker: the fastest body on one terrain."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import WALKER, Evaluation, check_kind
from optim.problems.robot import RobotDesignProblem
from robots.lattice_robot.walker import WalkerActuation, WalkerDesign, check_terrain
from robots.lattice_robot.walker_robot import WalkerRobot
from robots.robot import KINDS, World
from robots.world import Terrain

OPTIONS = ("encoding", "precision", "device")


@dataclass(frozen=True, eq=False)
class WalkerProblem(RobotDesignProblem):
    """Design the body of a soft voxel walker by its speed along +x [lengths of the lattice per second].

    The variables are the genes of the body, see ``robots.lattice_robot.walker_encoding``; the actuation is fixed.

    Attributes:
        shape: (X, Y, Z) of the lattice in which bodies lie.
        encoding: of the body, ``"direct"`` or ``"pattern"``.
        terrain: where it walks.
        actuation: of active voxels, and how long.
    """

    shape: tuple[int, ...] = (4, 4, 3)
    encoding: str = "direct"
    terrain: Terrain = field(default_factory=Terrain)
    actuation: WalkerActuation = field(default_factory=WalkerActuation)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", self.offered.shape)
        check_terrain(self.terrain)

    @cached_property
    def offered(self) -> WalkerRobot:
        """The walker as a robot of its kind, with its free parameters."""
        return WalkerRobot(self.shape, self.encoding, self.actuation)

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The terrain on which the walker is simulated, as the only world."""
        return (self.terrain,)

    def design(self, point: ArrayLike) -> WalkerDesign:
        """Return the design of a point, shape (D,)."""
        return self.offered.bodies(self.space.validate(point))[0]

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate all points, shape (N, D).

        Details: ``distance`` [m], and ``voxels``, the size of the body, each of shape (N,).
        """
        found = super().evaluate(points)
        voxels = np.array([len(self.design(point).connected[1]) for point in np.atleast_2d(points)])
        return dataclasses.replace(found, details={**found.details, "voxels": voxels})

    @property
    def detail_names(self) -> set[str]:
        """Names of the details that every evaluation contains."""
        return super().detail_names | {"voxels"}

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values; :meth:`from_description` builds the problem again."""
        return {
            "kind": WALKER,
            "shape": list(self.shape),
            "terrain": KINDS[WALKER].world_record(self.terrain),
            "actuation": dataclasses.asdict(self.actuation),
            **{name: getattr(self, name) for name in OPTIONS},
        }

    @classmethod
    def settings_of(cls, description: Mapping[str, Any]) -> dict[str, Any]:
        """Convert a description from :meth:`describe` to the fields of the problem."""
        check_kind(description, WALKER)
        return {
            **{name: value for name, value in description.items() if name != "kind"},
            "terrain": Terrain(**description["terrain"]),
            "actuation": WalkerActuation(**description["actuation"]),
            "shape": tuple(description["shape"]),
        }
