"""Quadrupeds that walk, roll, or both: legged, wheeled and whegged.

Source: dissertation, chapter 2 ("The robots"). All numbers are those of the published experiment; where its text
differs, ``TEXT`` holds the text's variant. A robot starts a little inside the ground, which pushes it out.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.control.neural import GRAVITY as GRAVITY
    from robots.control.neural import SLIP as SLIP
    from robots.control.neural import TIME_STEP as TIME_STEP
    from robots.quadruped.body import AS_RUN as AS_RUN
    from robots.quadruped.body import ENVIRONMENTS as ENVIRONMENTS
    from robots.quadruped.body import LEGGED as LEGGED
    from robots.quadruped.body import LEGS as LEGS
    from robots.quadruped.body import LIGHT_HEIGHT as LIGHT_HEIGHT
    from robots.quadruped.body import MOTORS as MOTORS
    from robots.quadruped.body import SENSORS as SENSORS
    from robots.quadruped.body import STEPS as STEPS
    from robots.quadruped.body import TEXT as TEXT
    from robots.quadruped.body import TWO_ENVIRONMENTS as TWO_ENVIRONMENTS
    from robots.quadruped.body import VARIANTS as VARIANTS
    from robots.quadruped.body import WHEELED as WHEELED
    from robots.quadruped.body import WHEGGED as WHEGGED
    from robots.quadruped.body import Kind as Kind
    from robots.quadruped.body import Quadruped as Quadruped
    from robots.quadruped.body import Variant as Variant
    from robots.quadruped.simulation import QuadrupedResult as QuadrupedResult
    from robots.quadruped.simulation import differentiate as differentiate
    from robots.quadruped.simulation import engine as engine
    from robots.quadruped.simulation import simulate as simulate


__getattr__, __dir__, __all__ = exported_names(__name__)
