"""How sure fitted properties are.

Standard errors of weighted nonlinear least squares (Seber & Wild, "Nonlinear Regression", 1989, ch. 2 and 5), for
errors of two kinds: the noise of the measurement, and what contact makes of a start that no one knows to a micrometre,
which is correlated along a track.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

from optim.calibration.misfit import REPLICAS, Linearised
from taichi_sim.base.arrays import Bools, Floats

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How sure K properties are."""

    errors: Floats  # standard errors of the logarithms, which are relative standard errors, shape (K,)
    reach: Floats  # half widths of the 95 % confidence intervals of the logarithms, shape (K,)
    correlation: Floats  # between the errors, shape (K, K)
    chaos: Floats  # part of each error's variance that is the simulator's scatter, shape (K,)
    noise: float  # root mean square of the residuals, in standard deviations, for the degrees of freedom left


def uncertainty(found: Linearised, given: Bools, share: Floats) -> Uncertainty:
    """Uncertainty of a fit that ended at a point.

    Variances that are assumed are scaled by what the residuals say. So are given ones if the residuals are larger
    than these allow, never if they are smaller. The simulator's scatter counts once for the rig, whose one run is as
    chaotic, and once for the mean of the replicas.

    Args:
        given: which points' standard deviations are given, shape (N,).
        share: of the measurement in the variance that each residual is weighted by, shape (N,).
    """
    slopes, freedom = found.slopes, found.slopes.shape[0] - found.slopes.shape[1]
    scale = float(found.residuals @ found.residuals) / freedom
    solve = np.linalg.pinv(slopes)
    measured = share * np.where(given, max(scale, 1.0), scale)
    noise = (solve * measured) @ solve.T
    chaos = solve @ (found.scatter * (1 + 1 / REPLICAS)) @ solve.T
    covariance = noise + chaos
    errors = np.sqrt(np.diag(covariance))
    safe = np.where(errors > 0, errors, 1.0)
    level = (1 + CONFIDENCE) / 2
    reach = errors * float(norm.ppf(level) if given.all() else t.ppf(level, freedom))
    return Uncertainty(errors, reach, covariance / np.outer(safe, safe), np.diag(chaos) / safe**2, scale**0.5)
