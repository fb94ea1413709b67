"""Experiments on a rig and their simulation, so that properties of the robot can be fitted to what was measured."""

from robots.calibration.experiments import KINDS, Diameter, Drag, Experiment, Gait
from robots.calibration.laboratory import Laboratory, Trial
from robots.calibration.measurements import Measurements, read_measurements, write_measurements
from robots.calibration.properties import (
    BOUNDS,
    CALIBRATION_FORMAT,
    NAMES,
    UNITS,
    Properties,
    load_calibration,
    robot_of,
    save_properties,
)

__all__ = [
    "BOUNDS",
    "CALIBRATION_FORMAT",
    "KINDS",
    "NAMES",
    "UNITS",
    "Diameter",
    "Drag",
    "Experiment",
    "Gait",
    "Laboratory",
    "Measurements",
    "Properties",
    "Trial",
    "load_calibration",
    "read_measurements",
    "robot_of",
    "save_properties",
    "write_measurements",
]
