"""How relaxed gaits are judged beside the true ones: on average over noise and friction, and on gentler slopes."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from optim.problem import OK
from robots.inflatable.actuation import InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.perturbed import level_slopes, perturbed_design, perturbed_drive, rubbing_of
from robots.inflatable.rubbing import Rubbing
from robots.inflatable.schedule import BLADDERS
from robots.inflatable.timing import predicted_steps
from robots.uncertainty import Perturbation, Risk, Uncertainty
from robots.world import Terrain, friction_of_parts
from taichi_sim.base.arrays import Floats, Indices, Ints

FEW = 0.7  # share of the draws that weigh, up to which these are found before slopes are taken


@dataclass(frozen=True, eq=False)
class Copies:
    """What is simulated of N designs over K draws: N K robots, those of a design in a row.

    Attributes:
        designs: one for each copy.
        terrains: of all, or of each.
        drives: how all are driven, or each is.
        by_friction: derivatives of the friction of the copies' own feet by that of the designs, shape (N K, 2, 2, 2),
            see ``Rubbing.slopes``.
        by_level: derivatives of the levels of the copies by those of the designs, shape (N K, 10, T), or of all.
    """

    designs: list[InflatableDesign]
    terrains: Terrain | list[Terrain]
    drives: InflatableActuation | list[InflatableActuation]
    by_friction: Floats
    by_level: Floats | float = 1.0

    def some(self, rows: Indices) -> "Copies":
        """Some of the copies, by number."""
        return Copies(
            [self.designs[row] for row in rows],
            self.terrains if isinstance(self.terrains, Terrain) else [self.terrains[row] for row in rows],
            self.drives if isinstance(self.drives, InflatableActuation) else [self.drives[row] for row in rows],
            self.by_friction[rows],
            self.by_level if isinstance(self.by_level, float) else self.by_level[rows],
        )


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
        """Friction factor of each copy, shape (K,)."""
        return np.asarray((1.0 + self.spread) ** np.linspace(-1, 1, self.count) if self.count > 1 else np.ones(1))

    def copies(
        self, designs: Sequence[InflatableDesign], terrain: Terrain, actuation: InflatableActuation, least: float = 0.0
    ) -> Copies:
        """The copies of N designs on a terrain; ``least`` is the smallest friction of feet that slide."""
        factors = np.tile(self.frictions, len(designs)).tolist()
        copies = [design for design in designs for _ in range(self.count)]
        rubbed = [Rubbing(factor, factor, least) for factor in factors]
        made = [each.of(design) for each, design in zip(rubbed, copies, strict=True)]
        by_friction = np.array([each.slopes(design) for each, design in zip(rubbed, copies, strict=True)])
        if not self.spread or terrain.is_fluid:
            return Copies(made, terrain, actuation, by_friction)
        own, terrains = actuation.on(terrain), []
        for factor in factors:
            high, low = own.high_friction * factor, own.low_friction * factor
            feet = {"high_friction": high, "low_friction": low}
            terrains.append(dataclasses.replace(terrain, **feet, **friction_of_parts(own, factor)))
        return Copies(made, terrains, actuation, by_friction)

    def noise_of(self, count: int) -> dict[str, Any]:
        """The noise of the copies of so many designs, as options of a simulation."""
        return {"perturbation": self.noise, "seed": tuple(range(self.count)) * count} if self.noise else {}

    def steps(self, designs: Sequence[InflatableDesign], actuation: InflatableActuation) -> Ints:
        """Time steps of the copies of each design, together, shape (N,)."""
        return self.count * np.array([predicted_steps(design, actuation) for design in designs])

    def judged(self, speeds: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """Speeds of N K copies and their derivatives, shape (N K, D), as those of N robots: their means."""
        count = len(speeds) // self.count
        return speeds.reshape(count, -1).mean(axis=1), slopes.reshape(count, self.count, -1).mean(axis=1)

    @property
    def few_that_weigh(self) -> Callable[[Floats], Indices] | None:
        """How to find the copies that count, by number, from the speeds of all; None where that saves no time."""
        return None

    def first_failure(self, status: NDArray[Any]) -> NDArray[Any]:
        """The first status of a copy that is not ok, or ok, shape (N,)."""
        each = np.asarray(status).reshape(-1, self.count)
        return each[np.arange(len(each)), np.argmax(each != OK, axis=1)]


@dataclass(frozen=True)
class UncertainDraws(Draws):
    """Copies of robots of which, or of whose ground, something is not known exactly: the same draws for every robot.

    Attributes:
        uncertainty: what is drawn.
        risk: how scores over the draws become one.
    """

    _: dataclasses.KW_ONLY
    uncertainty: Uncertainty
    risk: Risk

    @cached_property
    def drawn(self) -> list[Perturbation]:
        """What is drawn, one for each copy of a robot."""
        return self.uncertainty.draw(self.count, actuators=BLADDERS)

    @property
    def few_that_weigh(self) -> Callable[[Floats], Indices] | None:
        """How to find the copies that the risk counts, if few; to simulate all takes a sixth of the time of slopes."""
        if max(math.ceil(self.risk.share * self.count), 1) > FEW * self.count:
            return None
        return lambda speeds: np.flatnonzero(self.risk.weights(speeds.reshape(-1, self.count)))

    def part(self, rows: Indices) -> Self:
        """Some of the draws, by number."""
        some = dataclasses.replace(self, count=len(rows))
        object.__setattr__(some, "drawn", [self.drawn[row] for row in rows])
        return some

    def copies(
        self, designs: Sequence[InflatableDesign], terrain: Terrain, actuation: InflatableActuation, least: float = 0.0
    ) -> Copies:
        """The copies of N designs on a terrain, as drawn; ``least`` is the smallest friction of feet that slide."""
        count = len(designs)
        return Copies(
            [perturbed_design(design, one, least) for design in designs for one in self.drawn],
            [one.on(terrain, actuation) for one in self.drawn] * count,
            [perturbed_drive(actuation, one) for one in self.drawn] * count if self.uncertainty.timing else actuation,
            np.array([rubbing_of(one, least).slopes(design) for design in designs for one in self.drawn]),
            np.array([level_slopes(design, one) for design in designs for one in self.drawn]),
        )

    def steps(self, designs: Sequence[InflatableDesign], actuation: InflatableActuation) -> Ints:
        """Time steps of the copies of each design, together, shape (N,); strokes and waits differ by what is drawn."""
        if not self.uncertainty.drives:
            return super().steps(designs, actuation)
        drives = [(one, perturbed_drive(actuation, one)) for one in self.drawn]
        each = [[predicted_steps(perturbed_design(design, one), drive) for one, drive in drives] for design in designs]
        return np.array(each).sum(axis=1)

    def judged(self, speeds: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """Speeds of N K copies and their derivatives, shape (N K, D), as those of N robots under risk."""
        each = speeds.reshape(-1, self.count)
        weights = self.risk.weights(each)[:, :, None]
        return self.risk.of(each), np.asarray((weights * slopes.reshape(*each.shape, -1)).sum(axis=1))


def eased(terrain: Terrain, sharpness: float, gentle: float) -> Terrain:
    """The terrain on which relaxed gaits of a sharpness are judged: a part of its slope below ``gentle``.

    A sharpness of 0 is that of methods that do not sharpen, which are judged on the slope as it is.
    """
    if not terrain.slope or not 0 < sharpness < gentle:
        return terrain
    return dataclasses.replace(terrain, slope=terrain.slope * sharpness / gentle)
