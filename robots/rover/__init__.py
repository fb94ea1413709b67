"""A vehicle on two driven wheels and a castor, steered by two light sensors, as an articulated body on the ground.

Source: dissertation, chapter 3, "The empirical model"; the defaults are the published base parameters, found by a
search of its authors. The vehicle drives along its own y; x is to its right. Lights are points of light here: that the
published ones are balls, which stop the vehicle, does not matter, as it succeeds before it touches them.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.control.neural import GRAVITY as GRAVITY
    from robots.control.neural import SLIP as SLIP
    from robots.control.neural import TIME_STEP as TIME_STEP
    from robots.rover.body import BEST as BEST
    from robots.rover.body import CANONICAL as CANONICAL
    from robots.rover.body import LIGHT_HEIGHT as LIGHT_HEIGHT
    from robots.rover.body import LIGHT_RADIUS as LIGHT_RADIUS
    from robots.rover.body import LIGHTS as LIGHTS
    from robots.rover.body import ROUNDING as ROUNDING
    from robots.rover.body import SENSES as SENSES
    from robots.rover.body import STEPS as STEPS
    from robots.rover.body import WHEEL_SETBACK as WHEEL_SETBACK
    from robots.rover.body import WIDTH as WIDTH
    from robots.rover.body import Rover as Rover
    from robots.rover.body import Site as Site
    from robots.rover.body import Sites as Sites
    from robots.rover.simulation import RoverResult as RoverResult
    from robots.rover.simulation import controllers as controllers
    from robots.rover.simulation import differentiate as differentiate
    from robots.rover.simulation import engine as engine
    from robots.rover.simulation import simulate as simulate


__getattr__, __dir__, __all__ = exported_names(__name__)
