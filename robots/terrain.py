"""Forwards to ``robots.world``: the import path of version 1.0."""

from robots.world import FLUID_FIELDS as FLUID_FIELDS
from robots.world import FRICTION_DRAG as FRICTION_DRAG
from robots.world import PRESSURE_DRAG as PRESSURE_DRAG
from robots.world import STEEPEST as STEEPEST
from robots.world import WATER_DENSITY as WATER_DENSITY
from robots.world import Medium as Medium
from robots.world import Terrain as Terrain
from robots.world import one_each as one_each
