"""Forwards to ``robots.inflatable``: the import path of version 1.0."""

from robots.inflatable.design import load_design as load_gait
from robots.inflatable.design import save_design as save_gait
from robots.inflatable.simulation import simulate

__all__ = ["load_gait", "save_gait", "simulate"]
