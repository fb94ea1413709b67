"""A gait as the point with which a search begins."""

import dataclasses

from optim.problems.inflatable.encoding import ENCODINGS, BitwiseGait, GradedGait, GradedWaveGait
from optim.problems.inflatable.problem import GaitProblem
from robots.inflatable.cores import each_pressure
from robots.inflatable.design import InflatableDesign


def start_values(problem: GaitProblem, design: InflatableDesign) -> dict[str, float]:
    """The variables of a problem, by name, of a design; what is fixed is not among them.

    A core that is empty begins in the middle of the pressures that say so, see ``optim.problems.inflatable.shape``.

    Args:
        problem: of bits, graded levels or waves, with the columns of the design.
        design: the gait.

    Raises:
        ValueError: in one line, for gaits that the encoding cannot say.
    """
    values = [design.orientation] if problem.orientation is None else []
    if problem.pressure is None:
        values += [p if p > 0 else problem.shape.least / 2 for p in each_pressure(design.pressure, problem.body)]
    if problem.schedule is None:
        values += _genes(problem, design)
    return dict(zip(problem.space.names, values, strict=True))


def _genes(problem: GaitProblem, design: InflatableDesign) -> list[float]:
    """Of the schedule."""
    encoding, columns = ENCODINGS[problem.encoding], design.schedule.columns
    if encoding not in (BitwiseGait, GradedGait, GradedWaveGait):
        raise ValueError(f"start: encoding {problem.encoding!r} cannot say a gait; choose bits, graded or graded-wave")
    if columns != problem.columns:
        raise ValueError(f"start: a gait of {columns} columns is not allowed; the search has {problem.columns}")
    schedule = design.schedule
    if encoding is GradedGait or encoding is GradedWaveGait:
        return [float(gene) for gene in encoding.genome(dataclasses.replace(schedule, repeats=1), problem.actuation)]
    if schedule.has_own_times or not schedule.is_on_off:
        raise ValueError("start: bits cannot say levels between 0 and 1, nor times; choose encoding graded")
    return [float(level) for level in schedule.levels.ravel()]
