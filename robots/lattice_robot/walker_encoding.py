"""How a search writes the body of a soft walker: voxel by voxel, or as a pattern in space."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from robots.control.pattern import GENE_STEP, PatternWiring
from robots.lattice_robot.walker import EMPTY, KINDS, PASSIVE, WalkerDesign
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice
from taichi_sim.base.variables import Variable


@dataclass(frozen=True)
class WalkerEncoding(ABC):
    """Genomes of a body. ``values`` are those of :meth:`variables`, shape (G,).

    Attributes:
        shape: (X, Y, Z) of the lattice.
    """

    shape: tuple[int, ...]

    @abstractmethod
    def variables(self) -> list[Variable]:
        """The genes."""

    @abstractmethod
    def design(self, values: Floats) -> WalkerDesign:
        """The body of a genome; it may be no robot."""


class DirectBody(WalkerEncoding):
    """The material of every voxel, ``voxel_1_1_1`` and so on (x, y, z), in the order of ``WalkerDesign.materials``."""

    def variables(self) -> list[Variable]:
        """One whole number a voxel, 0 to 3."""
        names = ("voxel_" + "_".join(str(i + 1) for i in place) for place in np.ndindex(self.shape))
        return [Variable(name, 0, len(KINDS) - 1, "integer", step=GENE_STEP) for name in names]

    def design(self, values: Floats) -> WalkerDesign:
        """The materials as they are."""
        return WalkerDesign(np.rint(np.asarray(values, float)).astype(np.int8).reshape(self.shape))


BODY_WIRING = PatternWiring(inputs=("x", "y", "z", "radius"), outputs=("presence", *KINDS[PASSIVE:]))


class PatternBody(WalkerEncoding):
    """Weights and functions of a network that says of every place whether there is a voxel, and of which material.

    The network knows the place, -1 to 1 along each side of the lattice, and its distance from the middle. There is a
    voxel where presence > 0; it is of the material that says most. Source: Cheney et al. 2013, see ``walker``.
    """

    def variables(self) -> list[Variable]:
        """The genome of the network; it is the same for lattices of any shape."""
        return BODY_WIRING.variables()

    def design(self, values: Floats) -> WalkerDesign:
        """Material by material, place by place."""
        sides = np.meshgrid(*((2 * np.arange(n) + 1) / n - 1 for n in self.shape), indexing="ij")
        places = np.stack([side.ravel() for side in sides], axis=1)
        said = BODY_WIRING.network(values)(np.column_stack([places, np.sqrt((places**2).sum(axis=1))]))
        kinds = np.where(said[:, 0] > 0, PASSIVE + said[:, 1:].argmax(axis=1), EMPTY)
        return WalkerDesign(kinds.astype(np.int8).reshape(self.shape))


ENCODINGS: dict[str, type[WalkerEncoding]] = {"direct": DirectBody, "pattern": PatternBody}


def encoding_of(name: str, shape: tuple[int, ...]) -> WalkerEncoding:
    """The encoding of a name, of bodies in a lattice of a shape (X, Y, Z)."""
    return ENCODINGS[choice("encoding", name, ENCODINGS)](shape)
