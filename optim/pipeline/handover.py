"""From a gait to the next on a rig, without venting its lines: ways of changing shape, and tables that join.

A table tells lines what to do from where its state 0 ends. So a change of shape has a table from where the gait before
it ends, and the gait after it is entered by the table of that gait from where the change ends.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from optim.pipeline.plans import core_of
from robots.hardware import GaitTable, PneumaticRig, Start, gait_table
from robots.hardware.joined import Part, joined_faults
from robots.inflatable.design import InflatableDesign
from robots.inflatable.transition import change_of_shape


class Way(NamedTuple):
    """A way of changing shape."""

    together: bool  # whether the bladders empty while the core changes, instead of before it
    grip: float  # level of the feet

    def __str__(self) -> str:
        when, feet = "while" if self.together else "after", "grip" if self.grip else "slide"
        return f"{when} the bladders empty, feet {feet}"


WAYS = (Way(False, 1.0), Way(True, 1.0), Way(False, 0.0))  # in the order in which they are tried


def shape_change(
    before: InflatableDesign,
    after: InflatableDesign,
    way: Way,
    times: tuple[float, float],
    robot: Mapping[str, Any],
) -> InflatableDesign:
    """What the robot does between two gaits of different shapes; times are those of the core up and down [s]."""
    return change_of_shape(
        core_of(before),
        core_of(after),
        after.orientation,
        grip=way.grip,
        together=way.together,
        times=times,
        **robot,
    )


class Handover(NamedTuple):
    """Tables between the mains of two gaits, of which prefixes without their states 0 are played."""

    change: GaitTable | None  # of shape; None where it stays
    entry: GaitTable  # of the gait that comes; has no ``start`` if it begins as its own table does


def handover(
    before: InflatableDesign, change: InflatableDesign | None, after: InflatableDesign, rig: PneumaticRig
) -> Handover:
    """Make the tables between two gaits, and perhaps a change of shape; raises RigViolation if the rig refuses one."""
    made = None if change is None else gait_table(change, rig, start=Start.after(before))
    start = Start.after(before if change is None else change)
    return Handover(made, gait_table(after, rig, start=None if start == Start.of(after) else start))


def handover_faults(before: GaitTable, between: Handover, after: GaitTable, rig: PneumaticRig) -> list[str]:
    """What tables ask of a rig beyond its limits from the end of a gait's main to the next main, a line each."""
    change = [] if between.change is None else [Part(between.change, "prefix")]
    return joined_faults([Part(before, "main"), *change, Part(between.entry, "prefix"), Part(after, "main")], rig)
