"""Draw the chart of a schedule: the levels of the inflatable robot's actuators over time."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.view.colours import BLADDERS, FEET
from robots.view.drawing import draw_levels

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_schedule(axes: "Axes", schedule: GaitSchedule, edges: ArrayLike | None = None) -> None:
    """Draw the levels of the inflatable robot's actuators, with all repeats, in ten rows with bladder 1 on top.

    Args:
        axes: to draw on.
        schedule: schedule of T columns, played R times.
        edges: beginnings and ends of the columns, such as times [s], shape (T R + 1,); by default numbers of columns.
    """
    played = np.tile(schedule.levels, schedule.repeats)
    ticks = np.arange(played.shape[1] + 1.0) if edges is None else np.asarray(edges, float)
    numbers = [str(i + 1) for group in (BLADDERS, FEET) for i in range(len(group))]
    numbers[0], numbers[len(BLADDERS)] = "bladder 1", "foot 1"
    draw_levels(axes, played, ticks, np.array([*BLADDERS, *FEET]), numbers, apart=len(BLADDERS))
    axes.xaxis.set_major_locator(MaxNLocator(integer=edges is None))
