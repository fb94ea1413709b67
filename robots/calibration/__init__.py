"""Experiments on a rig and their simulation, so that properties of the robot can be fitted to what was measured."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.calibration.experiments import KINDS as KINDS
    from robots.calibration.experiments import Diameter as Diameter
    from robots.calibration.experiments import Drag as Drag
    from robots.calibration.experiments import Experiment as Experiment
    from robots.calibration.experiments import Gait as Gait
    from robots.calibration.laboratory import Laboratory as Laboratory
    from robots.calibration.laboratory import Replica as Replica
    from robots.calibration.laboratory import Trial as Trial
    from robots.calibration.measurements import Measurements as Measurements
    from robots.calibration.measurements import read_measurements as read_measurements
    from robots.calibration.measurements import write_measurements as write_measurements
    from robots.calibration.properties import BOUNDS as BOUNDS
    from robots.calibration.properties import CALIBRATION_FORMAT as CALIBRATION_FORMAT
    from robots.calibration.properties import NAMES as NAMES
    from robots.calibration.properties import UNITS as UNITS
    from robots.calibration.properties import Properties as Properties
    from robots.calibration.properties import load_calibration as load_calibration
    from robots.calibration.properties import robot_of as robot_of
    from robots.calibration.properties import save_properties as save_properties
    from robots.calibration.properties import weight_of_calibration as weight_of_calibration

__getattr__, __dir__, __all__ = exported_names(__name__)
