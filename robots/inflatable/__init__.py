"""The inflatable shape-changing robot: its body, gaits and files, and their simulation on terrains.

A *design* is a core pressure, a heading and a schedule; also materials of the body, if regions are not as built.
A *schedule* has levels of ten actuators, from off (0) to on (1), over *columns*: actuation states, each with its motion
and its settling. A *stroke* is one inflation or deflation of a bladder. A *gait* is a design as files hold it.

Source: Powers 2021 dissertation, ch. 5 ("A soft robot that adapts to environments through shape change"); Shah, Powers
et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.frames import Frames as Frames
    from robots.inflatable.actuation import ACTUATION as ACTUATION
    from robots.inflatable.actuation import InflatableActuation as InflatableActuation
    from robots.inflatable.body import NAMED_GEOMETRIES as NAMED_GEOMETRIES
    from robots.inflatable.body import PUBLISHED as PUBLISHED
    from robots.inflatable.body import SMALL as SMALL
    from robots.inflatable.body import TWO_CORE as TWO_CORE
    from robots.inflatable.body import InflatableGeometry as InflatableGeometry
    from robots.inflatable.design import INCHING as INCHING
    from robots.inflatable.design import ROLLING as ROLLING
    from robots.inflatable.design import InflatableDesign as InflatableDesign
    from robots.inflatable.design import core_shapes as core_shapes
    from robots.inflatable.design import load_design as load_design
    from robots.inflatable.design import save_design as save_design
    from robots.inflatable.gradient import InflatableGradient as InflatableGradient
    from robots.inflatable.gradient import differentiate as differentiate
    from robots.inflatable.materials import RegionMaterials as RegionMaterials
    from robots.inflatable.schedule import MAXIMUM_PRESSURE as MAXIMUM_PRESSURE
    from robots.inflatable.schedule import GaitSchedule as GaitSchedule
    from robots.inflatable.simulation import InflatableResult as InflatableResult
    from robots.inflatable.simulation import sideways as sideways
    from robots.inflatable.simulation import simulate as simulate
    from robots.inflatable.timing import Counting as Counting
    from robots.inflatable.timing import predicted_steps as predicted_steps

__getattr__, __dir__, __all__ = exported_names(__name__)
