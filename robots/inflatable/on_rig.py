"""The inflatable robot on a modelled rig: reads the gait table that the rig plays, and simulates what comes of it."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.hardware.rig import IDEAL, PneumaticRig
from robots.hardware.rig_play import check_strokes, play_table
from robots.hardware.rig_response import AS_COMMANDED, CAUSES, LAG, WHOLE_RESPONSE, Response, causes_of
from robots.hardware.table import GaitTable, read_csv
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import TABLES
from robots.inflatable.simulation import InflatableResult, reordered, simulate
from robots.robot import Trial
from robots.world import terrain_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.short_text import decimal

if TYPE_CHECKING:
    from robots.inflatable.robot import InflatableRobot


def gait_of_table(
    text: str, options: Mapping[str, Any]
) -> tuple[InflatableDesign, PneumaticRig | None, GaitTable | None]:
    """The design of a gait table, the rig that plays it and the table; the ideal rig plays what the rows say.

    Raises:
        ValueError: for another file, options that change what is played, and rows that an ideal rig cannot play.
    """
    for name in ("from_rows", "columns", "repeats", "pressure", "bladders"):
        if name in options and options[name] is not False:
            raise ValueError(f"{name.replace('_', '-')}: is not allowed with --table, whose rows say what is played")
    if Path(text).suffix.lower() != ".csv":
        raise ValueError(f"table: {text!r} is not allowed; name a gait table (.csv)")
    table = read_csv(text)
    if options["rig"] == IDEAL:
        check_strokes(table)
        played = table.played_at_once()
        if told := _differences(played, table.design):
            warnings.warn(
                f"table: its rows differ from the gait in its header in {told}; rows are played", stacklevel=2
            )
        return played, None, None
    rig = PneumaticRig.load(options["rig"])
    rig.check_names(table.channels)
    return table.design, rig, table


def _differences(played: InflatableDesign, designed: InflatableDesign) -> str:
    """Names of what differs between two gaits; empty if nothing does."""
    pairs = {"pressure": (played.pressure, designed.pressure)}
    pairs |= {
        name: (getattr(played.schedule, name), getattr(designed.schedule, name)) for name in ("levels", *TABLES[2:])
    }
    return ", ".join(name for name, (ours, theirs) in pairs.items() if not np.array_equal(ours, theirs))


def played_by_rig(robot: "InflatableRobot", trial: Trial) -> tuple[InflatableResult, dict[str, Floats]]:
    """Simulate a robot while its rig plays its table; also the speeds without parts of the rig's response.

    ``speed_designed`` is that of the gait in the simulator's own time; ``speed_as_commanded`` has the table's longer
    strokes alone, as lines have what they are told at once, and ``speed_with_lag`` and the like one cause besides.
    """
    assert robot.rig is not None and robot.rig_table is not None
    geometry, actuation = robot.parts
    responses: dict[str, Response] = {
        "speed_simulated": WHOLE_RESPONSE,
        "speed_without_lag": WHOLE_RESPONSE - {LAG},
        "speed_as_commanded": AS_COMMANDED,
        **{f"speed_with_{cause.name}": frozenset({cause}) for cause in causes_of(robot.rig)},
    }
    settings: dict[str, Any] = {
        **trial.compute.options,
        "geometry": geometry,
        "actuation": actuation,
        "perturbation": robot.perturbation,
        "seed": robot.seed,
    }
    ground, told = terrain_of(trial.world), trial.progress
    designed = simulate([robot.gait], ground, **settings, progress=told and (lambda done: told(done / 2)))
    played = play_table(
        replace(robot.rig_table, design=robot.gait),
        robot.rig,
        ground,
        tuple(responses.values()),
        **settings,
        record_every=trial.record_every,
        progress=told and (lambda done: told((1 + done) / 2)),
    )
    speeds = {name: played.speed_simulated[n : n + 1] for n, name in enumerate(responses)}
    whole = list(responses).index("speed_simulated")
    return reordered(played, np.array([whole])), {"speed_designed": designed.speed_simulated, **speeds}


def speed_lines(rig: PneumaticRig, numbers: Mapping[str, float]) -> str:
    """Two lines for people about speeds on a rig."""
    designed, commanded = numbers["speed_designed"], numbers["speed_as_commanded"]
    lost = {cause.spoken: commanded - numbers[f"speed_with_{cause.name}"] for cause in causes_of(rig)}
    return (
        f"on the rig {rig.name}, in its time: {decimal(numbers['speed_simulated'])} BL/s; "
        f"without {LAG.spoken} {decimal(numbers['speed_without_lag'])}, "
        f"without {', '.join(cause.spoken for cause in CAUSES[:-1])} and {CAUSES[-1].spoken} {decimal(commanded)}\n"
        f"designed {decimal(designed)}; of it the rig's longer strokes take {decimal(designed - commanded)}, "
        "then each alone: " + ", ".join(f"{spoken} {decimal(loss)}" for spoken, loss in lost.items())
    )
