"""Forwards to ``robots.inflatable.gaits``: the import path of version 1.0."""

from robots.inflatable.gaits import (
    BESIDE_TABLES,
    GRADED_FORMAT,
    GaitDesign,
    PlayedGait,
    as_graded,
    counted_steps,
    design_of,
    is_timed,
    load_gait,
    played,
    save_gait,
    simulate,
    simulated_steps,
    steps_of,
)

__all__ = [
    "BESIDE_TABLES",
    "GRADED_FORMAT",
    "GaitDesign",
    "PlayedGait",
    "as_graded",
    "counted_steps",
    "design_of",
    "is_timed",
    "load_gait",
    "played",
    "save_gait",
    "simulate",
    "simulated_steps",
    "steps_of",
]
