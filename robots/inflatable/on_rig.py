"""The inflatable robot on a modelled rig: reads the gait table that the rig plays, and simulates what comes of it."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.hardware.rig import PneumaticRig
from robots.hardware.rig_play import check_strokes, play_table
from robots.hardware.rig_response import Response
from robots.hardware.table import GaitTable, read_csv
from robots.inflatable.design import InflatableDesign
from robots.inflatable.simulation import InflatableResult, reordered
from robots.robot import Trial
from robots.world import terrain_of
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.inflatable.kind import InflatableRobot

IDEAL = "ideal"
RESPONSES = (Response(), Response(lag=False), Response(valves=False, lag=False))


def gait_of_table(
    text: str, options: Mapping[str, Any]
) -> tuple[InflatableDesign, PneumaticRig | None, GaitTable | None]:
    """The design of a gait table, the rig that plays it and the table; the ideal rig plays what the rows say.

    Raises:
        ValueError: for another file, options that change what is played, and rows that an ideal rig cannot play.
    """
    for name in ("from_rows", "columns", "repeats", "pressure"):
        if name in options and options[name] is not False:
            raise ValueError(f"{name.replace('_', '-')}: is not allowed with --table, whose rows say what is played")
    if Path(text).suffix.lower() != ".csv":
        raise ValueError(f"table: {text!r} is not allowed; name a gait table (.csv)")
    table = read_csv(text)
    if options["rig"] == IDEAL:
        check_strokes(table)
        return table.played(), None, None
    return table.design, PneumaticRig.load(options["rig"]), table


def played_by_rig(robot: "InflatableRobot", trial: Trial) -> tuple[InflatableResult, dict[str, Floats]]:
    """What becomes of a robot whose rig plays its table, and speeds without lag, and without delays and limits too."""
    assert robot.rig is not None and robot.rig_table is not None
    geometry, actuation = robot.parts
    played = play_table(
        dataclasses.replace(robot.rig_table, design=robot.gait),
        robot.rig,
        terrain_of(trial.world),
        RESPONSES,
        geometry=geometry,
        actuation=actuation,
        **trial.compute.options,
        record_every=trial.record_every,
        perturbation=robot.perturbation,
        seed=robot.seed,
        progress=trial.progress,
    )
    speeds = played.speed_simulated
    return reordered(played, np.array([0])), {"speed_without_lag": speeds[1:2], "speed_without_valves": speeds[2:]}


def told(rig: PneumaticRig, numbers: Mapping[str, float]) -> str:
    """What people are told of speeds on a rig, as a line."""
    return (
        f"on the rig {rig.name}, in its time: {numbers['speed_simulated']:.4f} BL/s; "
        f"without lag {numbers['speed_without_lag']:.4f}, "
        f"nor delays and limits of rate {numbers['speed_without_valves']:.4f}"
    )
