"""What a point says of every cell of a grid: is it there, what of, and how does its muscle move?

Fields are functions of points that may be traced (``taichi_sim.autodiff.arrays``), so all of them have derivatives.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from robots.control.pattern import PatternWiring
from robots.freeform.grid import Grid
from taichi_sim.autodiff.arrays import mapped
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import positive, whole_number
from taichi_sim.base.variables import Kind, Variable

RESOLUTION = 1e-12  # of a muscle's swing: below it an amplitude has no phase
STEEP = 30.0  # no exponent is larger
EDGE = 0.5  # half the width of a blob's border [cells]
WEIGHT_LIMIT = 4.0  # of a coordinate network
VOID, LUMP = 0.8, 1.5  # largest radii of balls, for random voids to empty about a third of a grid
MUTATION = 0.1  # of a range
FLIP = 0.22  # of a binary variable: a mutation changes 2.3 % of them, those whose deviate exceeds 0.5


@dataclass(frozen=True, eq=False)
class Fields:
    """What N points say of the V cells of a grid.

    Attributes:
        presence: 0 to 1; cells above a half are there, shape (N, V).
        tissue: weight of each of T tissues, shape (N, V, T); the largest decides.
        swing: components of the muscles' wave, cosine and sine of its phase times its part of the largest amplitude,
            shape (N, V, 2), at most 1 long.
    """

    presence: Any
    tissue: Any
    swing: Any


@dataclass(frozen=True)
class Parametrisation(ABC):
    """How a point writes fields. Subclasses are the ways.

    Attributes:
        grid: of the cells.
        tissues: T, in the palette.
        solid: whether all cells are there.
        amplitude: largest of the muscles, part of a voxel's edge.
    """

    grid: Grid
    tissues: int
    solid: bool
    amplitude: float

    @abstractmethod
    def variables(self) -> list[Variable]:
        """What a search may change."""

    @abstractmethod
    def _free_fields(self, points: Any) -> tuple[Any, Any, Any]:
        """Presence, tissue, swing of free cells, shapes (N, F), (N, F, T), (N, F, 2); those of no use are None."""

    def __call__(self, points: Any) -> Fields:
        """The fields of points, shape (N, P)."""
        presence, tissue, swing = self._free_fields(points)
        shape = (len(points), self.grid.count)
        source = self.grid.source
        return Fields(
            np.ones(shape) if self.solid else presence[:, source],
            np.ones((*shape, 1)) if self.tissues == 1 else tissue[:, source],
            _shortened(swing)[:, source],
        )


def _shortened(swing: Any) -> Any:
    """Vectors along the last axis, shortened to length 1 where they are longer."""
    return swing / np.maximum(np.sqrt((swing * swing).sum(axis=-1, keepdims=True) + RESOLUTION**2), 1.0)


def _waves(amplitude: Any, phase: Any) -> Any:
    """Components of waves, shape (..., 2), of their amplitudes and phases [cycles]."""
    turn = 2 * np.pi * phase
    return np.stack([amplitude * np.cos(turn), amplitude * np.sin(turn)], axis=-1)


def _sigmoid(x: Any) -> Any:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


class Cells(Parametrisation):
    """Every cell has its own presence (0 or 1), tissue weights, amplitude and phase."""

    presence_kind: ClassVar[Kind] = "binary"

    def variables(self) -> list[Variable]:
        """``presence_X_Y_Z`` and so on, places counted from 1, by kind; the first tissue's weight is a half.

        Before any search all cells are there, of the first tissue, and a wave runs along x.
        """
        count = len(self.grid.free)
        ones, along = np.ones(count), self.grid.places[self.grid.free, 0] / self.grid.shape[0]
        found = [] if self.solid else self._of_cells("presence", 1, ones, self.presence_kind)
        for tissue in range(2, self.tissues + 1):
            found += self._of_cells(f"tissue_{tissue}", 1, 0 * ones)
        found += self._of_cells("amplitude", self.amplitude, ones * self.amplitude / 2)
        return found + self._of_cells("phase", 1, along, "angle")

    def _of_cells(self, field: str, high: float, start: Floats, kind: Kind = "continuous") -> list[Variable]:
        """A variable of each free cell, from 0, with its place."""
        found, step = [], FLIP if kind == "binary" else MUTATION * high
        for place, first in zip(self.grid.places[self.grid.free].tolist(), start.tolist(), strict=True):
            name = "_".join([field, *(str(side + 1) for side in place)])
            mixes = kind == "continuous" and field != "amplitude"
            found.append(Variable(name, 0, high, kind, step, start=first, place=tuple(place), mixes=mixes))
        return found

    def _free_fields(self, points: Any) -> tuple[Any, Any, Any]:
        count = len(self.grid.free)
        parts = [points[:, first : first + count] for first in range(0, points.shape[1], count)]
        presence = None if self.solid else parts[0]
        *weights, amplitude, phase = parts if self.solid else parts[1:]
        tissue = np.stack([np.full((len(points), count), 0.5), *weights], axis=-1) if weights else None
        return presence, tissue, _waves(amplitude / self.amplitude, phase)


@dataclass(frozen=True)
class FilteredCells(Cells):
    """Cells whose fields are means over their neighbourhood, so that designs have a length scale.

    Attributes:
        radius: of the neighbourhood [cells].
    """

    radius: float = 1.8
    presence_kind: ClassVar[Kind] = "continuous"

    def __post_init__(self) -> None:
        positive("detail", self.radius, float(max(self.grid.shape)))  # what users call it

    @cached_property
    def _weights(self) -> sparse.csr_array:
        return self.grid.smoothing(self.radius)

    def _free_fields(self, points: Any) -> tuple[Any, Any, Any]:
        presence, tissue, swing = super()._free_fields(points)

        def smoothed(field: Any) -> Any:
            return None if field is None else np.moveaxis(mapped(self._weights, np.moveaxis(field, 1, -1)), -1, 1)

        return smoothed(presence), smoothed(tissue), smoothed(swing)


@dataclass(frozen=True)
class Blobs(Parametrisation):
    """Balls that move and grow: voids, muscles, and lumps of each tissue after the first.

    Source: Matthews et al., PNAS 120(41), 2023, e2305180120 (voids and muscles in the plane).

    Attributes:
        balls: of each kind.
    """

    balls: int = 16

    def __post_init__(self) -> None:
        whole_number("balls", self.balls, 1)

    @property
    def _kinds(self) -> list[str]:
        lumps = [f"tissue_{tissue}" for tissue in range(2, self.tissues + 1)]
        return [*([] if self.solid else ["void"]), *lumps, "muscle"]

    def variables(self) -> list[Variable]:
        """``void_1_x`` and so on [cells from the middle], radii [cells], then amplitudes and phases of the muscles.

        Before any search nothing is empty, and the balls lie along x.
        """
        found, numbers = [], range(1, self.balls + 1)
        for kind in self._kinds:
            for axis, side in zip("xyz", self.grid.shape, strict=True):
                ends, step = (-side / 2, side / 2), MUTATION * side
                along = [(n - 0.5) / self.balls * side - side / 2 if axis == "x" else 0.0 for n in numbers]
                mixes = kind != "muscle"
                found += [
                    Variable(f"{kind}_{n}_{axis}", *ends, step=step, start=along[n - 1], mixes=mixes) for n in numbers
                ]
            each = (self.grid.count / self.balls) ** (1 / 3)  # edge of a cube, were the grid cut into equal ones
            most = max(1.0, (VOID if kind == "void" else LUMP) * each)
            first = 0.0 if kind == "void" else most / 2
            found += [Variable(f"{kind}_{n}_radius", 0.0, most, step=MUTATION * most, start=first) for n in numbers]
        largest = self.amplitude
        found += [Variable(f"muscle_{n}_amplitude", 0, largest, step=MUTATION * largest) for n in numbers]
        places = {n: n / (self.balls + 1) for n in numbers}
        return found + [Variable(f"muscle_{n}_phase", 0, 1, "angle", MUTATION, start=places[n]) for n in numbers]

    def _free_fields(self, points: Any) -> tuple[Any, Any, Any]:
        rows = [points[:, first : first + self.balls] for first in range(0, points.shape[1], self.balls)]
        inside = {kind: self._inside(rows[4 * n : 4 * n + 4]) for n, kind in enumerate(self._kinds)}
        presence, tissue = None, None
        if not self.solid:
            depth = np.minimum(inside["void"], STEEP)
            presence = np.exp(-np.log(1.0 + np.exp(depth)).sum(axis=2))  # the product of all that is outside each
        if self.tissues > 1:
            lumps = [_sigmoid(inside[kind]).sum(axis=2) for kind in self._kinds if kind.startswith("tissue")]
            tissue = np.stack([np.full(np.shape(lumps[0]), 0.5), *lumps], axis=-1)
        weight = _sigmoid(inside["muscle"])[..., None]
        waves = _waves(rows[-2] / self.amplitude, rows[-1])[:, None]
        swing = (weight * waves).sum(axis=2) / np.maximum(weight.sum(axis=2), 1.0)
        return presence, tissue, swing

    def _inside(self, rows: list[Any]) -> Any:
        """How deep each free cell is inside each ball, in widths of its border, shape (N, F, balls)."""
        squares = 0.0
        for axis in range(3):
            away = self.grid.coordinates[:, axis][:, None] - rows[axis][:, None]
            squares = squares + away * away
        return (rows[3][:, None] - np.sqrt(squares + RESOLUTION)) / EDGE


@dataclass(frozen=True)
class CoordinateNetwork(Parametrisation):
    """A network with one hidden layer of sines that says of each place what is there.

    Source: Sitzmann et al., Implicit neural representations with periodic activation functions, NeurIPS 2020.

    Attributes:
        hidden: nodes of the layer.
    """

    hidden: int = 24

    def __post_init__(self) -> None:
        whole_number("hidden", self.hidden, 1)

    @property
    def _outputs(self) -> list[str]:
        lumps = [f"tissue_{tissue}" for tissue in range(2, self.tissues + 1)]
        return [*([] if self.solid else ["presence"]), *lumps, "cosine", "sine"]

    def variables(self) -> list[Variable]:
        """Weights of the hidden nodes, then those of the outputs, the bias last."""
        inputs, nodes = ("x", "y", "z", "bias"), [f"hidden{n + 1}" for n in range(self.hidden)]
        names = [f"weight_{node}_{source}" for node in nodes for source in inputs]
        names += [f"weight_{output}_{source}" for output in self._outputs for source in (*nodes, "bias")]
        first = np.random.default_rng(0).uniform(-WEIGHT_LIMIT, WEIGHT_LIMIT, len(names)).tolist()
        ends, step = (-WEIGHT_LIMIT, WEIGHT_LIMIT), MUTATION * WEIGHT_LIMIT
        mixes = len(self._outputs) > 2
        return [Variable(n, *ends, step=step, start=w, mixes=mixes) for n, w in zip(names, first, strict=True)]

    def _free_fields(self, points: Any) -> tuple[Any, Any, Any]:
        count, hidden, outputs = len(points), self.hidden, len(self._outputs)
        places = self.grid.coordinates / (max(self.grid.shape) / 2)
        known = np.column_stack([places, np.ones(len(places))])
        first = points[:, : 4 * hidden].reshape(count, 1, hidden, 4)
        heard = (known[:, None, :] * first).sum(axis=3)
        said = np.concatenate([np.sin(heard), np.ones((count, len(places), 1))], axis=2)[:, :, None]
        last = points[:, 4 * hidden :].reshape(count, 1, outputs, hidden + 1)
        found = (said * last).sum(axis=3) * (2.0 / np.sqrt(hidden))
        return _of_outputs(found, self.solid, self.tissues)


@dataclass(frozen=True)
class Pattern(CoordinateNetwork):
    """A compositional pattern-producing network, whose nodes choose their functions; it has no gradient.

    See ``robots.control.pattern``.
    """

    hidden: int = 8

    @property
    def _wiring(self) -> PatternWiring:
        return PatternWiring(("x", "y", "z", "radius"), tuple(self._outputs), self.hidden)

    def variables(self) -> list[Variable]:
        """The genome of the network."""
        return self._wiring.variables()

    def _free_fields(self, points: Any) -> tuple[Any, Any, Any]:
        places = self.grid.coordinates / (np.array(self.grid.shape) / 2)
        known = np.column_stack([places, np.sqrt((places**2).sum(axis=1))])
        found = np.stack([self._wiring.network(point)(known) for point in points])
        return _of_outputs(found, self.solid, self.tissues)


def _of_outputs(found: Any, solid: bool, tissues: int) -> tuple[Any, Any, Any]:
    """Fields of what a network says, shape (N, F, outputs)."""
    presence = None if solid else _sigmoid(found[..., 0])
    first = found[..., 0 if solid else 1 :]
    tissue = None
    if tissues > 1:
        tissue = np.concatenate([np.full((*first.shape[:2], 1), 0.5), _sigmoid(first[..., : tissues - 1])], axis=2)
    return presence, tissue, np.tanh(first[..., tissues - 1 :])


PARAMETRISATIONS: dict[str, type[Parametrisation]] = {
    "cells": Cells,
    "filtered": FilteredCells,
    "blobs": Blobs,
    "network": CoordinateNetwork,
    "pattern": Pattern,
}
