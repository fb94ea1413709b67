"""The inflatable shape-changing robot: what its designs do on a terrain.

A *design* is a core pressure, a heading and a schedule. A *schedule* has levels of ten actuators, from off (0) to on
(1), over *columns*: actuation states, each with its motion and its settling. A *stroke* is one inflation or deflation
of a bladder. A *gait* is a design as files hold it.

Source: Powers 2021 dissertation, ch. 5 ("A soft robot that adapts to environments through shape change"); Shah, Powers
et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported

if TYPE_CHECKING:
    from robots.frames import Frames
    from robots.inflatable.actuation import ACTUATION, InflatableActuation
    from robots.inflatable.body import NAMED_GEOMETRIES, PUBLISHED, SMALL, TWO_CORE, InflatableGeometry
    from robots.inflatable.design import INCHING, ROLLING, InflatableDesign
    from robots.inflatable.files import load_design, save_design
    from robots.inflatable.gradient import InflatableGradient, differentiate
    from robots.inflatable.program import Counting
    from robots.inflatable.schedule import MAXIMUM_PRESSURE, GaitSchedule
    from robots.inflatable.simulation import InflatableResult, sideways, simulate
    from robots.inflatable.timing import predicted_steps

__all__ = [
    "ACTUATION",
    "INCHING",
    "MAXIMUM_PRESSURE",
    "NAMED_GEOMETRIES",
    "PUBLISHED",
    "ROLLING",
    "SMALL",
    "TWO_CORE",
    "Counting",
    "Frames",
    "GaitSchedule",
    "InflatableActuation",
    "InflatableDesign",
    "InflatableGeometry",
    "InflatableGradient",
    "InflatableResult",
    "differentiate",
    "load_design",
    "predicted_steps",
    "save_design",
    "sideways",
    "simulate",
]

__getattr__ = exported(
    __name__,
    {
        "Frames": "robots.frames",
        "ACTUATION": "robots.inflatable.actuation",
        "InflatableActuation": "robots.inflatable.actuation",
        "NAMED_GEOMETRIES": "robots.inflatable.body",
        "PUBLISHED": "robots.inflatable.body",
        "SMALL": "robots.inflatable.body",
        "TWO_CORE": "robots.inflatable.body",
        "InflatableGeometry": "robots.inflatable.body",
        "MAXIMUM_PRESSURE": "robots.inflatable.schedule",
        "INCHING": "robots.inflatable.design",
        "ROLLING": "robots.inflatable.design",
        "InflatableDesign": "robots.inflatable.design",
        "load_design": "robots.inflatable.files",
        "save_design": "robots.inflatable.files",
        "Counting": "robots.inflatable.program",
        "InflatableGradient": "robots.inflatable.gradient",
        "differentiate": "robots.inflatable.gradient",
        "GaitSchedule": "robots.inflatable.schedule",
        "InflatableResult": "robots.inflatable.simulation",
        "sideways": "robots.inflatable.simulation",
        "simulate": "robots.inflatable.simulation",
        "predicted_steps": "robots.inflatable.timing",
    },
)
