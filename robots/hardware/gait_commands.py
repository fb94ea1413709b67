"""From a gait of the inflatable robot to the table of a rig, and to what the gait asks of the rig.

A gait with the published times leaves time to the rig; one with times of its own dwells as it does in the simulation.
"""

import os
from dataclasses import replace

import numpy as np

from robots.hardware.headroom import RigReport, uses_of
from robots.hardware.line_map import LineMap
from robots.hardware.rig import PneumaticRig
from robots.hardware.rig_table import write_csv
from robots.hardware.start import Start
from robots.hardware.table import TIME_STEP, GaitTable, on_lines
from robots.hardware.timeline import Commands, RigViolation, asked, timeline, violations
from robots.hardware.units import KPA_PER_UNIT
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS, ROWS
from robots.inflatable.timing import durations


def commands_of(design: InflatableDesign, line_map: LineMap, cores: int = 1, start: Start | None = None) -> Commands:
    """The commands of a gait.

    Args:
        design: with one core pressure, or one for each of several lines.
        cores: lines for them.
        line_map: from simulated to line pressures.
        start: where its first column begins; None: bladders are empty and feet grip, in the design's shape.
    """
    schedule = design.schedule
    shaping = (np.arange(ROWS) >= BLADDERS).astype(float) if start is None else np.array(start.levels)
    levels = np.column_stack([shaping, schedule.levels, schedule.levels])
    core, times = np.empty((cores, levels.shape[1])), np.zeros((schedule.columns, 2))
    core.T[:] = design.pressure
    if start is not None:
        core[:, 0] = start.cores(cores)
    if schedule.core_pressure is not None:
        core[:, 1:] = np.tile(schedule.core_pressure, 2)
    if schedule.has_own_times:
        times = np.array(durations(schedule, ACTUATION))[: schedule.columns] * TIME_STEP
    states = line_map.lines(core, levels)
    portions = np.ones((len(states) + 1, states.shape[1]))
    ways = np.abs(np.diff(levels, axis=1)).T
    portions[1:-1, cores:] = np.where(ways > 0, ways, 1.0)
    if schedule.pace is not None:  # a stroke takes the longer, the slower it is
        portions[1:-1, cores : cores + BLADDERS] /= np.tile(schedule.pace, 2).T
    moving, resting = np.pad(np.tile(times.T, 2), ((0, 0), (1, 1)))
    return Commands(np.vstack([states, np.zeros(states.shape[1])]), portions, moving, resting)


def gait_table(
    design: InflatableDesign,
    rig: PneumaticRig | None = None,
    units: str | None = None,
    *,
    rate: float | None = None,
    on_violation: str = "refuse",
    seed: int | None = None,
    start: Start | None = None,
) -> GaitTable:
    """Make the table of line pressures that plays a gait of the inflatable robot on a rig, within its limits.

    All lines start vented. The core goes to the line pressure of the design's; a flat body (pressure 0) is drawn flat
    by vacuum. The feet grip meanwhile, as in the simulation's initialisation. A table that is to follow another gait
    without venting has to begin where that ends: state 0 then leads there, and state 1 takes the time from there.

    Args:
        design: pressure [Pa], one for each of the rig's lines for cores where they differ, orientation [degrees] and
            schedule.
        rig: the rig; the dissertation's if None.
        units: ``"kpa"`` or ``"psi"``; None: the rig's.
        rate: rows per second [Hz], and states last whole samples; None: rows at the corners of the pressures.
        on_violation: of the rig's limits: ``"refuse"``, or ``"clip"``: pressures stop at limits, and strokes take as
            long as the limit of rate asks.
        seed: of the search that found the design, for the header.
        start: where the first column begins, such as ``Start.after(gait_before)``; None: as above.

    Raises:
        RigViolation: a ValueError, if a pressure or a rate exceeds the rig's limits and is not clipped.
        ValueError: for any other value that is not allowed.
    """
    rig, units, clip, seed = asked(rig, units, rate, on_violation, seed)
    design = on_lines(design, rig)
    told = design.schedule.core_pressure
    pressures = np.append(design.pressure, [] if told is None else told)
    pressures = np.append(pressures, [] if start is None else start.pressure)
    line_map = rig.line_map.without_unused_ramp(pressures)
    commands = commands_of(design, line_map, rig.cores, start)
    found = violations(commands, timeline(commands, rig).states, rig)
    if found and not clip:
        raise RigViolation(found)
    if found:
        low, high = rig.pressure_limits
        line_map = line_map.within(low[rig.cores :], high[rig.cores :])
        commands = commands_of(design, line_map, rig.cores, start).within(low, high)
    line = timeline(commands, rig, rate, keep_slew=clip)
    if found:  # rounding of rows on the way to a limit
        line = replace(line, pressures=np.clip(line.pressures, low, high))
    return GaitTable(
        line.times,
        line.numbers,
        line.pressures / KPA_PER_UNIT[units],
        units,
        design,
        line_map,
        seed,
        rig.name,
        rate,
        tuple(map(str, found)),
        line.states,
        start,
    )


def export_csv(
    design: InflatableDesign,
    path: str | os.PathLike[str],
    rig: PneumaticRig | None = None,
    units: str | None = None,
    *,
    rate: float | None = None,
    on_violation: str = "refuse",
    seed: int | None = None,
    start: Start | None = None,
) -> GaitTable:
    """Write the gait table of a design as CSV, replacing the file in one step.

    Args:
        design: pressure [Pa], orientation [degrees] and schedule.
        path: of the CSV file.
        rig, units, rate, on_violation, seed, start: see :func:`robots.hardware.gait_table`.

    Returns:
        The table that was written.

    Raises:
        ValueError: if the rig's limits refuse the gait or the file cannot be written.
    """
    table = gait_table(design, rig, units, rate=rate, on_violation=on_violation, seed=seed, start=start)
    write_csv(table, path)
    return table


def rig_report(design: InflatableDesign, rig: PneumaticRig | None = None) -> RigReport:
    """What a design asks of a rig, the dissertation's if None; a gait that is refused, too.

    Raises:
        ValueError: for a design with several cores that are not alike, and too few lines for them.
    """
    rig = rig or PneumaticRig()
    columns, repeats = design.schedule.columns, design.schedule.repeats
    commands = commands_of(on_lines(design, rig), rig.line_map, rig.cores)
    line = timeline(commands, rig)
    lasting = [state.end_s - state.start_s for state in line.states]
    first, again = lasting[1 : columns + 1], lasting[columns + 1 : 2 * columns + 1]
    played = [*first, *again] if repeats > 1 else first
    playing = sum(first) + (repeats - 1) * sum(again)
    return RigReport(uses_of(commands, line, rig), lasting[0], playing, columns * repeats, min(played), max(played))
