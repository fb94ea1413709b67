"""Find measurements that lie too far off the fitted model to be noise: mistakes of reading, or what the model lacks."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import t

from optim.calibration.misfit import ASSUMED, SMALLEST, Linearised
from robots.calibration import Experiment
from robots.calibration.experiments import spoken_reading

FALSE_ALARM = 0.05  # probability that data without outliers are told to have one
FEWEST = 5  # values of an experiment from which one can be told from the others


def outliers(found: Linearised, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """Measurements far from what the others of their experiment say, a line each, the farthest first.

    Each residual is divided by its standard deviation as all others of the experiment tell it (externally studentised,
    Cook & Weisberg, Residuals and Influence in Regression, 1982), and compared with Student's quantile for the largest
    of N (Bonferroni). What the properties can change of an experiment is left out of its residuals first, so that noise
    and outliers of others, which pull at the same properties, do not count. No deviation is below one that is given, or
    ``SMALLEST``. As outliers hide each other, the farthest is left out before the next is looked for.

    Args:
        found: weighted misfit at the end of a fit, of N points.
        experiments: that have these points, in their order.
    """
    count, sure = len(found.residuals), found.sure
    edges = np.cumsum([len(each.values) for each in experiments])[:-1]
    lines = []
    for experiment, points in zip(experiments, np.split(np.arange(count), edges), strict=True):
        kept = points
        least = SMALLEST / ASSUMED if experiment.deviations is None else 1.0
        while len(kept) >= FEWEST:
            projection = np.eye(len(kept)) - sure[kept] @ np.linalg.pinv(sure[kept])
            left, residuals = np.diag(projection), projection @ found.residuals[kept]
            freedom = round(left.sum()) - 1
            if freedom < 1:
                break
            squares = np.where(left > 1e-9, residuals**2 / np.maximum(left, 1e-9), 0.0)
            others = (residuals @ residuals - squares) / freedom
            sizes = np.sqrt(squares / np.maximum(others, least**2))
            farthest = int(sizes.argmax())
            if sizes[farthest] <= t.ppf(1 - FALSE_ALARM / 2 / count, freedom):
                break
            lines.append((float(sizes[farthest]), spoken_reading(experiment, int(kept[farthest] - points[0]))))
            kept = np.delete(kept, farthest)
    return tuple(f"{line} lies {size:.3g} standard deviations of the others off" for size, line in sorted(lines)[::-1])
