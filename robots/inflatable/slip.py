"""How far the feet of the inflatable robot slip under load, as far as they are told to grip.

A gait that inches or rolls pushes off feet that stay where they are; one that slides for its living does not. With
Coulomb's law a foot that grips either sticks or slides, so slip is a property of the gait, not of a spring.
"""

import numpy as np

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import FOOT_REGIONS
from robots.inflatable.contact import Contact
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS, FEET
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.timing import gait_timeline
from taichi_sim.base.arrays import Floats


def slip_under_load(
    result: InflatableResult, design: InflatableDesign, actuation: InflatableActuation = ACTUATION, robot: int = 0
) -> Floats:
    """The way that each foot slips, as far as it grips and as its load feels it [m], shape (2,).

    Between two frames a foot slips by the mean way of its voxels along the ground, each weighted by its load: the depth
    at which it is in the ground, to which its force is proportional. Voxels that are not on the ground at both frames
    do not count. A foot told half of its grip counts half. While the robot settles both feet grip.

    Args:
        result: with frames; slip shorter than the way between two frames and back is not seen.
        design: what was simulated.
        actuation: how it was driven.
        robot: place in the batch.

    Raises:
        ValueError: for a result without frames.
    """
    contact = Contact.of(result, design, robot)
    load, way = contact.load, contact.way
    gripping = _gripping(design, actuation, contact.times / result.time_step)
    slip = np.zeros(FEET)
    for foot, region in enumerate(FOOT_REGIONS):
        mine = contact.kinds == region
        borne = load[:, mine].sum(axis=1)
        mean = np.divide((load * way)[:, mine].sum(axis=1), borne, out=np.zeros_like(borne), where=borne > 0)
        slip[foot] = mean @ gripping[:, foot]
    return slip


def _gripping(design: InflatableDesign, actuation: InflatableActuation, steps: Floats) -> Floats:
    """How much each foot grips all the time between two frames, from 0 to 1, shape (F - 1, 2)."""
    gait = gait_timeline(design, actuation)
    grips = np.ones((len(steps) - 1, FEET))
    for begin, end, told in zip(gait.edges[:-1], gait.settles, gait.levels[BLADDERS:].T, strict=True):
        moving = (steps[1:] > begin) & (steps[:-1] < end)
        grips[moving] = np.minimum(grips[moving], told)
    return grips
