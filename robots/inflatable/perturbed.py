"""Inflatable robots whose bladders inflate less or more, slower or faster than told, and whose feet rub otherwise.

What is drawn of that, see ``robots.uncertainty``, is put into designs and actuations.
"""

from dataclasses import replace

import numpy as np

from robots.inflatable.actuation import InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.rubbing import Rubbing
from robots.inflatable.schedule import BLADDERS
from robots.uncertainty import Perturbation
from taichi_sim.base.arrays import Floats


def rubbing_of(drawn: Perturbation, least: float = 0.0) -> Rubbing:
    """How feet with friction of their own rub as drawn; ``least`` is the smallest friction of sliding ones before."""
    return Rubbing(drawn.gripping, drawn.sliding, least)


def perturbed_design(design: InflatableDesign, drawn: Perturbation, least: float = 0.0) -> InflatableDesign:
    """The design with the levels of its bladders, its feet's friction and its own times multiplied as drawn.

    Bladders fill at most. Where levels are drawn, columns in which no bladder moves are not skipped: other levels would
    move some. ``least`` is the smallest friction of sliding feet before the draw.
    """
    design = rubbing_of(drawn, least).of(design)
    schedule = design.schedule
    if drawn.levels:
        inflation = np.minimum(schedule.inflation * np.reshape(drawn.levels, (-1, 1)), 1.0)
        schedule = replace(schedule, levels=np.concatenate([inflation, schedule.grip]), skip_idle=False)
    if drawn.timing != 1:
        schedule = schedule.in_steps_of(1 / drawn.timing)
    return design if schedule is design.schedule else replace(design, schedule=schedule)


def perturbed_drive(actuation: InflatableActuation, drawn: Perturbation) -> InflatableActuation:
    """The actuation with strokes and published waits that last as long as drawn."""
    if drawn.timing == 1:
        return actuation
    rate, settle = actuation.inflation_rate / drawn.timing, round(actuation.settle_steps * drawn.timing)
    return replace(actuation, inflation_rate=rate, settle_steps=settle)


def level_slopes(design: InflatableDesign, drawn: Perturbation) -> Floats:
    """Derivatives of the levels of :func:`perturbed_design` by those of the design, shape (10, T)."""
    slopes = np.ones_like(design.schedule.levels)
    if drawn.levels:
        factors = np.reshape(drawn.levels, (-1, 1))
        slopes[:BLADDERS] = np.where(design.schedule.inflation * factors <= 1, factors, 0.0)
    return slopes
