"""Playing a gait table through a rig model: what the simulated robot does when its lines take their time.

Commands of the rows become pressures behind the lines (``rig_response``), and these, sample by sample, the core's
pressure, the bladders' thickness and the friction of the feet, by the inverse of the table's map. A second of the table
is a second of the simulation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Unpack

import numpy as np

from robots.hardware.rig import PneumaticRig
from robots.hardware.rig_response import WHOLE_RESPONSE, Response, line_pressures
from robots.hardware.table import GaitTable
from robots.hardware.units import KPA_PER_UNIT, UNIT_SPELLING
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import FIRST_BLADDER, FOOT_REGIONS, PUBLISHED, InflatableGeometry, skin_regions
from robots.inflatable.body import SKIN_REGIONS as SKIN
from robots.inflatable.numbers import Numbers
from robots.inflatable.program import RobotEvents
from robots.inflatable.schedule import BLADDERS
from robots.inflatable.simulation import InflatableResult, engine_of, laid_out, summarise
from robots.inflatable.timing import WHOLE
from robots.world import Terrain
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.lattice import ProgramBuilder, Quantity

SAMPLE_STEPS = 100  # time steps between samples, about 0.01 s of the published robot
_AT_REST = 0.01  # of a bladder: change of its level per second below which it does not move
_ON_STROKE = 1e-4  # how far a row may lie beside the stroke of its state [kPa]


def commanded(table: GaitTable) -> tuple[Floats, Floats, float, float]:
    """Commands of prefix and all loops of the main, over time.

    Returns:
        Times [s], shape (N,); pressures of L lines [kPa], shape (N, L); when the body is shaped, and when its first
        column ends.
    """
    shaped = float(table.times[table.states == 0].max())
    first = float(table.times[table.states == 1].max())
    return *table.played_rows(table.loops), shaped, first


def check_strokes(table: GaitTable) -> None:
    """Refuse rows that are no strokes: in every state each line goes to its target at one rate, then stays there.

    Raises:
        ValueError: that names the first row that lies elsewhere.
    """
    pressures = table.pressures * KPA_PER_UNIT[table.units]
    for state in range(int(table.states.max()) + 1):
        mine = np.flatnonzero(table.states == state)
        if state and table.times[mine[0]] > table.times[mine[0] - 1]:
            mine = np.concatenate([[mine[0] - 1], mine])
        times, rows = table.times[mine], pressures[mine]
        way, passed = rows[-1] - rows[0], times - times[0]
        stroke = rows[0] + np.sign(way) * np.minimum(np.outer(passed, _rates(rows, passed)), np.abs(way))
        wrong = np.argwhere(np.abs(rows - stroke) > _ON_STROKE)
        if len(wrong):
            row, line = (int(one) for one in wrong[0])
            name = table.channels[line]
            value, unit = rows[row, line] / KPA_PER_UNIT[table.units], UNIT_SPELLING[table.units]
            found = f"{value:g} {unit} at {times[row]:g} s is beside the stroke of state {state}"
            raise ValueError(f"rig: 'ideal' plays strokes at one rate, but {name}: {found}; name a rig")


def _rates(rows: Floats, passed: Floats) -> Floats:
    """Rates [kPa/s] at which lines went to the last of rows, shape (N, L), by the last row on the way there.

    Rows are rounded, which earlier ones tell more of than of the rate. A line with no row on its way is as fast as the
    first row says.

    Args:
        rows: pressures [kPa].
        passed: since the first [s], shape (N,).
    """
    if len(rows) == 1:
        return np.zeros(rows.shape[1])
    on_the_way = (np.abs(rows - rows[-1]) > _ON_STROKE)[1:]
    last = np.where(on_the_way.any(axis=0), len(on_the_way) - on_the_way[::-1].argmax(axis=0), 1)
    rates: Floats = np.abs(rows[last, np.arange(rows.shape[1])] - rows[0]) / passed[last]
    return rates


@dataclass(frozen=True)
class Play:
    """A table as one robot of a batch plays it.

    Attributes:
        table: that is played.
        rig: that plays it.
        terrain: on which the robot moves.
        response: which parts of the rig's pneumatics act.
        copy: number of the start's noise; equal numbers have equal starts.
    """

    table: GaitTable
    rig: PneumaticRig
    terrain: Terrain = field(default_factory=Terrain)
    response: Response = WHOLE_RESPONSE
    copy: int = 0

    def __post_init__(self) -> None:
        self.rig.check_plays_gaits()
        self.rig.check_names(self.table.channels)


class PlaySettings(ComputeOptions, total=False):
    """Settings of :func:`play_tables`, as keywords."""

    geometry: InflatableGeometry
    actuation: InflatableActuation
    record_every: int | None
    perturbation: float
    seed: int
    progress: Callable[[float], None] | None


def play_table(
    table: GaitTable,
    rig: PneumaticRig,
    terrain: Terrain | None = None,
    responses: Sequence[Response] = (WHOLE_RESPONSE,),
    **settings: Unpack[PlaySettings],
) -> InflatableResult:
    """Simulate the robot while a rig plays a table, once for each of several responses; see :func:`play_tables`."""
    ground = Terrain() if terrain is None else terrain
    return play_tables([Play(table, rig, ground, response) for response in responses], **settings)


def play_tables(
    plays: Sequence[Play],
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    record_every: int | None = None,
    perturbation: float = 0.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> InflatableResult:
    """Simulate robots while rigs play their tables, as one batch.

    Distance counts from the end of a table's state 0, which shapes the body, to the end of its last loop; ``speed``
    and ``speed_simulated`` divide by that time of the rig. Poses are recorded only of tables that last equally long.

    Raises:
        ValueError: if an argument is not allowed.
    """
    builder, designs = ProgramBuilder(len(plays)), [play.table.design for play in plays]
    geometry = laid_out(geometry, designs)
    spans = [_write_play(builder, robot, play, actuation, geometry) for robot, play in enumerate(plays)]
    marks = [[*span, *(range(span[0], span[1] + 1, record_every) if record_every else ())] for span in spans]
    if len({len(each) for each in marks}) > 1:
        raise ValueError(f"record_every: {record_every} is not allowed for tables of different lengths; leave it out")
    program = builder.build([end for _, end in spans], np.array(marks))
    copies = [play.copy for play in plays]
    starts = geometry.body.scattered(perturbation, seed, copies) if perturbation > 0 else None
    terrains = [play.terrain for play in plays]
    engine = engine_of(geometry, terrains, actuation, Compute.given(compute), designs, starts)
    run = engine.run(program, progress)
    found = summarise(run, program, designs, geometry, actuation, WHOLE, record_every, terrains)
    return replace(found, speed=found.speed_simulated)  # no convention of the simulator's time is that of a rig


def _write_play(
    builder: ProgramBuilder, robot: int, play: Play, actuation: InflatableActuation, geometry: InflatableGeometry
) -> tuple[int, int]:
    """Write what a robot feels; returns the steps at which its body is shaped and its gait ends."""
    table, dt = play.table, geometry.time_step
    times, commands, shaped, first = commanded(table)
    begin, end = round(shaped / dt), round(float(times[-1]) / dt)
    steps = np.arange(0, end + SAMPLE_STEPS, SAMPLE_STEPS)
    lines = line_pressures(times, commands, play.rig, np.asarray(steps * dt, np.float64), play.response)
    events = _events(builder, robot, table, play.terrain, actuation, geometry)
    events.initialise(begin, inflate=False)
    _follow(events, table, lines, steps, begin, dt)
    events.set_foot_seams(events.actuation.high_friction, round(first / dt))
    return begin, end


def _events(
    builder: ProgramBuilder,
    robot: int,
    table: GaitTable,
    terrain: Terrain,
    actuation: InflatableActuation,
    geometry: InflatableGeometry,
) -> RobotEvents:
    own = Numbers.of(table.design)
    return RobotEvents.of(builder, robot, 0.0, own.orientation, terrain, actuation, geometry, own.friction, own.size)


def _follow(events: RobotEvents, table: GaitTable, lines: Floats, steps: Ints, begin: int, dt: float) -> None:
    """Write what the robot feels while L lines have these pressures [kPa], shape (S, L), at steps, shape (S,)."""
    a = events.actuation
    core, levels = table.simulated(lines)
    bodies = len(events.cores)
    if core.ndim == 2 and len(core) != bodies:
        raise ValueError(f"table: {len(core)} lines for cores are not allowed; the body has {bodies}, see --geometry")
    for number, one in enumerate(np.broadcast_to(core, (bodies, core.shape[-1]))):
        for region in skin_regions(SKIN, number):
            _course(events, Quantity.PRESSURE, one, region, steps)
    felt = core if core.ndim == 1 else np.array(events.shares) @ core
    along = a.lengthening_flat + (a.lengthening_round - a.lengthening_flat) * felt / a.round_pressure
    sizes = np.ones((2, BLADDERS)) if events.bladder_sizes is None else events.bladder_sizes
    for bladder, level in enumerate(levels[:BLADDERS]):
        grown, region = level * (a.inflated - a.deflated), FIRST_BLADDER + bladder
        _course(events, Quantity.SCALE, sizes[0, bladder] * (1.0 + a.widening * grown), region, steps)
        _course(events, Quantity.SCALE + 1, sizes[1, bladder] * (1.0 + grown / along), region, steps)
        _course(events, Quantity.SCALE + 2, a.deflated + grown, region, steps)
    high, low = np.full((2, 2), [[a.high_friction], [a.low_friction]]) if events.friction is None else events.friction
    for foot, grip in enumerate(levels[BLADDERS:]):
        for each in range(len(events.cores)):
            region = skin_regions(FOOT_REGIONS, each)[foot]
            for quantity in (Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION):
                _course(events, quantity, (1.0 - grip) * low[foot] + grip * high[foot], region, steps)
    moving = np.abs(np.diff(levels[:BLADDERS], axis=1, append=levels[:BLADDERS, -1:])) > _AT_REST * SAMPLE_STEPS * dt
    damping = np.where(moving.any(axis=0), a.moving_damping, a.settling_damping)
    damping[steps < begin] = 0.0
    for region in events.everywhere:
        _switched(events, Quantity.GLOBAL_DAMPING, damping, region, steps)
    if a.weight == "published":
        for bladder, level in enumerate(levels[:BLADDERS]):
            carried = np.where(moving[bladder], 0.0, 1.0 - level)
            for axis in range(3):
                weight = carried * events.gravity[1][axis]
                _switched(events, Quantity.ACCELERATION + axis, weight, FIRST_BLADDER + bladder, steps)


def _course(events: RobotEvents, quantity: int, values: Floats, region: int, steps: Ints) -> None:
    """Let a channel go through values at steps, linearly in between."""
    rates = np.diff(values) / SAMPLE_STEPS
    kept = np.append(True, (rates[1:] != 0) | (rates[:-1] != 0))
    _write(events, quantity, values[:-1][kept], region, steps[:-1][kept], rates[kept])


def _switched(events: RobotEvents, quantity: int, values: Floats, region: int, steps: Ints) -> None:
    """Give a channel values at steps, each until the next."""
    kept = np.append(True, np.diff(values) != 0)
    _write(events, quantity, values[kept], region, steps[kept], np.zeros(int(kept.sum())))


def _write(events: RobotEvents, quantity: int, values: Any, region: int, steps: Ints, rates: Floats) -> None:
    events.set(quantity, values, np.full(len(steps), region), steps, rates)
