"""Fit the inflatable robot's properties to measurements on a rig."""

from optim.calibration.fit import Calibration, calibrate, check_names
from optim.calibration.report import document, table

__all__ = ["Calibration", "calibrate", "check_names", "document", "table"]
