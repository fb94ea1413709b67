"""The pneumatic rig that plays a gait on the physical robot, and gaits as tables of its line pressures."""

from robots.hardware.csv_files import export_csv, read_csv, read_design, write_csv
from robots.hardware.limits import RigViolation, Violation
from robots.hardware.line_map import LineMap
from robots.hardware.rig import CHANNELS, KPA_PER_UNIT, PRESETS, Channel, PneumaticRig
from robots.hardware.table import GaitTable, design_hash, gait_table

__all__ = [
    "CHANNELS",
    "KPA_PER_UNIT",
    "PRESETS",
    "Channel",
    "GaitTable",
    "LineMap",
    "PneumaticRig",
    "RigViolation",
    "Violation",
    "design_hash",
    "export_csv",
    "gait_table",
    "read_csv",
    "read_design",
    "write_csv",
]
