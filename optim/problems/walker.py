"""Designing the body of a soft voxel walker for one terrain."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import WALKER, Evaluation, check_kind
from optim.problems.walker_encoding import ENCODINGS, WalkerEncoding
from optim.space import Space
from robots.lattice_robot import walker
from robots.lattice_robot.walker import WalkerActuation, WalkerDesign
from robots.world import Terrain
from taichi_sim.base.checks import whole_number

OPTIONS = ("encoding", "precision", "device")


@dataclass(frozen=True, eq=False)
class WalkerProblem:
    """Objective: the speed along +x [lengths of the lattice per second], see ``robots.lattice_robot.walker``.

    The variables are the genes of the body, see ``optim.problems.walker_encoding``; the actuation is fixed.

    Attributes:
        shape: (X, Y, Z) of the lattice in which bodies lie.
        encoding: of the body, one of ``ENCODINGS``: ``"direct"``, ``"pattern"``.
        terrain: where it walks.
        actuation: of active voxels, and how long.
        precision: ``"f32"`` or ``"f64"``.
        device: ``"cpu"``, ``"cuda"``, ``"vulkan"`` or ``"metal"``.
        threads: CPU threads, all available if None; changes no result, so it is not part of the description.
        progress: called now and then during an evaluation with the fraction done; not part of it either.
    """

    shape: tuple[int, int, int] = (4, 4, 3)
    encoding: str = "direct"
    terrain: Terrain = field(default_factory=Terrain)
    actuation: WalkerActuation = field(default_factory=WalkerActuation)
    precision: str = "f64"
    device: str = "cpu"
    threads: int | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        shape = tuple(self.shape)
        if len(shape) != 3:
            raise ValueError(f"shape: {shape} is not allowed; give (X, Y, Z)")
        object.__setattr__(self, "shape", tuple(whole_number("shape", side, 1) for side in shape))
        if self.encoding not in ENCODINGS:
            raise ValueError(f"encoding: {self.encoding!r} is unknown; choose one of {', '.join(ENCODINGS)}")
        walker.WalkerTissue().on(self.terrain)

    @property
    def objective_names(self) -> tuple[str, ...]:
        """The speed."""
        return ("speed",)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Lengths of the lattice per second."""
        return ("lattices/s",)

    @cached_property
    def _body(self) -> WalkerEncoding:
        return ENCODINGS[self.encoding](self.shape)

    @cached_property
    def space(self) -> Space:
        """The genes."""
        return Space(tuple(self._body.variables()))

    def design(self, point: ArrayLike) -> WalkerDesign:
        """The design of a point, shape (D,)."""
        return self._body.design(self.space.validate(point))

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate all points, shape (N, D).

        Details: ``distance`` [m], and ``voxels``, the size of the body, each of shape (N,).
        """
        designs = [self.design(point) for point in self.space.validate(np.atleast_2d(points))]
        result = walker.simulate(
            designs,
            self.terrain,
            actuation=self.actuation,
            precision=self.precision,
            device=self.device,
            threads=self.threads,
            progress=self.progress,
        )
        voxels = np.array([len(design.connected[1]) for design in designs])
        status = np.where(result.reason == "", result.status, result.reason)
        return Evaluation(result.speed, status, {"distance": result.distance, "voxels": voxels})

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of a point as JSON, for ``robots.lattice_robot.walker.load_walker``."""
        walker.save_walker(self.design(point), path)

    def describe(self) -> dict[str, Any]:
        """All that results depend on; :meth:`from_description` builds the problem again."""
        terrain = {name: value for name, value in dataclasses.asdict(self.terrain).items() if value is not None}
        return {
            "kind": WALKER,
            "shape": list(self.shape),
            "terrain": terrain,
            "actuation": dataclasses.asdict(self.actuation),
            **{name: getattr(self, name) for name in OPTIONS},
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> "WalkerProblem":
        """The problem that :meth:`describe` described.

        Raises:
            ValueError: in one line, that names what is missing, unknown or not allowed.
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
