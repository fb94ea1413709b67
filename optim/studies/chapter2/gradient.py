"""Climbers that follow gradients through the simulation: a tenth treatment, beside the nine of chapter 2.

A climber steps along the gradient of its fitness' logarithm, twice as far after a success, half as far after a failure.
Where steps keep failing, at a jump that gradients do not see or where chaos blows them up, it mutates as a hill climber
does until that helps. Derivatives are taken only where a climber has moved; each costs about five evaluations.
"""

import numpy as np

from optim.studies.chapter2.climbers import HillClimbers
from optim.studies.chapter2.settings import ROBOTS, Interference, Treatment
from robots.quadruped.robot import VARIANTS, differentiate
from taichi_sim.base.arrays import Arrays, Floats

FIRST, LONGEST = 0.1, 1.0  # steps; a mutation is 0.05 sqrt(40) = 0.32 long
GROWTH, SHRINKAGE = 2.0, 0.5
PATIENCE = 5  # steps in vain before it mutates
AT_ONCE = 200  # rollouts to differentiate at a time: 2 MB each


class GradientClimbers(HillClimbers):
    """P climbers that follow their gradients; see ``interference_climbers.Climbers``."""

    def __init__(self, treatment: Treatment, run: int, settings: Interference, threads: int | None = None) -> None:
        """Set up the climbers; arguments as of :class:`HillClimbers`, which starts at the same points."""
        super().__init__(treatment, run, settings)
        self.robot, self.way = ROBOTS[treatment.robot], treatment.fitness
        self.settings, self.threads = settings, threads
        self.uphill = np.zeros_like(self.weights)
        self.step = np.full(settings.population, FIRST)
        self.failures = np.zeros(settings.population, int)
        self.derivatives = 0

    def ask(self) -> Floats:
        """Starts, then a step along the gradient or a mutation of each climber."""
        mutated = super().ask()
        if self.generation == 0:
            return mutated
        stepped = self.weights + self.step[:, None, None] * self.uphill
        stepped = np.clip(stepped, -1, 1) if self.bounded else stepped
        return np.where(self._patient[:, None, None], stepped, mutated)

    def tell(self, weights: Floats, light: Floats, distance: Floats) -> None:
        """Keep what is better, take its gradient, and choose the next steps."""
        stepping = self._patient & (self.generation > 0)
        kept = self._keep(weights, light, distance)
        self.step = np.where(
            stepping,
            np.where(kept, np.minimum(GROWTH * self.step, LONGEST), SHRINKAGE * self.step),
            np.where(kept, FIRST, self.step),
        )
        self.failures = np.where(kept, 0, self.failures + 1)
        moved = np.flatnonzero(kept)
        self.derivatives += len(moved)
        each = max(1, AT_ONCE // len(self.settings.lights))
        for first in range(0, len(moved), each):
            chosen = moved[first : first + each]
            self.uphill[chosen] = self._directions(self.weights[chosen])

    def state(self) -> Arrays:
        """As of :class:`HillClimbers`, with directions, steps, failures in a row, and derivatives taken so far."""
        return {
            **super().state(),
            "uphill": self.uphill,
            "step": self.step,
            "failures": self.failures,
            "derivatives": np.array(self.derivatives),
        }

    def restore(self, state: Arrays) -> None:
        """Continue from :meth:`state`."""
        super().restore(state)
        self.uphill, self.step, self.failures = state["uphill"], state["step"], state["failures"]
        self.derivatives = int(state["derivatives"])

    @property
    def _patient(self) -> np.ndarray:
        return self.failures < PATIENCE

    def _directions(self, weights: Floats) -> Floats:
        """Unit gradients of the logarithm of the fitness; zero where there is none."""
        own = self.settings
        done, slopes = differentiate(
            self.robot,
            weights,
            own.lights,
            variant=VARIANTS[own.variant],
            steps=own.steps,
            precision=own.precision,
            device=own.device,
            threads=self.threads,
        )
        shares = fitness_shares(self.way, done.light)
        found = np.einsum("pe,peij->pij", shares, slopes)
        lengths = np.sqrt((found**2).sum((1, 2), keepdims=True))
        return np.nan_to_num(np.divide(found, lengths, where=lengths > 0, out=np.zeros_like(found)), posinf=0, neginf=0)


def fitness_shares(fitness: str, light: Floats) -> Floats:
    """Derivatives of the logarithm of a fitness by the readings of the environments, (P, E).

    Args:
        fitness: ``"sum"``, ``"product"`` or ``"min"``.
        light: readings, (P, E) [1/m^2].
    """
    if fitness == "sum":
        return np.repeat(1 / light.sum(-1, keepdims=True), light.shape[-1], -1)
    if fitness == "product":
        return 1 / light
    lowest = light == light.min(-1, keepdims=True)
    return lowest / (lowest.sum(-1, keepdims=True) * light)
