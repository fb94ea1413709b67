"""Central pattern generators: coupled oscillators, one a muscle, which what is felt makes quicker, larger, later.

Source: Ijspeert, Crespi, Ryczko & Cabelguen, "From swimming to walking with a salamander robot driven by a spinal cord
model", Science 315, 1416-1420, 2007: oscillators with coupled phases (Kuramoto's) and controlled amplitudes. (differs:
time counts in cycles of waves that are given; phases are told as leads over them and amplitudes as growth, so that
oscillators that nothing modulates play the waves, whatever their shape; each listens to the mean of all.)

Differentiable by ``taichi_sim.autodiff.arrays.trace``.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from robots.control.networks import LayeredNetwork
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

STRONGEST = 2.0  # coupling, with which steps of a sixteenth of a cycle are stable
QUICKNESS = 20.0  # 1/cycle: the source's a, of amplitudes, whose time constant is 2 / a
PARTS = 3  # of what is modulated: rate, amplitude, phase


@dataclass(frozen=True)
class Oscillators:
    """N oscillators that are coupled all to all, and the network that modulates them by what is felt.

    Each has a lead d [cycles] over its wave and a growth g of its amplitude, both 0 at the start. The network answers
    a rate r, an amplitude a and a phase p for each of them, from -gain to gain. With the time in cycles

        d' = r + coupling mean_j (1 + g_j) sin(2 pi (d_j - p_j - d + p)),
        g'' = QUICKNESS (QUICKNESS / 4 (a - g) - g').

    Growth goes to ``a`` without going beyond it, so it is never more than the gain.

    Attributes:
        network: from what is felt to 3 N modulations: all rates, all amplitudes, all phases.
        coupling: how strongly leads are drawn to where phases have them, in cycles per cycle.
    """

    network: LayeredNetwork
    coupling: Annotated[float, partial(checks.number, low=0.0, high=STRONGEST)] = 0.5

    def __post_init__(self) -> None:
        checks.check_fields(self)
        if self.network.outputs % PARTS:
            raise ValueError(f"network: {self.network.outputs} outputs are not allowed; give three an oscillator")

    @property
    def count(self) -> int:
        """How many oscillators there are, N."""
        return self.network.outputs // PARTS

    def start(self, batch: int) -> tuple[Floats, ...]:
        """State of B robots at the start: leads, growths and rates of growths, shape (B, N) each."""
        return tuple(np.zeros((batch, self.count)) for _ in range(3))

    def step(self, weights: Any, felt: Any, span: float, lead: Any, growth: Any, growing: Any) -> tuple[Any, ...]:
        """The state after a span of time [cycles] in which what is felt stays.

        Args:
            weights: of the network, shape (B, K).
            felt: shape (B, inputs).
            span: of time [cycles]; leads take one step of Euler's method, growths are exact.
            lead, growth, growing: the state, shape (B, N) each.
        """
        modulated = self.network.answer(weights, felt)
        rate, amplitude, phase = (modulated[:, n * self.count : (n + 1) * self.count] for n in range(PARTS))
        own = lead - phase
        apart = 2 * np.pi * (own[:, None, :] - own[:, :, None])
        drawn = ((1.0 + growth)[:, None, :] * np.sin(apart)).mean(axis=2)
        quick, off = QUICKNESS / 2, growth - amplitude
        slope, decay = growing + quick * off, np.exp(-quick * span)
        after = amplitude + (off + slope * span) * decay
        return lead + span * (rate + self.coupling * drawn), after, (growing - quick * slope * span) * decay


def waves_shifted(waves: Any, node: int, lead: Any, growth: Any) -> Any:
    """What leads [cycles] and growths add to periodic waves at one of their nodes, shape (B, C); exactly 0 without.

    Between its nodes a wave is the trigonometric polynomial through them; its mean does not grow.

    Args:
        waves: values at even times of a cycle, an even number S of them, shape (B, C, S).
        node: which of them is added to.
        lead, growth: shape (B, C).
    """
    even, odd = _harmonics(waves.shape[2], node)
    along, across = ((waves[:, :, :, None] * part).sum(axis=2) for part in (even, odd))
    angle, scale = 2 * np.pi * np.arange(1, even.shape[1] + 1) * lead[:, :, None], (1.0 + growth)[:, :, None]
    return (along * (scale * np.cos(angle) - 1.0) - across * (scale * np.sin(angle))).sum(axis=2)


def reach(wave: Floats) -> float:
    """A bound of how far from its mean a wave with values at even times, shape (S,), is at any lead."""
    even, odd = _harmonics(len(wave), 0)
    return float(np.hypot(wave @ even, wave @ odd).sum())


def _harmonics(size: int, node: int) -> tuple[Floats, Floats]:
    """What each node adds to the harmonics at one node, and a quarter of their cycle before, shape (S, S / 2) each."""
    angle = 2 * np.pi / size * np.outer(node - np.arange(size), np.arange(1, size // 2 + 1))
    weight = np.full(size // 2, 2.0 / size)
    weight[-1] = 1.0 / size  # the last one has no quadrature: its nodes are its peaks
    return weight * np.cos(angle), weight * np.sin(angle)
