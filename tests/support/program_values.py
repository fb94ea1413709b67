"""Values of the channels of a program, as its events set them."""

import numpy as np

from taichi_sim.lattice import LatticeProgram


def values_after(
    program: LatticeProgram, robot: int, region: int, quantity: int, steps: np.ndarray
) -> np.ndarray | None:
    """Return the values of a channel in the last of so many steps, shape of ``steps``; None if it is never set.

    After no steps it is what the first step begins with. Before its first event it is NaN: the material tells.
    """
    events = program.events
    mine = events[(events["robot"] == robot) & (events["region"] == region) & (events["quantity"] == quantity)]
    if not len(mine):
        return None
    mine = mine[np.argsort(mine["step"], kind="stable")]
    last = np.maximum(np.asarray(steps) - 1, 0)
    place = np.searchsorted(mine["step"], last, side="right") - 1
    event = mine[np.maximum(place, 0)]
    return np.where(place >= 0, event["value"] + event["rate"] * (last - event["step"]), np.nan)
