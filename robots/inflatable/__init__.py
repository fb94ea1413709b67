"""The inflatable shape-changing robot: designs, and what they do on a terrain.

Source: Powers 2021 dissertation, ch. 5 ("A soft robot that adapts to environments through shape change"); Shah, Powers
et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_from

if TYPE_CHECKING:
    from robots.inflatable.robot import (
        ACTUATION,
        INCHING,
        MAXIMUM_PRESSURE,
        NAMED_GEOMETRIES,
        PUBLISHED,
        ROLLING,
        SMALL,
        TWO_CORE,
        Frames,
        InflatableActuation,
        InflatableDesign,
        InflatableGeometry,
        InflatableResult,
        load_design,
        predicted_steps,
        save_design,
        sideways,
        simulate,
    )

__all__ = [
    "ACTUATION",
    "INCHING",
    "MAXIMUM_PRESSURE",
    "NAMED_GEOMETRIES",
    "PUBLISHED",
    "ROLLING",
    "SMALL",
    "TWO_CORE",
    "Frames",
    "InflatableActuation",
    "InflatableDesign",
    "InflatableGeometry",
    "InflatableResult",
    "load_design",
    "predicted_steps",
    "save_design",
    "sideways",
    "simulate",
]

__getattr__ = exported_from(__name__, "robots.inflatable.robot", __all__)
