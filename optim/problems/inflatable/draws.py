"""How relaxed gaits are judged beside the true ones: on average over noise and friction, and on gentler slopes."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.problem import OK
from robots.inflatable.actuation import InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.materials import MOST_FRICTION
from robots.uncertainty import Risk, Uncertainty
from robots.world import Terrain, friction_of_parts
from taichi_sim.base.arrays import Floats


@dataclass(frozen=True)
class Draws:
    """Copies of robots that differ in the noise of their start and in friction, the same ones for every robot.

    Attributes:
        count: K, copies of each robot.
        noise: standard deviation of start positions [m].
        spread: s: friction is multiplied by 1 / (1 + s) to 1 + s, evenly on a logarithmic scale.
    """

    count: int = 1
    noise: float = 0.0
    spread: float = 0.0

    @property
    def frictions(self) -> Floats:
        """By which the friction of each copy is multiplied, shape (K,)."""
        return np.asarray((1.0 + self.spread) ** np.linspace(-1, 1, self.count) if self.count > 1 else np.ones(1))

    def robots(
        self, designs: Sequence[InflatableDesign], terrain: Terrain, actuation: InflatableActuation
    ) -> tuple[list[InflatableDesign], Terrain | list[Terrain]]:
        """The copies of N designs, N K of them, those of a design in a row, and the terrain of all or of each."""
        if not self.spread or terrain.is_fluid:
            return [design for design in designs for _ in range(self.count)], terrain
        own, copies, terrains = actuation.on(terrain), [], []
        for design in designs:
            for factor in self.frictions.tolist():
                high, low = own.high_friction * factor, own.low_friction * factor
                feet = {"high_friction": high, "low_friction": low}
                terrains.append(dataclasses.replace(terrain, **feet, **friction_of_parts(own, factor)))
                copies.append(_with_friction(design, factor))
        return copies, terrains

    def noise_of(self, count: int) -> dict[str, Any]:
        """The noise of the copies of so many designs, as options of a simulation."""
        return {"perturbation": self.noise, "seed": tuple(range(self.count)) * count} if self.noise else {}

    def mean(self, values: Floats) -> Floats:
        """Means over the copies of each design, shape (N, ...), of values of shape (N K, ...)."""
        return values.reshape(len(values) // self.count, self.count, *values.shape[1:]).mean(axis=1)

    def first_failure(self, status: NDArray[Any]) -> NDArray[Any]:
        """The first status of a copy that is not ok, or ok, shape (N,)."""
        each = np.asarray(status).reshape(-1, self.count)
        return each[np.arange(len(each)), np.argmax(each != OK, axis=1)]


@dataclass(frozen=True)
class UncertainDraws:
    """Copies of robots on ground that is not known exactly, the same ones for every robot.

    Attributes:
        uncertainty: what is drawn.
        risk: how scores over the draws become one.
        count: K, draws.
    """

    uncertainty: Uncertainty
    risk: Risk
    count: int

    def terrains(self, robots: int, terrain: Terrain, actuation: InflatableActuation) -> list[Terrain]:
        """The ground of K copies of so many robots, those of a robot in a row."""
        own = actuation.high_friction, actuation.low_friction
        return [one.on(terrain, *own) for one in self.uncertainty.draw(self.count)] * robots

    def judged(self, speeds: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """Speeds of N K copies and their derivatives, shape (N K, D), as those of N robots under risk."""
        each = speeds.reshape(-1, self.count)
        weights = self.risk.weights(each)[:, :, None]
        return self.risk.of(each), np.asarray((weights * slopes.reshape(*each.shape, -1)).sum(axis=1))


def _with_friction(design: InflatableDesign, factor: float) -> InflatableDesign:
    """The design whose feet have another friction, if it has one of its own."""
    if design.materials is None or design.materials.friction is None:
        return design
    friction: Any = np.minimum(np.array(design.materials.friction) * factor, MOST_FRICTION)
    return dataclasses.replace(design, materials=dataclasses.replace(design.materials, friction=friction))


def eased(terrain: Terrain, sharpness: float, gentle: float) -> Terrain:
    """The terrain on which relaxed gaits of a sharpness are judged: a part of its slope below ``gentle``.

    A sharpness of 0 is that of methods that do not sharpen, which are judged on the slope as it is.
    """
    if not terrain.slope or not 0 < sharpness < gentle:
        return terrain
    return dataclasses.replace(terrain, slope=terrain.slope * sharpness / gentle)
