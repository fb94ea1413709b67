"""The pneumatic rig that plays a gait on the physical robot, and gaits as tables of its line pressures."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.hardware.channel_table import ChannelTable as ChannelTable
    from robots.hardware.channel_table import read_channels as read_channels
    from robots.hardware.gait_commands import export_csv as export_csv
    from robots.hardware.gait_commands import gait_table as gait_table
    from robots.hardware.line_map import LineMap as LineMap
    from robots.hardware.lines import CHANNELS as CHANNELS
    from robots.hardware.own_lines import OwnLines as OwnLines
    from robots.hardware.rig import PRESETS as PRESETS
    from robots.hardware.rig import Channel as Channel
    from robots.hardware.rig import PneumaticRig as PneumaticRig
    from robots.hardware.rig_table import write_csv as write_csv
    from robots.hardware.start import Start as Start
    from robots.hardware.table import GaitTable as GaitTable
    from robots.hardware.table import design_hash as design_hash
    from robots.hardware.table import read_csv as read_csv
    from robots.hardware.table import read_design as read_design
    from robots.hardware.timeline import RigViolation as RigViolation
    from robots.hardware.timeline import Violation as Violation
    from robots.hardware.units import KPA_PER_UNIT as KPA_PER_UNIT

__getattr__, __dir__, __all__ = exported_names(__name__)
