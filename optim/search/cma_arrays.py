"""The numbers of the library ``cmaes`` as plain arrays; the only place that knows its private attributes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Arrays, Floats

if TYPE_CHECKING:
    from cmaes import CMAwM

# What changes from generation to generation: of the inner CMA, and of the margin around it, which is there only
# if a variable is discrete. Between two generations nothing else has a value that the constructor would not give.
INNER = ("_mean", "_C", "_sigma", "_p_sigma", "_pc", "_g", "_funhist_values")
MARGIN = ("_A", "m_z_lim_low", "m_z_lim_up")


def build_strategy(mean: Floats, sigma: float, bounds: Floats, steps: Floats, population: int) -> "CMAwM":
    """A strategy that has not been told anything.

    Args:
        mean: shape (D,).
        sigma: step size.
        bounds: low and high of each variable, shape (D, 2).
        steps: between the values of a discrete variable, 0 of a continuous one, shape (D,).
        population: points a generation.
    """
    from cmaes import CMAwM  # it costs time, and not every search needs it

    strategy = CMAwM(mean=mean, sigma=sigma, bounds=bounds, steps=steps, population_size=population, seed=0)
    strategy._cma._funhist_values[:] = 0.0  # not initialised by the library, though never read before it is set
    return strategy


def to_arrays(strategy: "CMAwM") -> Arrays:
    """What changes of a strategy, by name; to be taken after it was told, before it is asked again."""
    inner = {name.strip("_"): np.array(getattr(strategy._cma, name)) for name in INNER}
    return inner | {name.strip("_"): np.array(getattr(strategy, name)) for name in MARGIN if hasattr(strategy, name)}


def set_arrays(strategy: "CMAwM", arrays: Mapping[str, NDArray[Any]]) -> None:
    """Put into a strategy of the same shape what :func:`to_arrays` returned."""
    for owner, names in ((strategy._cma, INNER), (strategy, MARGIN)):
        for name in names:
            if (values := arrays.get(name.strip("_"))) is not None:
                setattr(owner, name, values.copy() if values.ndim else values.item())
